//! States of streams.

use crate::kit::{json, stored};
use proptest::prelude::*;
use wayfix::inference::{OnlineViterbiSnapshot, PrunedFilterSnapshot, Pruning};
use wayfix::{OptionalLikelihood, SparseLikelihood, SparseTransition, TableLikelihood};

use crate::kit::{Kind, cases, damage, models};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn decoders_and_pruned_filters_are_the_same_to_the_bit(
        model in models(Kind::Extreme),
        tolerance in prop_oneof![Just(0.0), Just(1e-3), Just(f64::INFINITY)],
        most_active in prop_oneof![Just(2), Just(usize::MAX)],
    ) {
        let hmm = model.hmm(model.sparse());
        let mut decoder = hmm.online_viterbi();
        for k in 0..model.steps() {
            let snapshot = decoder.snapshot();
            prop_assert_eq!(&stored(&snapshot), &snapshot);
            if decoder.step_with(&k, &model.logs[k]).is_err() {
                break;
            }
        }
        let n = model.states;
        let sensor = TableLikelihood::from_rows(&vec![[0.5, 0.25, 0.25]; n]).unwrap();
        let moves = (0..n).map(|j| ((j + 1) % n, j, 1.0));
        let motion = SparseTransition::from_triplets(n, moves).unwrap();
        let hmm = wayfix::Hmm::new(model.prior(), motion, sensor).unwrap();
        let mut filter = hmm.pruned_filter(Pruning::default().with_tolerance(tolerance).with_most_active(most_active));
        for y in [0, 1, 2, 1] {
            filter.step(&y).unwrap();
            let snapshot = filter.snapshot();
            prop_assert_eq!(&stored(&snapshot), &snapshot);
        }
        let mut other = hmm.pruned_filter(Pruning::default());
        other.restore(&stored(&filter.snapshot())).unwrap();
        prop_assert_eq!(other.step(&0).unwrap(), filter.step(&0).unwrap());
        prop_assert_eq!(json(&other.snapshot()), json(&filter.snapshot()));
    }

    /// Any change to a stored state gives an error, or a state that a stream can continue from.
    #[test]
    fn damaged_states_are_refused_or_work(model in models(Kind::Extreme), damage in damage()) {
        let hmm = model.hmm(model.sparse());
        let mut decoder = hmm.online_viterbi();
        for k in 0..model.steps() {
            let text = damage.of(&json(&decoder.snapshot()));
            if let Ok(state) = serde_json::from_str::<OnlineViterbiSnapshot>(&text) {
                let mut other = hmm.online_viterbi();
                if other.restore(&state).is_ok() {
                    let _ = other.step_with(&0, &model.logs[k]);
                    prop_assert!(other.undecided().iter().all(|i| *i < model.states));
                    prop_assert!(!other.log_probability().is_nan());
                }
            }
            if decoder.step_with(&k, &model.logs[k]).is_err() {
                break;
            }
        }
        let n = model.states;
        let motion = SparseTransition::from_triplets(n, (0..n).map(|i| (i, i, 1.0))).unwrap();
        let sensor = OptionalLikelihood::new(SparseLikelihood::new(n));
        let hmm = wayfix::Hmm::new(model.prior(), motion, sensor).unwrap();
        let mut pruned = hmm.pruned_filter(Pruning::default());
        for _ in 0..3 {
            let text = damage.of(&json(&pruned.snapshot()));
            if let Ok(state) = serde_json::from_str::<PrunedFilterSnapshot>(&text) {
                let mut other = hmm.pruned_filter(Pruning::default());
                if other.restore(&state).is_ok() {
                    let _ = other.step(&None);
                    let sum: f64 = other.probabilities().iter().sum();
                    prop_assert!((sum - 1.0).abs() < 1e-6, "{} from {}", sum, text);
                    prop_assert!((0.0..=1.0).contains(&other.certificate().bound()));
                    let range = other.log_likelihood();
                    prop_assert!(!range.start().is_nan() && !range.end().is_nan());
                }
            }
            pruned.step(&None).unwrap();
        }
    }
}
