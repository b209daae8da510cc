//! The pruned filter against the exact one: the bound that it proves holds, and it
//! leaves out nothing that it must not.

use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::{
    Belief, Certificate, Fixed, FusedLikelihood, Hmm, InferenceError, KnownState, Likelihood,
    LikelihoodVector, LocalLikelihood, OptionalLikelihood, Prior, PrunedFilter, Pruning,
    RoundedTails, Scratch, SparseLikelihood, SparseObservation, SparseTransition, TableLikelihood,
    canberra,
};

/// A model of a few states, and what is seen of it: an optional symbol, and a list.
#[derive(Debug, Clone)]
struct Case {
    states: usize,
    at_first: bool,
    prior: Vec<f64>,
    /// `columns[from]` is where it leads.
    columns: Vec<Vec<f64>>,
    /// `table[state][symbol]`.
    table: Vec<Vec<f64>>,
    seen: Vec<(Option<usize>, SparseObservation)>,
    pruning: Pruning,
}

type Sensor = FusedLikelihood<OptionalLikelihood<TableLikelihood>, SparseLikelihood>;

impl Case {
    fn prior(&self) -> Prior {
        let belief = Belief::new(self.prior.clone()).unwrap();
        if self.at_first {
            Prior::AtFirstObservation(belief)
        } else {
            Prior::BeforeFirstTransition(belief)
        }
    }

    fn hmm(&self) -> Hmm<SparseTransition, Sensor> {
        let entries = self.columns.iter().enumerate();
        let entries = entries.flat_map(|(from, column)| {
            column.iter().enumerate().map(move |(to, p)| (to, from, *p))
        });
        let motion = SparseTransition::from_triplets(self.states, entries).unwrap();
        let camera = OptionalLikelihood::new(TableLikelihood::from_rows(&self.table).unwrap());
        let sensor = FusedLikelihood::new(camera, SparseLikelihood::new(self.states)).unwrap();
        Hmm::new(self.prior(), motion, sensor).unwrap()
    }

    fn prunes(&self) -> bool {
        self.pruning.tolerance > 0.0 || self.pruning.most_active < self.states
    }

    fn likelihood(&self, k: usize, i: usize) -> f64 {
        let (symbol, list) = &self.seen[k];
        let listed = list.listed().iter().find(|entry| entry.0 == i).map(|entry| entry.1);
        symbol.map_or(1.0, |y| self.table[i][y]) * listed.unwrap_or(list.elsewhere())
    }

    /// The exact beliefs and log-likelihoods, up to the first impossible step.
    fn exact(&self) -> Vec<(Vec<f64>, f64)> {
        let n = self.states;
        let (mut belief, mut log, mut all) = (self.prior.clone(), 0.0, Vec::new());
        for k in 0..self.seen.len() {
            let moved = |i: usize| (0..n).map(|j| self.columns[j][i] * belief[j]).sum();
            let predicted: Vec<f64> =
                if k == 0 && self.at_first { belief.clone() } else { (0..n).map(moved).collect() };
            let joint: Vec<f64> = (0..n).map(|i| self.likelihood(k, i) * predicted[i]).collect();
            let sum: f64 = joint.iter().sum();
            if sum == 0.0 {
                break;
            }
            belief = joint.iter().map(|p| p / sum).collect();
            log += sum.ln();
            all.push((belief.clone(), log));
        }
        all
    }
}

fn weight() -> impl Strategy<Value = f64> {
    prop_oneof![4 => Just(0.0), 3 => 0.05..1.0, 1 => Just(1e-6), 1 => Just(1e-12)]
}

fn normal(mut weights: Vec<f64>, spare: usize) -> Vec<f64> {
    if weights.iter().all(|w| *w == 0.0) {
        let spare = spare % weights.len();
        weights[spare] = 1.0;
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

fn cases() -> impl Strategy<Value = Case> {
    (2..=9_usize, 1..=25_usize, 1..=3_usize).prop_flat_map(|(n, steps, symbols)| {
        let distribution =
            move |n| (vec(weight(), n), 0..n).prop_map(|(weights, spare)| normal(weights, spare));
        let list = (vec((0..n, weight()), 0..=n), prop_oneof![1 => Just(0.0), 4 => 1e-3..1.0]);
        let list = list.prop_map(|(mut listed, elsewhere)| {
            listed.sort_by_key(|entry| entry.0);
            listed.dedup_by_key(|entry| entry.0);
            SparseObservation::new(listed, elsewhere).unwrap()
        });
        let symbol = prop_oneof![1 => Just(None), 3 => (0..symbols).prop_map(Some)];
        let tolerance = prop_oneof![Just(0.0), Just(1e-12), Just(1e-3), Just(1.0), Just(1e8)];
        let most_active = prop_oneof![1 => Just(usize::MAX), 2 => 1..=n];
        (
            any::<bool>(),
            distribution(n),
            vec(distribution(n), n),
            vec(distribution(symbols), n),
            vec((symbol, list), steps),
            (tolerance, most_active),
        )
            .prop_map(move |(at_first, prior, columns, table, seen, pruning)| {
                let (tolerance, most_active) = pruning;
                let pruning = Pruning { tolerance, most_active };
                Case { states: n, at_first, prior, columns, table, seen, pruning }
            })
    })
}

fn distance<M, A, B>(pruned: &PrunedFilter<M>, exact: &[f64]) -> f64
where
    M: std::ops::Deref<Target = Hmm<A, B>>,
    A: wayfix::TransitionEntries<Control = ()>,
    B: LocalLikelihood,
{
    let difference = |(i, p): (usize, &f64)| (p - pruned.probability(i).unwrap()).abs();
    0.5 * exact.iter().enumerate().map(difference).sum::<f64>()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2500) })]

    #[test]
    fn the_bound_holds_at_each_step(case in cases()) {
        let hmm = case.hmm();
        let mut pruned = hmm.pruned_filter(case.pruning);
        let exact = case.exact();
        for (k, seen) in case.seen.iter().enumerate() {
            let before = (pruned.active().to_vec(), pruned.probabilities().to_vec());
            let step = pruned.step(seen);
            let Some((belief, log)) = exact.get(k) else {
                // What is impossible is never taken for possible.
                let impossible = InferenceError::Impossible { step: k + 1 }.to_string();
                let dropped = InferenceError::Pruned { step: k + 1 }.to_string();
                let error = step.unwrap_err().to_string();
                prop_assert!(error == impossible || error == dropped, "{}", error);
                prop_assert!(case.prunes() || error == impossible);
                break;
            };
            match step {
                Ok(certificate) => {
                    let (found, bound) = (distance(&pruned, belief), certificate.bound());
                    prop_assert!(found <= bound + 1e-14, "step {}: {found:e} > {bound:e}", k + 1);
                    prop_assert!((0.0..=1.0).contains(&bound));
                    prop_assert_eq!(certificate.holds(), bound <= case.pruning.tolerance);
                    prop_assert_eq!(certificate, pruned.certificate());
                    let range = pruned.log_likelihood();
                    prop_assert!(
                        range.start() - 1e-10 <= *log && *log <= range.end() + 1e-10,
                        "step {}: {log} in {range:?}", k + 1
                    );
                    let sum: f64 = pruned.probabilities().iter().sum();
                    prop_assert!((sum - 1.0).abs() < 1e-14);
                    prop_assert!(pruned.active().is_sorted_by(|a, b| a < b));
                    prop_assert!(pruned.active().len() <= case.pruning.most_active);
                    prop_assert_eq!(pruned.steps(), k + 1);
                }
                Err(error) => {
                    // The observation is possible, so this must not be denied.
                    let expected = InferenceError::Pruned { step: k + 1 }.to_string();
                    prop_assert_eq!(error.to_string(), expected);
                    prop_assert!(case.prunes());
                    prop_assert_eq!(pruned.active(), before.0);
                    prop_assert_eq!(pruned.probabilities(), before.1);
                    prop_assert_eq!(pruned.steps(), k);
                    break;
                }
            }
        }
    }

    #[test]
    fn without_tolerance_it_is_the_exact_filter(case in cases()) {
        let hmm = case.hmm();
        let mut exact = hmm.filter();
        let mut pruned = hmm.pruned_filter(Pruning { tolerance: 0.0, ..Pruning::default() });
        for seen in &case.seen {
            match exact.step(seen) {
                Ok(_) => {
                    let bound = pruned.step(seen).unwrap().bound();
                    prop_assert!(bound < 1e-12, "{bound:e}");
                    for (i, p) in exact.belief().as_slice().iter().enumerate() {
                        let found = pruned.probability(i).unwrap();
                        prop_assert!((found - p).abs() <= 1e-12 * p, "{i}: {found:e}, {p:e}");
                    }
                    let range = pruned.log_likelihood();
                    let log = exact.log_likelihood();
                    prop_assert!((range.start() - log).abs() <= 1e-11 * (1.0 + log.abs()));
                    prop_assert!((range.end() - log).abs() <= 1e-11 * (1.0 + log.abs()));
                    let largest = exact.belief().as_slice().iter().copied().fold(0.0, f64::max);
                    prop_assert!(pruned.probability(pruned.mode()).unwrap() >= largest * (1.0 - 1e-12));
                }
                Err(error) => {
                    let found = pruned.step(seen).unwrap_err();
                    prop_assert_eq!(found.to_string(), error.to_string());
                }
            }
        }
    }
}
