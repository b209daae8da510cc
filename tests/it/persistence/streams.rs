//! States of streams.

use crate::kit::{json, stored};
use proptest::prelude::*;
use wayfix::inference::Pruning;
use wayfix::{SparseTransition, TableLikelihood};

use crate::kit::{Kind, cases, models};

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
}
