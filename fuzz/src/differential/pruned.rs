//! The bounds that pruned routines prove.

use wayfix::inference::Pruning;
use wayfix::likelihood::{LocalLikelihood, SparseObservation};
use wayfix::{Controlled, Hmm, HmmError, Sequence, SparseLikelihood, TransitionEntries};

use super::{close, paths, stops};
use crate::counts::Counts;
use crate::draw::Draw;
use crate::model::{Observation, Scene, Sensor};
use crate::reference::Chain;

/// Possible error of the reference itself.
const ROUNDING: f64 = 1e-12;

pub(super) fn check<A: TransitionEntries + Clone>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    scene: &Scene,
    (controls, drive): (&[A::Control], &[Observation]),
    chain: &Chain,
    counts: &mut Counts,
) {
    filter(draw, hmm, (controls, drive), chain, counts);
    let sequence = Controlled::new(controls, drive).expect("a control each");
    beam(draw, hmm, &sequence, chain, counts);
    if scene.logs {
        return;
    }
    let lists: Option<Vec<SparseObservation>> = drive.iter().map(|y| list(scene, y)).collect();
    let Some(lists) = lists else { return };
    let sensor = SparseLikelihood::new(scene.states);
    let hmm = Hmm::new(scene.prior(), hmm.transition().clone(), sensor).expect("a model");
    filter(draw, &hmm, (controls, &lists), chain, counts);
    let sequence = Controlled::new(controls, &lists).expect("a control each");
    beam(draw, &hmm, &sequence, chain, counts);
}

/// The observation as a list of states that are more likely than the others.
fn list(scene: &Scene, observation: &Observation) -> Option<SparseObservation> {
    scene.logs(observation)?;
    let ones = vec![1.0; scene.states];
    let values = observation.as_ref().unwrap_or(&ones);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let above = values.iter().copied().enumerate().filter(|entry| entry.1 > least);
    Some(SparseObservation::new(above.collect(), least).expect("valid likelihoods"))
}

fn filter<A: TransitionEntries, B: LocalLikelihood<Observation: Sized>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, B>,
    (controls, drive): (&[A::Control], &[B::Observation]),
    chain: &Chain,
    counts: &mut Counts,
) {
    let tolerance = draw.pick(&[0.0, 1e-12, 1e-6, 1e-3, 1.0]);
    let most_active = draw.pick(&[usize::MAX, usize::MAX, 1, 2, 4]);
    let mut filter = hmm
        .pruned_filter(Pruning::default().with_tolerance(tolerance).with_most_active(most_active));
    let mut log = 0.0;
    for (step, (control, observation)) in (1..).zip(controls.iter().zip(drive)) {
        let before = (filter.active().to_vec(), filter.probabilities().to_vec());
        let bound = match filter.step_with(control, observation) {
            Ok(certificate) => certificate.bound(),
            Err(error) => {
                let pruned = matches!(error, HmmError::Pruned { .. });
                let is_true = pruned || stops(&error, chain.stop);
                assert!(is_true, "pruned_filter: {error}, expected {:?}", chain.stop);
                let after = (filter.active().to_vec(), filter.probabilities().to_vec());
                assert_eq!(after, before, "the pruned filter after an error");
                counts.add("errors of the pruned filter");
                return;
            }
        };
        assert!(step <= chain.len(), "pruned_filter: a belief, expected {:?}", chain.stop);
        log += chain.steps[step - 1];
        let exact = chain.filtered[step].iter().map(|log| log.exp());
        let difference =
            |(state, p): (usize, f64)| (filter.probability(state).expect("a state") - p).abs();
        let distance = 0.5 * exact.enumerate().map(difference).sum::<f64>();
        assert!(
            distance <= bound + ROUNDING && bound <= 1.0,
            "pruned_filter, step {step}: {distance:e} off, said to be within {bound:e}"
        );
        let (range, slack) = (filter.log_likelihood(), 1e-12 * chain.size());
        assert!(
            range.start() - slack <= log && log <= range.end() + slack,
            "pruned_filter, step {step}: log-likelihood {log}, said to be within {range:?}"
        );
        assert!(filter.active().len() <= most_active);
        counts.add("steps of the pruned filter");
        counts.add(if bound <= 1e-3 { "bounds up to 1e-3" } else { "bounds above 1e-3" });
    }
}

fn beam<A: TransitionEntries, B: LocalLikelihood, S: Sequence<A::Control, B::Observation>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, B>,
    sequence: &S,
    chain: &Chain,
    counts: &mut Counts,
) {
    let width = draw.pick(&WIDTHS);
    let exact = hmm.viterbi(sequence).ok().map(wayfix::inference::ViterbiPath::into_states);
    say(hmm.beam_viterbi(sequence, width), width, exact.as_deref(), chain, counts);
}

const WIDTHS: [f64; 6] = [0.0, 1.0, 5.0, 30.0, 1000.0, f64::INFINITY];

fn say(
    found: Result<wayfix::inference::BeamPath, HmmError>,
    width: f64,
    exact: Option<&[usize]>,
    chain: &Chain,
    counts: &mut Counts,
) {
    let found = match found {
        Ok(found) => found,
        Err(error) => {
            let pruned = matches!(error, HmmError::Pruned { .. }) && width < f64::INFINITY;
            let is_true = pruned || stops(&error, chain.stop);
            assert!(is_true, "beam_viterbi: {error}, expected {:?}", chain.stop);
            return counts.add("errors of the beam");
        }
    };
    assert!(chain.stop.is_none(), "beam_viterbi: a path, expected {:?}", chain.stop);
    paths::legal("beam_viterbi", found.path(), chain);
    let best = chain.best(chain.len(), 1)[0];
    let slack = 1e-12 * chain.size();
    let bound = found.upper_bound();
    assert!(bound >= best - slack, "beam_viterbi: a path of {best} above the bound of {bound}");
    if found.is_optimal() {
        let log = found.path().log_probability();
        close::log("beam_viterbi, said to be optimal", log, best, chain.size());
        counts.add("beams proven");
    }
    if let (true, Some(exact)) = (found.is_unrivalled(), exact) {
        // Paths of the beam may still tie, up to rounding.
        let logs = [found.path().states(), exact].map(|path| chain.log_probability(path));
        let same = found.path().states() == exact;
        assert!(same || (logs[0] - logs[1]).abs() <= slack, "beam said to be unrivalled: {logs:?}");
    }
    counts.add("beams");
}
