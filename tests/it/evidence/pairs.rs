//! Evidence on the moves of two chains side by side: products leave the range of doubles though no
//! factor does.

use wayfix::inference::Pruning;
use wayfix::transition::{EvidenceTransition, KroneckerTransition};
use wayfix::{
    Belief, Controlled, DenseTransition, Hmm, LikelihoodVector, Prior, TransitionEntries,
};

use crate::kit::{NEVER, close_logs, log_sum, rng};

type Both = KroneckerTransition<Measured, Measured>;
type Measured = EvidenceTransition<DenseTransition, (), fn(&(), usize, usize) -> f64>;

/// A chain of one or two states with equally probable moves, and a likelihood of moves.
fn chain(states: usize, log: fn(&(), usize, usize) -> f64) -> Measured {
    let all = DenseTransition::from_fn(states, |_, _| 1.0 / states as f64).unwrap();
    EvidenceTransition::new(all, log).unwrap()
}

fn pair(first: Measured, second: Measured, prior: Prior) -> Hmm<Both, LikelihoodVector<Vec<f64>>> {
    let both = KroneckerTransition::new(first, second).unwrap();
    let sensor = LikelihoodVector::log(prior.belief().states()).owned();
    Hmm::new(prior, both, sensor).unwrap()
}

/// The pruned filter and the beam agree with filter and decoder.
fn proven<A: TransitionEntries<Control = ()>>(
    hmm: &Hmm<A, LikelihoodVector<Vec<f64>>>,
    seen: &[Vec<f64>],
) {
    let drive = Controlled::new(&[()], seen).unwrap();
    let (exact, path) = (hmm.forward(&drive).unwrap(), hmm.viterbi(&drive).unwrap());
    let mut pruned = hmm.pruned_filter(Pruning::default().with_tolerance(0.0));
    let bound = pruned.step_with(&(), &seen[0]).unwrap().bound();
    let belief = exact.posteriors().get(1).unwrap();
    for (state, p) in belief.as_slice().iter().enumerate() {
        assert!((pruned.probability(state).unwrap() - p).abs() <= bound + 1e-14, "{bound:e}");
    }
    let (range, log) = (pruned.log_likelihood(), exact.log_likelihood());
    assert!(range.start() - 1e-9 <= log && log <= range.end() + 1e-9, "{log} in {range:?}");
    let beam = hmm.beam_viterbi(&drive, f64::INFINITY).unwrap();
    assert_eq!(beam.path().states(), path.states());
    close_logs(beam.path().log_probability(), path.log_probability(), 1e-12).unwrap();
}

#[test]
fn products_of_evidence_below_doubles_are_not_lost() {
    let before = |states| Prior::BeforeFirstTransition(Belief::uniform(states).unwrap());
    // e^-200 each, and e^-600 more into state 1, which the sensor names.
    let first = chain(2, |(), to, _| if to == 1 { -600.0 } else { 0.0 });
    proven(&pair(first, chain(1, |(), _, _| -200.0), before(2)), &[vec![-1000.0, 0.0]]);
    let rare = || chain(2, |(), to, _| if to == 1 { -400.0 } else { 0.0 });
    let seen = [vec![-1000.0, -1000.0, -1000.0, 0.0]];
    proven(&pair(rare(), rare(), before(4)), &seen);
    // All moves: nothing is impossible.
    let rare = || chain(1, |(), _, _| -400.0);
    proven(&pair(rare(), rare(), before(1)), &[vec![0.0]]);
    let often = || chain(1, |(), _, _| 400.0);
    proven(&pair(often(), often(), before(1)), &[vec![0.0]]);
}

#[test]
fn paths_through_products_of_evidence_are_drawn_and_have_their_entropy() {
    type Logs = fn(&(), usize, usize) -> f64;
    let cases: [(Logs, [f64; 2], [[f64; 2]; 2]); 3] = [
        (
            |(), to, from| [[-600.0, -200.0], [-400.0, 0.0]][to][from],
            [1.0, 0.0],
            [[0.0, -600.0], [-300.0, -600.0]],
        ),
        (|(), _, from| [0.0, -600.0][from], [0.5, 0.5], [[-600.0, 0.0], [-300.0, -600.0]]),
        (
            |(), to, from| [[-400.0, NEVER], [-400.0, -700.0]][to][from],
            [0.5, 0.5],
            [[-600.0, -300.0], [0.0, 0.0]],
        ),
    ];
    for (log, p, seen) in cases {
        let prior = Prior::AtFirstObservation(Belief::new(p.to_vec()).unwrap());
        let hmm = pair(chain(2, log), chain(1, |(), _, _| -200.0), prior);
        let drive = seen.map(|logs| logs.to_vec());
        let drive = Controlled::new(&[(), ()], &drive).unwrap();
        // All four paths.
        let paths = [(0, 0), (0, 1), (1, 0), (1, 1)];
        let score = |(j, i): (usize, usize)| p[j].ln() + seen[0][j] + log(&(), i, j) + seen[1][i];
        let total = log_sum(paths.into_iter().map(score));
        let logs = paths.map(|path| score(path) - total);
        let entropy: f64 =
            logs.iter().filter(|log| log.exp() > 0.0).map(|log| -log.exp() * log).sum();
        let found = hmm.path_entropy(&drive).unwrap();
        assert!((found - entropy).abs() < 1e-9, "{found}, expected {entropy}");
        let path = hmm.path_sampler(&drive).unwrap().draw(&mut rng(1)).unwrap();
        assert!(score((path[0], path[1])) > NEVER);
    }
}
