//! One step of Baum–Welch against the reference's expected counts.

use wayfix::inference::{LearnError, LearnedModel, LearningOptions};
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;
use wayfix::{Fixed, Hmm, TableLikelihood, TransitionEntries};

use super::close;
use crate::counts::Counts;
use crate::draw::Draw;
use crate::model::{Matrix, Range, Scene, weight};
use crate::operators::Plain;
use crate::reference::{Chain, logarithms};

/// Columns with a smaller expected count are not compared.
const LEAST_SEEN: f64 = 1e-280;

/// Expected counts of the hidden states, over all possible sequences.
struct Expected {
    first: Vec<f64>,
    moves: Matrix,
    log_likelihood: f64,
    size: f64,
}

impl Expected {
    fn of(scene: &Scene, chains: &[&Chain]) -> Self {
        let n = scene.states;
        let nothing = vec![vec![0.0; n]; n];
        let mut all = Self { first: vec![0.0; n], moves: nothing, log_likelihood: 0.0, size: 1.0 };
        for chain in chains.iter().filter(|chain| chain.len() > 0) {
            let (gamma, pairs) = chain.smoothed(chain.len());
            all.first.iter_mut().zip(&gamma[0]).for_each(|(sum, log)| *sum += log.exp());
            for pairs in pairs.iter().skip(usize::from(scene.at_first)) {
                for (sums, row) in all.moves.iter_mut().zip(pairs) {
                    sums.iter_mut().zip(row).for_each(|(sum, log)| *sum += log.exp());
                }
            }
            all.log_likelihood += chain.log_likelihood();
            all.size += chain.size();
        }
        all
    }
}

pub(super) fn check(
    draw: &mut Draw<'_>,
    scene: &Scene,
    operator: &Plain,
    matrix: &Matrix,
    chains: &[Chain],
    counts: &mut Counts,
) {
    let pseudo = draw.pick(&[0.0, 0.5]);
    let hmm = Hmm::new(scene.prior(), operator.clone(), Fixed(scene.sensor())).expect("a model");
    let failed: Vec<usize> =
        (0..).zip(chains).filter(|c| c.1.stop.is_some()).map(|c| c.0).collect();
    let kept: Vec<&Chain> = chains.iter().filter(|chain| chain.stop.is_none()).collect();
    let nothing = kept.iter().all(|chain| chain.len() == 0);
    let learned = learn(&hmm, &scene.drives, pseudo, &failed, nothing, counts);
    if let Some(learned) = learned {
        compare(scene, &learned, &Expected::of(scene, &kept), matrix, pseudo);
        counts.add("models learned from likelihoods");
    }
    symbols(draw, scene, operator, matrix, pseudo, counts);
}

/// One step with a table, which is learned, too.
fn symbols(
    draw: &mut Draw<'_>,
    scene: &Scene,
    operator: &Plain,
    matrix: &Matrix,
    pseudo: f64,
    counts: &mut Counts,
) {
    let rows: Matrix = (0..scene.states)
        .map(|_| draw.distribution(3, |draw| weight(draw, Range::Plain)))
        .collect();
    let column = |y: usize| Some(rows.iter().map(|row| row[y]).collect::<Vec<f64>>());
    let drives: Vec<Vec<usize>> =
        (0..draw.below(20)).map(|_| (0..draw.below(20)).map(|_| draw.below(3)).collect()).collect();
    let table = TableLikelihood::from_rows(&rows).expect("a table");
    let hmm = Hmm::new(scene.prior(), operator.clone(), table).expect("a model");
    let linear = Scene { logs: false, prior: scene.prior.clone(), drives: Vec::new(), ..*scene };
    let logs = logarithms(matrix);
    let chains: Vec<Chain> = drives
        .iter()
        .map(|drive| {
            let seen: Vec<_> = drive.iter().map(|y| column(*y)).collect();
            Chain::new(&linear, |_| (&logs, None), &seen)
        })
        .collect();
    let failed: Vec<usize> =
        (0..).zip(&chains).filter(|c| c.1.stop.is_some()).map(|c| c.0).collect();
    let kept: Vec<&Chain> = chains.iter().filter(|chain| chain.stop.is_none()).collect();
    let nothing = kept.iter().all(|chain| chain.len() == 0);
    let Some(learned) = learn(&hmm, &drives, pseudo, &failed, nothing, counts) else {
        return;
    };
    compare(scene, &learned, &Expected::of(scene, &kept), matrix, pseudo);
    let mut seen = vec![[0.0; 3]; scene.states];
    for (drive, chain) in drives.iter().zip(&chains).filter(|(_, chain)| chain.stop.is_none()) {
        let (gamma, _) = chain.smoothed(chain.len());
        for (y, gamma) in drive.iter().zip(&gamma[1..]) {
            seen.iter_mut().zip(gamma).for_each(|(row, log)| row[*y] += log.exp());
        }
    }
    for (i, (old, seen)) in rows.iter().zip(&seen).enumerate() {
        let found: Vec<f64> = (0..3)
            .map(|y| learned.model().likelihood().probability(i, y).expect("a symbol"))
            .collect();
        distribution("row of the table", &found, old, seen, pseudo);
    }
    counts.add("models learned from symbols");
}

fn learn<A, B, S>(
    hmm: &Hmm<A, B>,
    drives: &[S],
    pseudo: f64,
    failed: &[usize],
    nothing: bool,
    counts: &mut Counts,
) -> Option<LearnedModel<A, B>>
where
    A: LearnTransition + Clone + Sync,
    B: LearnLikelihood + Clone + Sync,
    S: wayfix::Sequence<A::Control, B::Observation> + Sync,
{
    let learning = LearningOptions::default()
        .with_iterations(1)
        .with_tolerance(0.0)
        .with_prior_pseudo_count(pseudo)
        .with_transition_pseudo_count(pseudo)
        .with_likelihood_pseudo_count(pseudo);
    match hmm.learn(drives, &learning) {
        Ok(learned) => {
            assert!(!nothing, "learned from nothing");
            let out: Vec<usize> = learned.left_out().iter().map(|e| e.sequence).collect();
            assert_eq!(out, failed, "sequences left out, {:?}", learned.left_out());
            Some(learned)
        }
        Err(LearnError::Nothing { .. } | LearnError::AllFailed(_)) if nothing => {
            counts.add("nothing to learn from");
            None
        }
        Err(error) => panic!("learn: {error} ({error:?})"),
    }
}

fn compare<B>(
    scene: &Scene,
    learned: &LearnedModel<Plain, B>,
    expected: &Expected,
    matrix: &Matrix,
    pseudo: f64,
) where
    B: LearnLikelihood,
{
    let model = learned.model();
    if pseudo == 0.0 {
        let found = learned.objectives()[0];
        close::log("first objective", found, expected.log_likelihood, expected.size);
    }
    let prior = model.prior().belief().as_slice();
    distribution("prior", prior, &scene.prior, &expected.first, pseudo);
    for from in 0..scene.states {
        let column = |rows: &Matrix| rows.iter().map(|row| row[from]).collect::<Vec<f64>>();
        let mut found = vec![0.0; scene.states];
        model.transition().outgoing(&(), from).for_each(|(to, p)| found[to] = p);
        let operator = model.transition();
        let learned = operator.counts(&mut operator.statistics(), &()).is_some();
        let seen = if learned { column(&expected.moves) } else { vec![0.0; scene.states] };
        let pseudo = if learned { pseudo } else { 0.0 };
        distribution("column", &found, &column(matrix), &seen, pseudo);
    }
}

/// Maximum of the likelihood of counts, with a pseudo-count for entries above 0.
fn distribution(what: &str, found: &[f64], old: &[f64], seen: &[f64], pseudo: f64) {
    let weight = |(old, seen): (&f64, &f64)| if *old > 0.0 { seen + pseudo } else { 0.0 };
    let weights: Vec<f64> = old.iter().zip(seen).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 && sum < LEAST_SEEN {
        return;
    }
    for (i, found) in found.iter().enumerate() {
        let expected = if sum > 0.0 { weights[i] / sum } else { old[i] };
        close::number(what, *found, expected, 1e-8);
    }
}
