//! Views that change or do not, and stretches of references that look alike.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::motion::ViewChange;
use wayfix::observation::{ViewComparison, alike_stretches, view_change};

use super::rows::{INF, deviation, mean, row};
use crate::kit::{cases, text};

/// Mean change over the references that are finite in both rows, in standard
/// deviations of the second.
fn change(before: &[f32], now: &[f32]) -> Option<f64> {
    let both = before.iter().zip(now).filter(|(a, b)| a.is_finite() && b.is_finite());
    let (a, b): (Vec<f64>, Vec<f64>) = both.map(|(a, b)| (f64::from(*a), f64::from(*b))).unzip();
    if a.is_empty() {
        return None;
    }
    let moved = mean(&a.iter().zip(&b).map(|(a, b)| (a - b).abs()).collect::<Vec<f64>>());
    Some(if moved == 0.0 { 0.0 } else { moved / deviation(&b) })
}

fn same(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-9 * b.abs()
}

/// Rows of one length, of which some come again, or nearly so.
fn drive() -> impl Strategy<Value = Vec<Vec<f32>>> {
    (1..10_usize).prop_flat_map(|n| {
        vec((row(n), 0..4_u8), 0..9).prop_map(|rows| {
            let mut all: Vec<Vec<f32>> = Vec::new();
            for (row, kind) in rows {
                let last = all.last().cloned();
                all.push(match (kind, last) {
                    (0, Some(last)) => last,
                    (1, Some(last)) => last.iter().map(|d| d * 1.001).collect(),
                    _ => row,
                });
            }
            all
        })
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn views_are_told_apart_by_definition(rows in drive(), threshold in prop_oneof![Just(0.0), 0.01..2.0]) {
        for two in rows.windows(2) {
            let found = view_change(&two[0], &two[1]).unwrap();
            prop_assert!(found >= 0.0);
            if let Some(expected) = change(&two[0], &two[1]) {
                prop_assert!(same(found, expected), "{found}, expected {expected}");
            }
        }
        let mut changes: Vec<f64> = rows.windows(2).filter_map(|two| change(&two[0], &two[1])).collect();
        changes.retain(|change| *change > 0.0 && change.is_finite());
        changes.sort_by(f64::total_cmp);
        let found = ViewComparison::threshold_of(&rows).unwrap();
        // The median of an even number is either of two.
        let len = changes.len();
        let medians = if len == 0 { [0.0; 2] } else { [changes[(len - 1) / 2], changes[len / 2]] };
        prop_assert!(medians.iter().any(|median| same(found, 0.1 * median)), "{found}, {medians:?}");

        let mut views = ViewComparison::new(threshold).unwrap();
        let mut last: Option<&Vec<f32>> = None;
        for row in &rows {
            let found = views.next(row).unwrap();
            let change = last.map(|last| change(last, row));
            let expected = match change {
                Some(Some(change)) if change < threshold => ViewChange::Unchanged,
                _ => ViewChange::Changed,
            };
            prop_assert_eq!(found, expected, "{:?}", change);
            if found == ViewChange::Changed {
                last = Some(row);
            }
        }
    }

    #[test]
    fn stretches_are_runs_of_alike_columns(rows in drive()) {
        let found = alike_stretches(&rows).unwrap();
        let Some(first) = rows.first() else {
            prop_assert!(found.is_empty());
            return Ok(());
        };
        let n = first.len();
        prop_assert_eq!(found.len(), n);
        let column = |i: usize| -> Vec<f32> { rows.iter().map(|row| row[i]).collect() };
        let apart = |i: usize, j: usize| change(&column(i), &column(j));
        let mut above: Vec<f64> = (1..n).filter_map(|i| apart(i - 1, i)).collect();
        above.retain(|change| *change > 0.0 && change.is_finite());
        above.sort_by(f64::total_cmp);
        let len = above.len();
        let medians = if len == 0 { [0.0; 2] } else { [above[(len - 1) / 2], above[len / 2]] };
        let of = |median: f64| {
            let (mut start, mut stretches) = (0, vec![0]);
            for i in 1..n {
                let alike = apart(start, i).is_some_and(|c| c == 0.0 || c < 0.1 * median);
                start = if alike { start } else { i };
                stretches.push(stretches[i - 1] + usize::from(!alike));
            }
            stretches
        };
        prop_assert!(found == of(medians[0]) || found == of(medians[1]), "{found:?}");
    }
}

#[test]
fn views_by_hand() {
    // Deviation 1, mean change 0.5; only one of them is in the other's units.
    assert_eq!(view_change(&[0.0, 1.0], &[0.0, 2.0]), Ok(0.5));
    assert_eq!(view_change(&[0.0, 2.0], &[0.0, 1.0]), Ok(1.0));
    assert_eq!(view_change(&[0.5, 0.5], &[0.5, 0.5]), Ok(0.0));
    // What is infinite takes no part.
    assert_eq!(view_change(&[0.0, INF, 1.0, 5.0], &[0.0, 7.0, 2.0, INF]), Ok(0.5));
    let lengths = "2 distances, expected one for each of 3 references";
    assert_eq!(text(view_change(&[0.0; 3], &[0.0; 2])), lengths);
    assert_eq!(text(ViewComparison::threshold_of(&[vec![0.0_f32; 3], vec![0.0; 2]])), lengths);
    assert_eq!(text(alike_stretches(&[vec![0.0_f32; 3], vec![0.0; 2]])), lengths);
    assert_eq!(ViewComparison::threshold_of::<[f32; 2]>(&[]), Ok(0.0));
    assert_eq!(ViewComparison::threshold_of(&[[0.0_f32, 1.0]; 3]), Ok(0.0));
    for threshold in [-1.0, f64::NAN, f64::INFINITY] {
        let range = "expected a finite value of at least 0";
        let expected = format!("the threshold of change is {threshold}, {range}");
        assert_eq!(text(ViewComparison::new(threshold)), expected);
    }
    // No NaN out, whatever comes in.
    let odd = [f32::NAN, INF, -INF, f32::MAX, f32::MIN, 0.0, 1e-45];
    for a in odd {
        for b in odd {
            for c in odd {
                let change = view_change(&[a, b, c], &[c, a, b]).unwrap();
                assert!(!change.is_nan(), "{a} {b} {c}");
            }
        }
    }

    let mut views = ViewComparison::new(0.4).unwrap();
    assert_eq!(views.next(&[0.0, 2.0]), Ok(ViewChange::Changed));
    assert_eq!(views.next(&[0.0, 2.4]), Ok(ViewChange::Unchanged));
    assert_eq!(
        text(views.next(&[0.0, 2.0, 3.0])),
        "3 distances, expected one for each of 2 references"
    );
    // Against the last new one, not the last one.
    assert_eq!(views.next(&[0.0, 3.6]), Ok(ViewChange::Changed));
    assert_eq!(views.next(&[INF, INF]), Ok(ViewChange::Changed), "nothing can be compared");
    assert_eq!(views.next(&[0.0, 3.6]), Ok(ViewChange::Changed), "nor after it");
    assert_eq!(views.next(&[0.0, 3.6]), Ok(ViewChange::Unchanged));
    // Not even of an empty row, which is a row.
    let mut empty = ViewComparison::new(0.4).unwrap();
    assert_eq!(empty.next(&[]), Ok(ViewChange::Changed));
    assert_eq!(text(empty.next(&[1.0])), "1 distances, expected one for each of 0 references");
    let mut all = ViewComparison::new(0.0).unwrap();
    assert_eq!(
        [all.next(&[1.0]), all.next(&[1.0])],
        [Ok(ViewChange::Changed), Ok(ViewChange::Changed)]
    );
}

#[test]
fn stretches_by_hand() {
    // References 1 and 2 differ by a hundredth of what others do.
    let rows = [[0.0_f32, 1.0, 1.01, 0.0, 1.0], [1.0, 0.0, 0.01, 1.0, 0.0]];
    assert_eq!(alike_stretches(&rows), Ok(vec![0, 1, 1, 2, 3]));
    assert_eq!(alike_stretches::<[f32; 0]>(&[]), Ok(vec![]));
    assert_eq!(alike_stretches(&[[0.0_f32; 0]; 2]), Ok(vec![]));
    assert_eq!(alike_stretches(&[[0.3_f32]]), Ok(vec![0]));
    // No query tells any apart.
    assert_eq!(alike_stretches(&[[0.3_f32; 4]; 3]), Ok(vec![0; 4]));
}
