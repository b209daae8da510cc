//! Scores and odds of references, against their definitions.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::observation::{MatchOdds, Standardizer};
use wayfix::recognition::{Options, Recognizer};

use super::rows::{INF, deviation, mean, row};
use crate::kit::{cases, text};

/// A query's distances in its own deviations.
fn in_deviations(row: &[f32]) -> Vec<f64> {
    let finite = row.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d));
    let finite: Vec<f64> = finite.collect();
    let equal = finite.iter().all(|d| *d == finite[0]);
    let score = |d: &f32| match d {
        _ if d.is_infinite() => f64::INFINITY,
        _ if equal => 0.0,
        d => (f64::from(*d) - mean(&finite)) / deviation(&finite),
    };
    row.iter().map(score).collect()
}

/// The scores of a query after others, by the formula of the guide.
fn scores(before: &[Vec<f32>], query: &[f32]) -> Vec<f64> {
    let n = query.len();
    let known = before.len() as f64 + 10.0;
    // References at an infinite distance count as average.
    let usual: Vec<Vec<f64>> = before
        .iter()
        .map(|row| {
            in_deviations(row).iter().map(|z| if z.is_finite() { *z } else { 0.0 }).collect()
        })
        .collect();
    let of = |i: usize| usual.iter().map(move |row| row[i]);
    let means: Vec<f64> = (0..n).map(|i| of(i).sum::<f64>() / known).collect();
    let squares = |i: usize| of(i).map(|z| (z - means[i]).powi(2)).sum::<f64>();
    let total: f64 = (0..n).map(squares).sum();
    let pooled = (1.0 + total / n as f64) / (before.len() as f64 + 1.0);
    let score =
        |(i, z): (usize, &f64)| (z - means[i]) / ((squares(i) + 10.0 * pooled) / known).sqrt();
    in_deviations(query).iter().enumerate().map(score).collect()
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn scores_are_those_of_the_definition(
        (before, query) in (1..40_usize).prop_flat_map(|n| (vec(row(n), 0..9), row(n))),
    ) {
        let mut references = Standardizer::new(query.len()).unwrap();
        for row in &before {
            references.observe(row).unwrap();
        }
        let (mut found, mut learned) = (vec![f64::NAN; query.len()], vec![f64::NAN; query.len()]);
        references.scores(&query, &mut found).unwrap();
        let counted = [before.clone(), vec![query.clone()]].concat();
        references.observed_scores(&query, &mut learned).unwrap();
        for (found, before) in [(found, &before), (learned, &counted)] {
            for (found, expected) in found.iter().zip(scores(before, &query)) {
                // Deviations have the digits of singles.
                let close = (found - expected).abs() < 1e-6 * expected.abs().max(1.0);
                prop_assert!(*found == expected || close, "{found}, expected {expected}");
            }
        }
    }
}

#[test]
fn where_all_distances_are_equal_the_query_says_nothing() {
    for n in [1, 4, 37] {
        for d in [0.0, 0.1, -7.7, 1e-45, f32::MAX, f32::MIN] {
            let mut scores = vec![f64::NAN; n];
            Standardizer::new(n).unwrap().scores(&vec![d; n], &mut scores).unwrap();
            assert_eq!(scores, vec![0.0; n], "{d}");
        }
    }
}

#[test]
fn what_is_wrong_is_said() {
    assert_eq!(text(Standardizer::new(0)), "the number of references is 0, expected at least 1");
    let mut references = Standardizer::new(3).unwrap();
    references.observe(&[0.1, 0.5, 0.7]).unwrap();
    let before = references.clone();
    let mut says = |row: &[f32]| {
        let mut out = vec![0.0; row.len()];
        let says = text(references.scores(row, &mut out));
        assert_eq!(text(references.observe(row)), says);
        assert_eq!(text(references.observed_scores(row, &mut out)), says);
        assert_eq!(references, before);
        says
    };
    for row in [&[][..], &[0.1, 0.2], &[0.0; 4]] {
        let expected = format!("{} distances, expected one for each of 3 references", row.len());
        assert_eq!(says(row), expected);
    }
    assert_eq!(
        says(&[0.1, f32::NAN, f32::NAN]),
        "the distance to reference 1 is NaN, expected a number or infinity"
    );
    assert_eq!(
        says(&[INF, 0.1, -INF]),
        "the distance to reference 2 is -inf, expected a number or infinity"
    );
    for temperature in [0.009, 1001.0, f64::NAN, 0.0, -1.0] {
        let expected = format!("the temperature is {temperature}, expected from 0.01 to 1000");
        assert_eq!(text(MatchOdds::default().with_temperature(temperature)), expected);
    }
    for nothing in [0.0, 1.1, f64::NAN] {
        let range = "expected from 1e-12 to 1";
        let expected = format!("the probability that a frame says nothing is {nothing}, {range}");
        assert_eq!(text(MatchOdds::default().with_nothing(nothing)), expected);
    }
    // A query that is like nothing is an error where the vehicle cannot be off the map.
    let mut track = Recognizer::from_distances(3, Options::default()).unwrap().track();
    assert_eq!(
        text(track.step(&[INF; 3], None)),
        "the query of step 1 is not valid: the query is infinitely far from all references, and there is no state off the map"
    );
}
