//! Operators of places and their sensors come back to the bit, and errors say what is wrong.

use crate::kit::{json, refuses, stored};
use wayfix::likelihood::{Groups, PooledLikelihood, SparseTableLikelihood};
use wayfix::motion::{DistanceTransition, OffMapTransition};
use wayfix::{Belief, SparseLikelihood, SparseTransition, TransitionEntries};

use crate::kit::still;
use crate::operators::distance::{fork, ways};

const STILL: &str = r#"{"version":1,"states":1,"to":[0],"from":[0],"probability":[1.0]}"#;

#[test]
fn off_map() {
    let back = Belief::certain(1, 0).unwrap();
    let a = OffMapTransition::new(still(1), 0.25, 0.5, back).unwrap();
    let text = json(&stored(&a));
    assert_eq!(
        text,
        format!(
            r#"{{"version":1,"inner":{STILL},"leave":0.25,"stay":0.5,"back":[0.5],"evidence":null}}"#
        )
    );
    let measured = json(&stored(&a.with_evidence(-2.5).unwrap()));
    assert_eq!(measured, text.replace("null", "-2.5"));
    refuses::<OffMapTransition<SparseTransition>>(
        &text.replace("null", "1e999"),
        "number out of range",
    );
    let bad = |from: &str, to: &str, expected: &str| {
        refuses::<OffMapTransition<SparseTransition>>(&text.replace(from, to), expected);
    };
    bad("0.25", "-1", "the rate of leaving is -1, expected a value from 0 to 1");
    bad(
        r#""stay":0.5"#,
        r#""stay":2"#,
        "the probability of no return is 2, expected a value from 0 to 1",
    );
    bad(
        r#""back":[0.5]"#,
        r#""back":[-1]"#,
        "the probability of a return to state 0 is -1, expected a value from 0 to 1",
    );
    bad(
        r#""back":[0.5]"#,
        r#""back":[0.25]"#,
        "the probability of a return or none is 0.75, expected 1",
    );
    bad(
        r#""back":[0.5]"#,
        r#""back":[0.5,0]"#,
        "the return belief has 2 states, expected 1 to match the inner operator",
    );
}

#[test]
fn by_distance() {
    let a = DistanceTransition::new(still(1), |_, _| 0.25).unwrap();
    let text = json(&stored(&a));
    assert_eq!(text, format!(r#"{{"version":1,"base":{STILL},"lengths":[0.25]}}"#));
    let bad = |lengths: &str, expected: &str| {
        refuses::<DistanceTransition>(&text.replace("[0.25]", lengths), expected);
    };
    bad("[]", "the number of lengths is 0, expected one for each entry of the base");
    bad("[1,1]", "the number of lengths is 2, expected one for each entry of the base");
    bad(
        "[-1]",
        "the length of the transition from state 0 to state 0 is -1, expected a finite value of at least 0",
    );
    let a = fork(&[0.1, 1e300, 0.3]);
    let b: DistanceTransition = serde_json::from_str(&json(&stored(&a))).unwrap();
    assert!((1..4).all(|to| a.length(to, 0) == b.length(to, 0)));
    assert_eq!(ways(&a, 0.15, 0.01), ways(&b, 0.15, 0.01));
}

#[test]
fn pooled() {
    let images = Groups::new(vec![0, 1, 1]).unwrap();
    let text = json(&stored(&PooledLikelihood::new(SparseLikelihood::new(3), images).unwrap()));
    assert_eq!(text, r#"{"version":1,"sensor":{"version":1,"states":3},"groups":[0,1,1]}"#);
    refuses::<PooledLikelihood<SparseLikelihood>>(
        &text.replace("[0,1,1]", "[0,1]"),
        "the grouping has 2 states, expected 3 to match the sensor",
    );
}

#[test]
fn values_are_the_same_to_the_bit() {
    let back = Belief::new(vec![0.3, 0.7]).unwrap();
    let a = OffMapTransition::new(still(2), 0.1, 0.3, back).unwrap();
    let b: OffMapTransition<SparseTransition> = serde_json::from_str(&json(&stored(&a))).unwrap();
    let row = |a: &OffMapTransition<SparseTransition>, i: usize| {
        a.incoming(&(), i).map(|(j, p)| (j, p.to_bits())).collect::<Vec<_>>()
    };
    assert!((0..3).all(|i| row(&a, i) == row(&b, i)));
}

#[test]
fn sparse_tables() {
    let lists = [(vec![(2, 0.9), (0, 0.25)], 0.0), (vec![], 0.125)];
    let table = SparseTableLikelihood::from_lists(3, &lists).unwrap();
    let back = stored(&table);
    assert_eq!(back, table);
    let text = json(&back);
    assert_eq!(text, r#"{"version":1,"states":3,"symbols":[[[[0,0.25],[2,0.9]],0.0],[[],0.125]]}"#);
    let bad = |from: &str, to: &str, expected: &str| {
        refuses::<SparseTableLikelihood>(&text.replace(from, to), expected);
    };
    bad("[2,", "[3,", "a state that symbol 0 lists is 3, expected 0 to 2");
    bad("[2,", "[0,", "the number of times that symbol 0 lists state 0 is 2, expected 1");
    bad(
        "0.125",
        "-1",
        "the probability of symbol 1 in unlisted states is -1, expected a finite value of at least 0",
    );
}
