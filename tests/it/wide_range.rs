//! Bounds of pruned tracking and beams if likelihoods of a step are further apart than the range of
//! doubles, against exact results in logarithms.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix::inference::{Certificate, Pruning};
use wayfix::likelihood::{GroupedLikelihood, Groups, LocalLikelihood};
use wayfix::{Belief, FusedLikelihood, Hmm, HmmError, LikelihoodVector, Prior, Transition};

use crate::kit::{Matrix, NEVER, cases, log_sum, prior, sparse, still, transposed, weighted};

/// A model in logarithms, and observations of it by two sensors.
#[derive(Debug, Clone)]
struct Case {
    at_first: bool,
    prior: Vec<f64>,
    /// `None` for the identity.
    matrix: Option<Matrix>,
    /// Log-likelihoods of each sensor, at each step.
    seen: Vec<(Vec<f64>, Vec<f64>)>,
}

/// Exact results: log-probabilities of the states, ln p(y_1 … y_k), and that of the best path to
/// each state.
struct Exact {
    belief: Vec<f64>,
    log: f64,
    best: Vec<f64>,
}

impl Case {
    fn ways(&self, k: usize, to: usize) -> Vec<f64> {
        let stands = (k == 0 && self.at_first) || self.matrix.is_none();
        let p = |from: usize| match &self.matrix {
            Some(matrix) if !stands => matrix[to][from],
            _ => f64::from(to == from),
        };
        (0..self.prior.len()).map(|from| p(from).ln()).collect()
    }

    /// Exact results of each step up to the first impossible one; `seen` has the observations of
    /// all sensors.
    fn exact(&self, seen: &[Vec<f64>]) -> Vec<Exact> {
        let n = self.prior.len();
        let mut belief: Vec<f64> = self.prior.iter().map(|p| p.ln()).collect();
        let (mut best, mut log, mut all) = (Vec::new(), 0.0, Vec::new());
        for (k, b) in seen.iter().enumerate() {
            let into = |x: &[f64], i: usize| {
                let ways = self.ways(k, i);
                (0..n).map(|j| ways[j] + x[j]).collect::<Vec<f64>>()
            };
            let joint: Vec<f64> =
                (0..n).map(|i| log_sum(into(&belief, i).into_iter()) + b[i]).collect();
            best = if k == 0 {
                joint.clone() // X_0 is summed over
            } else {
                (0..n).map(|i| into(&best, i).into_iter().fold(NEVER, f64::max) + b[i]).collect()
            };
            let sum = log_sum(joint.iter().copied());
            if sum == NEVER {
                break;
            }
            belief = joint.iter().map(|x| x - sum).collect();
            log += sum;
            all.push(Exact { belief: belief.clone(), log, best: best.clone() });
        }
        all
    }

    fn check<B: LocalLikelihood<Observation: Sized>>(
        &self,
        sensor: B,
        seen: &[B::Observation],
        logs: &[Vec<f64>],
        (pruning, width): (Pruning, f64),
    ) -> TestCaseResult {
        let n = self.prior.len();
        let motion = self.matrix.as_ref().map_or_else(|| still(n), sparse);
        let hmm = Hmm::new(prior(&self.prior, self.at_first), motion, sensor).unwrap();
        let exact = self.exact(logs);
        let mut filter = hmm.pruned_filter(pruning);
        for (k, y) in seen.iter().enumerate() {
            match (filter.step(y), exact.get(k)) {
                (Ok(certificate), Some(exact)) => {
                    let apart = |i: usize| exact.belief[i].exp() - filter.probability(i).unwrap();
                    let distance = 0.5 * (0..n).map(|i| apart(i).abs()).sum::<f64>();
                    let bound = certificate.bound();
                    prop_assert!(distance <= bound + 1e-9, "{}: {distance:e}, {bound:e}", k + 1);
                    let (range, off) = (filter.log_likelihood(), 1e-9 * (1.0 + exact.log.abs()));
                    let within = range.start() - off <= exact.log && exact.log <= range.end() + off;
                    prop_assert!(within, "{}: {} in {range:?}", k + 1, exact.log);
                }
                (Err(HmmError::Impossible { step }), None) => {
                    prop_assert_eq!(step, k + 1);
                    break;
                }
                (Err(HmmError::Pruned { .. }), _) => break,
                (found, exact) => {
                    prop_assert!(false, "{found:?}, possible: {}", exact.is_some());
                }
            }
        }
        let best = exact.get(seen.len() - 1).map(|last| last.best.iter().copied());
        let best = best.map(|scores| scores.fold(NEVER, f64::max));
        match (hmm.beam_viterbi(seen, width), best) {
            (Ok(found), Some(best)) => {
                let (log, off) = (found.path().log_probability(), 1e-9 * (1.0 + best.abs()));
                prop_assert!(log <= best + off && best <= found.upper_bound() + off);
                prop_assert!(!found.is_optimal() || (log - best).abs() <= off, "{log} {best}");
            }
            (Err(HmmError::Impossible { step }), None) => {
                prop_assert_eq!(step, exact.len() + 1);
            }
            (Err(HmmError::Pruned { .. }), _) => prop_assert!(width < f64::INFINITY),
            (found, best) => prop_assert!(false, "{found:?}, {best:?}"),
        }
        Ok(())
    }
}

fn drives() -> impl Strategy<Value = Case> {
    (2..=6_usize, 1..=8_usize, any::<bool>()).prop_flat_map(|(n, steps, at_first)| {
        let weight =
            || prop_oneof![2 => Just(0.0), 1 => Just(1e-12), 1 => Just(1e-290), 3 => 0.01..1.0];
        let columns = vec(weighted(weight(), n), n).prop_map(|columns| Some(transposed(&columns)));
        let matrix = prop_oneof![1 => Just(None), 2 => columns];
        let spread = prop_oneof![Just(10.0), Just(700.0), Just(750.0), Just(1500.0), Just(1e5)];
        let logs = spread.prop_flat_map(move |most| {
            let log = prop_oneof![
                1 => Just(NEVER), 1 => Just(0.0), 1 => Just(-most), 4 => -most..0.0
            ];
            vec((vec(log.clone(), n), vec(log, n)), steps)
        });
        (weighted(weight(), n), matrix, logs).prop_map(move |(prior, matrix, seen)| Case {
            at_first,
            prior,
            matrix,
            seen,
        })
    })
}

fn limits() -> impl Strategy<Value = (Pruning, f64)> {
    let tolerance = prop_oneof![Just(0.0), Just(1e-9), Just(1e-3), Just(1.0)];
    let most_active = prop_oneof![1 => Just(usize::MAX), 1 => 1..=4_usize];
    let width = prop_oneof![Just(0.0), Just(5.0), Just(800.0), Just(f64::INFINITY)];
    (tolerance, most_active, width).prop_map(|(tolerance, most_active, width)| {
        (Pruning::default().with_tolerance(tolerance).with_most_active(most_active), width)
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn of_logarithms_what_is_proven_is_true(case in drives(), limits in limits()) {
        let logs: Vec<_> = case.seen.iter().map(|seen| seen.0.clone()).collect();
        let sensor = LikelihoodVector::log(case.prior.len()).owned();
        case.check(sensor, &logs, &logs, limits)?;
    }

    #[test]
    fn of_numbers_what_is_proven_is_true(case in drives(), limits in limits()) {
        // From 1e-324 to 1e304.
        let exp = |seen: &(Vec<f64>, _)| seen.0.iter().map(|log| (log + 700.0).exp()).collect();
        let seen: Vec<Vec<f64>> = case.seen.iter().map(exp).collect();
        let ln = |b: &Vec<f64>| b.iter().map(|b| b.ln()).collect();
        let logs: Vec<Vec<f64>> = seen.iter().map(ln).collect();
        case.check(LikelihoodVector::linear(case.prior.len()).owned(), &seen, &logs, limits)?;
    }

    #[test]
    fn of_two_sensors_what_is_proven_is_true(case in drives(), limits in limits()) {
        let n = case.prior.len();
        let exp = |logs: &[f64]| logs.iter().map(|log| log.exp()).collect::<Vec<f64>>();
        for both_linear in [false, true] {
            let second = |logs: &[f64]| if both_linear { exp(logs) } else { logs.to_vec() };
            let seen = case.seen.iter().map(|(a, b)| (exp(a), second(b)));
            let seen: Vec<(Vec<f64>, Vec<f64>)> = seen.collect();
            let sum = |(a, b): &(Vec<f64>, Vec<f64>)| {
                let log = |b: f64| if both_linear { b.ln() } else { b };
                a.iter().zip(b).map(|(a, b)| a.ln() + log(*b)).collect()
            };
            let logs: Vec<Vec<f64>> = seen.iter().map(sum).collect();
            let (linear, log) = (LikelihoodVector::linear(n), LikelihoodVector::log(n));
            let second = if both_linear { linear } else { log };
            let sensor = FusedLikelihood::new(linear.owned(), second.owned()).unwrap();
            case.check(sensor, &seen, &logs, limits)?;
        }
    }
}

/// Two places without moves between them.
fn two_places(prior: [f64; 2]) -> Hmm<wayfix::SparseTransition, LikelihoodVector> {
    let prior = crate::kit::prior(&prior, true);
    Hmm::new(prior, still(2), LikelihoodVector::log(2)).unwrap()
}

#[test]
fn what_was_dropped_by_underflow_is_in_the_bound() {
    let hmm = two_places([0.5, 0.5]);
    let seen = [[0.0, -800.0], [-700.0, 0.0], [-700.0, 0.0]];
    let mut filter = hmm.pruned_filter(Pruning::default());
    let last = seen.iter().map(|y| filter.step(y).unwrap()).last().unwrap();
    // The truth is the other place: it has -800 to -1400.
    assert_eq!(hmm.forward(&seen).unwrap().posteriors().modes(), [0, 0, 1]);
    assert!(matches!(last, Certificate::Exceeded(bound) if bound > 0.999), "{last:?}");
    assert!(filter.log_likelihood().contains(&(0.5_f64.ln() - 800.0)));
    let found = hmm.beam_viterbi(&seen, 1000.0).unwrap();
    assert!(found.is_unrivalled());
    assert_eq!(found.path(), &hmm.viterbi(&seen).unwrap());
    let found = hmm.beam_viterbi(&seen, 10.0).unwrap();
    assert!(!found.is_optimal() && found.upper_bound() >= 0.5_f64.ln() - 800.0);
}

#[test]
fn what_the_sensor_speaks_against_is_not_impossible() {
    // The belief leads to one place only, and the sensor names the other.
    let hmm = two_places([1.0, 0.0]);
    let mut filter = hmm.pruned_filter(Pruning::default());
    for k in 1..=3 {
        let bound = filter.step(&[-5000.0, 0.0]).unwrap().bound();
        assert!(bound < 1e-12, "{bound:e}");
        let range = filter.log_likelihood();
        assert!((range.start() + 5000.0 * f64::from(k)).abs() < 1e-9, "{range:?}");
        assert!((range.end() + 5000.0 * f64::from(k)).abs() < 1e-9, "{range:?}");
    }
}

#[test]
fn a_scale_that_underflows_has_a_logarithm() {
    // Only a place with 1e-280 of the belief is left, at 1e-40.
    let prior = [1.0 - 1e-280, 1e-280, 0.0];
    let hmm = Hmm::new(crate::kit::prior(&prior, true), still(3), LikelihoodVector::linear(3));
    let hmm = hmm.unwrap();
    let mut filter = hmm.pruned_filter(Pruning::default().with_tolerance(0.0));
    filter.step(&[0.0, 1e-40, 1.0]).unwrap();
    let (range, expected) = (filter.log_likelihood(), 1e-280_f64.ln() + 1e-40_f64.ln());
    assert!((range.start() - expected).abs() < 1e-9, "{range:?}");
    assert!((range.end() - expected).abs() < 1e-9, "{range:?}");
    assert!((expected + 736.8).abs() < 0.1);
}

#[test]
fn a_prior_and_a_move_beyond_a_double_are_a_way() {
    // 1e-300 of the prior moves with 1e-300, and only that place is possible.
    let prior = Belief::new(vec![1.0 - 1e-300, 1e-300, 0.0]).unwrap();
    let matrix = [[1.0, 0.0, 0.0], [0.0, 1.0 - 1e-300, 0.0], [0.0, 1e-300, 1.0]];
    let motion = wayfix::SparseTransition::from_rows(&matrix).unwrap();
    let prior = wayfix::Prior::BeforeFirstTransition(prior);
    let hmm = Hmm::new(prior, motion, LikelihoodVector::linear(3)).unwrap();
    let found = hmm.beam_viterbi(&[[0.0, 0.0, 1.0]], 0.0).unwrap();
    assert!((found.path().log_probability() - 2.0 * 1e-300_f64.ln()).abs() < 1e-9);
    assert!(found.is_unrivalled());
}

/// An operator that stays, and reports that its entries need no lift.
struct Stay(usize);

impl Transition for Stay {
    type Control = ();
    fn states(&self) -> usize {
        self.0
    }
    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(x);
    }
    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(x);
    }
    fn smallest_entry(&self, (): &()) -> f64 {
        1.0
    }
}

/// With rounded tails, only values below 2.2e-308 become 0, also in a step block by block.
#[test]
fn rounded_tails_of_groups_reach_as_far() {
    let small = 2.0_f64.powi(-800);
    let prior = Prior::BeforeFirstTransition(Belief::new(vec![1.0 - small, small]).unwrap());
    let groups = Groups::new(vec![0, 0]).unwrap();
    let sensor = GroupedLikelihood::new(LikelihoodVector::linear(1), groups).unwrap();
    let hmm = Hmm::new(prior, Stay(2), sensor).unwrap().with_rounded_tails();
    let mut filter = hmm.filter();
    filter.step(&[2.0_f64.powi(-300)][..]).unwrap();
    assert_eq!(filter.belief().as_slice()[1], small);
}
