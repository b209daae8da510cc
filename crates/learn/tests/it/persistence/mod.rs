//! Stored values come back to the bit, and invalid ones are refused.

mod logit;
mod names;

use proptest::prelude::*;
use wayfix::{SparseTransition, Transition};
use wayfix_learn::{GeneratorTransition, LogitTransition};

use crate::kit::{Kind, assert_stored_operator, cases, check_columns, damage, json, models};

/// Slopes that some moves share, and that others do not have.
fn logit(moves: &SparseTransition, rate: f64) -> LogitTransition {
    let mut a = LogitTransition::new(moves, 2).unwrap();
    a = a.with_shared_slopes(|from, to| (from != to).then_some((from + to) % 3));
    for (from, to) in a.moves().filter(|m| m.0 != m.1).collect::<Vec<_>>() {
        a = a.with_slopes(from, to, &[0.1 * to as f64, rate - 0.3]).unwrap();
    }
    a.with_ridge(rate).unwrap()
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn operators_are_the_same_to_the_bit(
        model in models(Kind::Extreme).prop_filter("matrices", |model| !model.matrices.is_empty()),
        rate in prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0..1.0],
        damage in damage(),
    ) {
        let moves = SparseTransition::from_rows(&model.matrices[0]).unwrap();
        let a = logit(&moves, rate);
        assert_stored_operator(&a, &vec![rate, -2.5]);
        // Entries as rates, but for the smallest.
        let rates = moves.triplets().filter(|&(to, from, p)| to != from && p > 1e-290);
        let rates: Vec<_> = rates.map(|(to, from, p)| (to, from, p / (rate + 0.1))).collect();
        assert_stored_operator(&GeneratorTransition::from_triplets(model.states, rates).unwrap(), &2.5);

        // Whatever is changed in a file, there is an error or something that works.
        if let Ok(a) = serde_json::from_str::<LogitTransition>(&damage.of(&json(&a))) {
            // Without slopes any number of inputs is valid, also one that memory does not hold.
            let inputs = vec![0.5; a.inputs().min(9)];
            if a.check_control(&inputs).is_ok() {
                check_columns(&a, &inputs)?;
            }
        }
    }
}

#[test]
fn the_format_is_as_documented() {
    let rates = [(2, 0, 1.5), (1, 0, 0.5), (0, 2, 0.25)];
    assert_eq!(
        json(&GeneratorTransition::from_triplets(3, rates).unwrap()),
        r#"{"version":1,"rates":[[[1,0.5],[2,1.5]],[],[[0,0.25]]]}"#
    );
}
