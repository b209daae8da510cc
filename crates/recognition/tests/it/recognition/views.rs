//! Changed and unchanged views.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix_recognition::motion::ViewChange;
use wayfix_recognition::observation::{ViewComparison, view_change};

use super::rows::{INF, row, within};
use crate::kit::{cases, text};

/// Σ (a − b)² / Σ (a² + b²) over scores that are finite in both rows, each within ±5.
fn change(before: &[f32], now: &[f32]) -> f64 {
    let pairs = within(before).into_iter().zip(within(now));
    let finite = pairs.filter(|(a, b)| a.is_finite() && b.is_finite());
    // Scores are in 32 bits: differences beyond their range vanish.
    let single = |score: f64| f64::from(score.clamp(-5.0, 5.0) as f32);
    let both: Vec<(f64, f64)> = finite.map(|(a, b)| (single(a), single(b))).collect();
    let apart: f64 = both.iter().map(|(a, b)| (a - b).powi(2)).sum();
    let size: f64 = both.iter().map(|(a, b)| a * a + b * b).sum();
    match both.len() {
        0 => 1.0,
        _ if apart == 0.0 => 0.0,
        _ => apart / size,
    }
}

/// Rows of one length; some repeat, exactly or nearly.
fn drive() -> impl Strategy<Value = Vec<Vec<f32>>> {
    (1..10_usize).prop_flat_map(|n| {
        vec((row(n), 0..4_u8), 0..9).prop_map(|rows| {
            let mut all: Vec<Vec<f32>> = Vec::new();
            for (row, kind) in rows {
                let last = all.last().cloned();
                all.push(match (kind, last) {
                    (0, Some(last)) => last,
                    (1, Some(last)) => last.iter().map(|d| (d * 1.001).max(f32::MIN)).collect(),
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
        let mut changes = Vec::new();
        for two in rows.windows(2) {
            let found = view_change(&two[0], &two[1]).unwrap();
            let expected = change(&two[0], &two[1]);
            prop_assert!((0.0..=2.0).contains(&found));
            // Scores have the digits of 32 bits.
            let apart = (found.sqrt() - expected.sqrt()).abs();
            prop_assert!(apart < 1e-5, "{found}, expected {expected}");
            changes.push(found);
        }
        changes.retain(|change| *change > 0.0);
        changes.sort_by(f64::total_cmp);
        let found = ViewComparison::threshold_of(&rows).unwrap();
        let median = changes.get(changes.len() / 2).copied().unwrap_or(0.0);
        prop_assert_eq!(found, 0.1 * median);

        let mut views = ViewComparison::new(threshold).unwrap();
        let mut last: Option<&Vec<f32>> = None;
        for row in &rows {
            let found = views.next(row).unwrap();
            let change = last.map(|last| view_change(last, row).unwrap());
            let expected = match change {
                Some(change) if change < threshold => ViewChange::Unchanged,
                _ => ViewChange::Changed,
            };
            prop_assert_eq!(found, expected, "{:?}", change);
            if found == ViewChange::Changed {
                last = Some(row);
            }
        }
    }
}

#[test]
fn views_by_hand() {
    let near = |found: Result<f64, _>, expected: f64| {
        assert!((found.unwrap() - expected).abs() < 1e-6, "expected {expected}");
    };
    // Differences 1 and 1 in rows of −2, −1, 0, 1, 2, in whatever unit.
    let row = [0.0, 1.0, 2.0, 3.0, 4.0];
    near(view_change(&row, &[0.0, 1.0, 2.0, 4.0, 3.0]), 0.1);
    near(view_change(&row, &row.map(|d| 10.0 - 0.5 * d)), 2.0);
    near(view_change(&row, &row.map(|d| 3.0 * d - 7.0)), 0.0);
    assert_eq!(view_change(&[0.5, 0.5], &[0.5, 0.5]), Ok(0.0));
    assert_eq!(view_change(&[0.5, 0.5], &[0.7, 0.7]), Ok(0.0));
    // Infinite distances take no part.
    let [before, now] = [[0.0, INF, 1.0, 2.0, 9.0, 3.0, 4.0], [0.0, 7.0, 1.0, 2.0, INF, 4.0, 3.0]];
    let apart = change(&before, &now);
    near(view_change(&before, &now), apart);
    assert_eq!(view_change(&[INF, 1.0], &[1.0, INF]), Ok(1.0));
    let lengths = "2 distances, expected one for each of 3 references";
    assert_eq!(text(view_change(&[0.0; 3], &[0.0; 2])), lengths);
    assert_eq!(text(ViewComparison::threshold_of(&[vec![0.0_f32; 3], vec![0.0; 2]])), lengths);
    assert_eq!(ViewComparison::threshold_of::<[f32; 2]>(&[]), Ok(0.0));
    assert_eq!(ViewComparison::threshold_of(&[[0.0_f32, 1.0]; 3]), Ok(0.0));
    for threshold in [-1.0, f64::NAN, f64::INFINITY] {
        let range = "expected a finite value of at least 0";
        let expected = format!("the threshold of change is {threshold}, {range}");
        assert_eq!(text(ViewComparison::new(threshold)), expected);
    }
    // The result is never NaN.
    let odd = [f32::NAN, INF, -INF, f32::MAX, f32::MIN, 0.0, 1e-45];
    for a in odd {
        for b in odd {
            for c in odd {
                let bad = [a, b, c].iter().any(|d| d.is_nan() || *d == -INF);
                let change = view_change(&[a, b, c], &[c, a, b]);
                assert_eq!(change.is_err(), bad);
                assert!(change.is_ok_and(|change| (0.0..=2.0).contains(&change)) != bad);
            }
        }
    }

    let mut views = ViewComparison::new(0.15).unwrap();
    assert_eq!(
        text(views.next(&[0.0, f32::NAN])),
        "the distance to reference 1 is NaN, expected a number or infinity"
    );
    assert_eq!(views.next(&row), Ok(ViewChange::Changed));
    assert_eq!(views.next(&[0.0, 1.0, 2.0, 4.0, 3.0]), Ok(ViewChange::Unchanged));
    assert_eq!(
        text(views.next(&[0.0, 2.0, 3.0])),
        "3 distances, expected one for each of 5 references"
    );
    // Compared with the last new view, not with the last view.
    let new = [1.0, 0.0, 2.0, 4.0, 3.0];
    assert_eq!(views.next(&new), Ok(ViewChange::Changed));
    assert_eq!(views.next(&[INF; 5]), Ok(ViewChange::Changed), "nothing can be compared");
    assert_eq!(views.next(&new), Ok(ViewChange::Changed), "nor after it");
    assert_eq!(views.next(&new), Ok(ViewChange::Unchanged));
    // Not even for an empty row.
    let mut empty = ViewComparison::new(0.4).unwrap();
    assert_eq!(empty.next(&[]), Ok(ViewChange::Changed));
    assert_eq!(text(empty.next(&[1.0])), "1 distances, expected one for each of 0 references");
    let mut all = ViewComparison::new(0.0).unwrap();
    assert_eq!(
        [all.next(&[1.0]), all.next(&[1.0])],
        [Ok(ViewChange::Changed), Ok(ViewChange::Changed)]
    );
}
