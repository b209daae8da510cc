//! Dwell times: stays in a place with any distribution of steps.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::likelihood::GroupedLikelihood;
use wayfix::transition::DwellTransition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition, TableLikelihood};

use crate::kit::{
    Expected, Matrix, any_distribution, assert_operator, cases, close, dense, dwell, rate, rng,
    sparse, still, stochastic, text,
};

/// Probabilities of leaving from those of the number of steps.
fn hazards(dwell: &[f64]) -> Vec<f64> {
    let last = dwell.iter().rposition(|p| *p > 0.0).unwrap();
    (0..=last)
        .map(|c| if c == last { 1.0 } else { dwell[c] / dwell[c..].iter().sum::<f64>() })
        .collect()
}

/// A place graph with dwell times for each place.
fn dwelling() -> impl Strategy<Value = (Matrix, Vec<Vec<f64>>)> {
    (1..=4_usize).prop_flat_map(|n| (stochastic(false, n), vec(any_distribution(false, 4), n)))
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn dwell_times((moves, times) in dwelling()) {
        let a = DwellTransition::new(sparse(&moves), &times).unwrap();
        let leaving: Vec<_> = times.iter().map(|times| hazards(times)).collect();
        assert_operator(a, &dwell(&moves, &leaving))?;
    }

    #[test]
    fn leaving_probabilities(
        (exact, (moves, leaving)) in any::<bool>().prop_flat_map(|e| {
            let places = (1..=4_usize)
                .prop_flat_map(move |n| (stochastic(e, n), vec(vec(rate(e), 1..4), n)));
            (Just(e), places)
        }),
    ) {
        let a = DwellTransition::from_leaving(dense(&moves), &leaving).unwrap();
        // Leaving for the same place and staying may not add up to a power of two.
        let sums = leaving.iter().any(|leaving| leaving.len() == 1);
        let expected = dwell(&moves, &leaving);
        assert_operator(a, Expected::constant(&expected).with_exact_ties(exact && !sums))?;
    }

    /// Against sums over all segmentations of a drive into stays, with dwell times and moves as
    /// given, without hazards or expansion.
    #[test]
    fn dwell_times_are_those_of_a_semi_markov_chain(
        ((moves, times), logs) in (dwelling(), vec(vec(-3.0..0.0, 4), 1..5)),
        start in 0..4_usize,
    ) {
        let n = moves.len();
        let start = start % n;
        let b: Vec<Vec<f64>> = logs.iter().map(|logs: &Vec<f64>| logs[..n].iter().map(|l| l.exp()).collect()).collect();
        let chain = Stays { moves: &moves, times: &times, b: &b };
        let mut total = Sums { sum: 0.0, best: 0.0, at: vec![vec![0.0; n]; b.len()] };
        chain.walk(start, 0, 1.0, &mut Vec::new(), &mut total);

        let a = DwellTransition::new(sparse(&moves), &times).unwrap();
        let groups = a.groups().clone();
        let places = Belief::certain(n, start).unwrap();
        let prior = Prior::AtFirstObservation(a.arriving(&places).unwrap());
        prop_assert_eq!(prior.belief().mode(), a.arrival(start).unwrap());
        let sensor = LikelihoodVector::linear(n).owned();
        let hmm = Hmm::new(prior, a, GroupedLikelihood::new(sensor, groups.clone()).unwrap()).unwrap();
        let smoothing = hmm.smooth(&b).unwrap();
        close(smoothing.log_likelihood().exp(), total.sum, 1e-11, f64::MIN_POSITIVE)?;
        for (k, expected) in total.at.iter().enumerate() {
            let found = groups.marginal(&smoothing.posteriors().get(k + 1).unwrap()).unwrap();
            for (found, expected) in found.as_slice().iter().zip(expected) {
                prop_assert!((found - expected / total.sum).abs() <= 1e-11);
            }
        }
        let path = hmm.viterbi(&b).unwrap();
        close(path.log_probability().exp(), total.best, 1e-11, f64::MIN_POSITIVE)?;
        prop_assert_eq!(groups.map_path(path.states()).unwrap()[0], start);
    }
}

/// A semi-Markov chain and its observations.
struct Stays<'a> {
    moves: &'a Matrix,
    times: &'a [Vec<f64>],
    b: &'a [Vec<f64>],
}

struct Sums {
    sum: f64,
    best: f64,
    /// The joint probability of each place at each step.
    at: Vec<Vec<f64>>,
}

impl Stays<'_> {
    /// Every stay that begins in `place` after `seen` steps, and what follows.
    fn walk(&self, place: usize, seen: usize, p: f64, path: &mut Vec<usize>, total: &mut Sums) {
        let left = self.b.len() - seen;
        let times = &self.times[place];
        let b = |steps: usize| self.b[seen..seen + steps].iter().map(|b| b[place]).product::<f64>();
        // A stay that outlasts the observations, or ends with them.
        let longer: f64 = times.iter().skip(left - 1).sum();
        let whole = p * longer * b(left);
        path.resize(self.b.len(), place);
        total.sum += whole;
        total.best = total.best.max(whole);
        path.iter().zip(&mut total.at).for_each(|(&place, at)| at[place] += whole);
        for steps in 1..left {
            let stayed = p * times.get(steps - 1).copied().unwrap_or(0.0) * b(steps);
            for (next, row) in self.moves.iter().enumerate() {
                if stayed * row[place] > 0.0 {
                    path.truncate(seen);
                    path.resize(seen + steps, place);
                    self.walk(next, seen + steps, stayed * row[place], path, total);
                }
            }
        }
    }
}

#[test]
fn bad_dwell_times_are_named() {
    let dwell = |times: &[Vec<f64>]| text(DwellTransition::new(still(2), times));
    assert_eq!(
        dwell(&[vec![1.0]]),
        "the dwell table has 1 states, expected 2 to match the inner operator"
    );
    assert_eq!(
        dwell(&[vec![1.0], vec![0.5, 0.25]]),
        "the sum of the dwell times of place 1 is 0.75, expected 1"
    );
    assert_eq!(
        dwell(&[vec![], vec![1.0]]),
        "the sum of the dwell times of place 0 is 0, expected 1"
    );
    assert_eq!(
        dwell(&[vec![1.0], vec![0.5, f64::INFINITY]]),
        "the probability of 2 steps in place 1 is inf, expected a finite value of at least 0"
    );
    let leaving = |leaving: &[Vec<f64>]| text(DwellTransition::from_leaving(still(2), leaving));
    assert_eq!(
        leaving(&[vec![0.5], vec![]]),
        "the number of leaving probabilities of place 1 is 0, expected at least 1"
    );
    assert_eq!(
        leaving(&[vec![0.5], vec![0.5, 1.5]]),
        "the probability of leaving place 1 after 2 steps is 1.5, expected a value from 0 to 1"
    );
    let a = DwellTransition::new(still(2), &[vec![1.0], vec![0.5, 0.5]]).unwrap();
    assert_eq!((a.arrival(1), a.arrival(2)), (Some(1), None));
    assert_eq!(
        text(a.arriving(&Belief::uniform(3).unwrap())),
        "the number of places of the belief is 3, expected 2"
    );
}

#[test]
fn simulations_stay_as_long_as_they_should() {
    let moves = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]]).unwrap();
    let a = DwellTransition::new(moves, &[vec![0.0, 0.0, 1.0], vec![1.0]]).unwrap();
    let prior = Prior::AtFirstObservation(a.arriving(&Belief::certain(2, 0).unwrap()).unwrap());
    let groups = a.groups().clone();
    let camera = TableLikelihood::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap();
    let sensor = GroupedLikelihood::new(camera, groups.clone()).unwrap();
    let drive = Hmm::new(prior, a, sensor).unwrap().simulate(8, &mut rng(1));
    let places = [0, 0, 0, 1, 0, 0, 0, 1];
    assert_eq!(groups.map_path(drive.states()).unwrap(), places);
    assert_eq!(drive.observations(), places);
}
