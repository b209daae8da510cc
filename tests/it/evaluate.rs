//! Scores against counts by hand, naive loops and general properties.

use std::ops::RangeInclusive;

use proptest::prelude::*;
use wayfix::evaluate::{
    ReliabilityBin, binary_log_score, brier_score, expected_calibration_error, is_within,
    log_score, maximum_calibration_error, recall_within, reliability, steps_to_localize,
    steps_to_localize_correctly,
};

use crate::kit::{cases, says};

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-12, "{found} instead of {expected}");
}

/// Edges at the edges of bins.
fn forecasts() -> impl Strategy<Value = Vec<(f64, bool)>> {
    let probability = prop_oneof![
        (0..=100_i32).prop_map(|k| f64::from(k) / 100.0),
        (0..=12_i32).prop_map(|k| f64::from(k) / 12.0),
        0.0..=1.0,
    ];
    prop::collection::vec((probability, any::<bool>()), 1..30)
}

fn bins_of(diagram: &[ReliabilityBin]) -> Vec<(f64, f64, usize, f64, f64)> {
    let bins = diagram.iter();
    bins.map(|b| (b.lower, b.upper, b.count, b.mean_probability, b.fraction_true)).collect()
}

#[test]
fn a_place_within_a_tolerance() {
    let within = |places, place, tolerance| is_within(&places, place, tolerance).unwrap();
    assert!(within(3..=5, 3, 0) && within(3..=5, 5, 0));
    assert!(!within(3..=5, 2, 0) && !within(3..=5, 6, 0));
    assert!(within(3..=5, 1, 2) && within(3..=5, 7, 2));
    assert!(!within(3..=5, 0, 2) && !within(3..=5, 8, 2));
    assert!(within(3..=5, 0, 4));
    let last = usize::MAX;
    assert!(within(last - 1..=last, last, 9));
    assert!(within(0..=0, last, last) && within(last..=last, 0, last));
    assert!(!within(0..=0, last, last - 1) && !within(last..=last, 0, last - 1));
    assert!(within(0..=last, 7, 0));
}

#[test]
#[expect(clippy::reversed_empty_ranges, reason = "that is what is tested")]
fn a_range_without_places_is_an_error() {
    says(is_within(&(3..=2), 3, 9), "the number of places in 3..=2 is 0, expected at least 1");
    says(
        recall_within(&[None, Some(4..=4), Some(3..=2)], &[None; 3], 0),
        "the number of places in 3..=2 of query 2 is 0, expected at least 1",
    );
    let mut used = 3..=3;
    assert_eq!(used.next(), Some(3));
    assert!(is_within(&used, 3, 0).is_err());
}

#[test]
fn recall_counts_queries_on_the_map_only() {
    let truth = [Some(2..=3), Some(7..=7), None, Some(0..=0), None];
    let recall = |estimates: [_; 5], tolerance| recall_within(&truth, &estimates, tolerance);
    assert_eq!(recall([Some(3), Some(9), Some(3), None, None], 0), Ok(1.0 / 3.0));
    assert_eq!(recall([Some(3), Some(9), Some(3), None, None], 1), Ok(1.0 / 3.0));
    assert_eq!(recall([Some(3), Some(9), Some(3), None, None], 2), Ok(2.0 / 3.0));
    // "Not on the map" is a miss, however wide the tolerance.
    assert_eq!(recall([None; 5], usize::MAX), Ok(0.0));

    says(recall_within(&[None, None], &[Some(1), None], 0), NONE_ON_MAP);
    says(recall_within(&[], &[], 0), NONE_ON_MAP);
    says(recall_within(&truth, &[None], 0), "the number of estimates or controls is 1, expected 5");
}

const NONE_ON_MAP: &str = "the number of queries on the map is 0, expected at least 1";

#[test]
fn reliability_by_hand() {
    let forecasts = [
        (0.25, true),
        (0.125, false),
        (0.0, false),
        (0.5, true),
        (0.625, false),
        (1.0, true),
        (0.75, true),
        (1.0, false),
    ];
    let diagram = reliability(&forecasts, 4).unwrap();
    let expected = [
        (0.0, 0.25, 2, 0.0625, 0.0),
        (0.25, 0.5, 1, 0.25, 1.0),
        (0.5, 0.75, 2, 0.5625, 0.5),
        (0.75, 1.0, 3, 2.75 / 3.0, 2.0 / 3.0),
    ];
    assert_eq!(bins_of(&diagram), expected);
    // (2 × 0.0625 + 0.75 + 2 × 0.0625 + 0.75) / 8
    near(expected_calibration_error(&diagram), 0.21875);
    assert_eq!(maximum_calibration_error(&diagram), 0.75);
    // In sixty-fourths: 36 + 1 + 0 + 16 + 25 + 0 + 4 + 64.
    assert_eq!(brier_score(&forecasts), Ok(146.0 / 64.0 / 8.0));
    assert_eq!(binary_log_score(&forecasts), Ok(f64::NEG_INFINITY));
}

#[test]
fn bins_that_hold_nothing_are_left_out() {
    let forecasts = [(0.05, true), (1.0, true), (0.99, true)];
    let diagram = reliability(&forecasts, 10).unwrap();
    let edges: Vec<_> = diagram.iter().map(|bin| (bin.lower, bin.upper)).collect();
    assert_eq!(edges, [(0.0, 0.1), (0.9, 1.0)]);
    // As many bins as there can be.
    let diagram = reliability(&forecasts, usize::MAX).unwrap();
    assert_eq!(diagram.len(), 3);
    assert!(diagram.iter().all(|bin| bin.count == 1));
    near(expected_calibration_error(&diagram), 0.96 / 3.0);
}

#[test]
fn an_edge_belongs_to_the_bin_above() {
    for bins in 1..=100_usize {
        for edge in 0..=bins {
            let p = edge as f64 / bins as f64;
            let diagram = reliability(&[(p, true)], bins).unwrap();
            let bin = edge.min(bins - 1);
            assert_eq!(diagram[0].lower, bin as f64 / bins as f64, "{edge} / {bins}");
            assert_eq!(diagram[0].upper, (bin + 1) as f64 / bins as f64);
        }
    }
}

#[test]
fn log_scores_by_hand() {
    let forecasts = [(0.5, true), (0.25, false), (0.125, true)];
    // ln of 1/2 · 3/4 · 1/8
    near(binary_log_score(&forecasts).unwrap(), (3.0 / 64.0_f64).ln() / 3.0);
    near(log_score(&[0.5, 0.75, 0.125]).unwrap(), (3.0 / 64.0_f64).ln() / 3.0);
    // What is ruled out and happens costs all.
    assert_eq!(log_score(&[0.5, 0.0]), Ok(f64::NEG_INFINITY));
    assert_eq!(binary_log_score(&[(0.0, true)]), Ok(f64::NEG_INFINITY));
    assert_eq!(binary_log_score(&[(1.0, false)]), Ok(f64::NEG_INFINITY));
    // Nothing lost is 0, not −0.
    let certain = binary_log_score(&[(0.0, false), (0.0, false)]).unwrap();
    assert_eq!(certain.to_bits(), 0.0_f64.to_bits());
    assert_eq!(log_score(&[1.0]).unwrap().to_bits(), 0.0_f64.to_bits());
    // ln(1 − p) keeps the digits of a small p.
    assert_eq!(binary_log_score(&[(1e-20, false)]), Ok(-1e-20));
}

#[test]
fn a_sum_of_a_belief_may_be_rounded_above_one() {
    let p = 1.0 + 4.0 * f64::EPSILON;
    let diagram = reliability(&[(p, true), (0.95, true)], 10).unwrap();
    assert_eq!((diagram.len(), diagram[0].upper), (1, 1.0));
    assert_eq!(binary_log_score(&[(p, false)]), Ok(f64::NEG_INFINITY));
    near(binary_log_score(&[(p, true)]).unwrap(), 0.0);
    near(log_score(&[p]).unwrap(), 0.0);
    near(brier_score(&[(p, false)]).unwrap(), 1.0);
    assert_eq!(steps_to_localize(&[p], 1.0), Ok(Some(1)));
    assert!(brier_score(&[(1.0 + 1e-8, true)]).is_err());
}

#[test]
fn what_is_no_probability_is_an_error() {
    let nothing = "the number of probabilities is 0, expected at least 1";
    says(reliability(&[], 3), nothing);
    says(brier_score(&[]), nothing);
    says(binary_log_score(&[]), nothing);
    says(log_score(&[]), nothing);
    says(reliability(&[(0.5, true)], 0), "the number of bins is 0, expected at least 1");
    for bad in [f64::NAN, -0.25, 1.5, f64::INFINITY, f64::NEG_INFINITY] {
        let pairs = [(0.5, true), (bad, false)];
        let expected = format!("probability 1 is {bad}, expected a value from 0 to 1");
        says(reliability(&pairs, 3), &expected);
        says(brier_score(&pairs), &expected);
        says(binary_log_score(&pairs), &expected);
        says(log_score(&[0.5, bad]), &expected);
        let expected = format!("mass 1 is {bad}, expected a value from 0 to 1");
        says(steps_to_localize(&[0.5, bad], 0.5), &expected);
        says(steps_to_localize_correctly(&pairs, 0.5, 1), &expected);
        let expected = format!("the level is {bad}, expected a value from 0 to 1");
        says(steps_to_localize(&[], bad), &expected);
        says(steps_to_localize_correctly(&[], bad, 1), &expected);
    }
}

#[test]
fn localising_by_hand() {
    assert_eq!(steps_to_localize(&[0.5, 0.75, 0.5, 1.0], 0.75), Ok(Some(2)));
    assert_eq!(steps_to_localize(&[0.5, 0.75], 0.8), Ok(None));
    assert_eq!(steps_to_localize(&[0.0], 0.0), Ok(Some(1)));
    assert_eq!(steps_to_localize(&[], 0.0), Ok(None));

    let steps = [(0.9, true), (0.9, false), (0.9, true), (0.1, true), (0.9, true), (0.9, false)];
    let localised = |hold| steps_to_localize_correctly(&steps, 0.9, hold).unwrap();
    assert_eq!(localised(0), Some(1));
    assert_eq!(localised(1), Some(1));
    assert_eq!(localised(2), Some(3)); // the first was right for one step only
    assert_eq!(localised(3), Some(3));
    assert_eq!(localised(4), None);
    assert_eq!(localised(usize::MAX), None);
    // Right until the end, which comes too early.
    assert_eq!(steps_to_localize_correctly(&[(0.0, true), (1.0, true)], 1.0, 2), Ok(None));
    assert_eq!(steps_to_localize_correctly(&[], 0.0, 0), Ok(None));
}

fn ranges() -> impl Strategy<Value = Option<RangeInclusive<usize>>> {
    prop::option::of((0..8_usize, 0..4_usize).prop_map(|(first, more)| first..=first + more))
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn recall_is_by_the_nearest_true_place(
        queries in prop::collection::vec((ranges(), prop::option::of(0..14_usize)), 0..8),
        tolerance in 0..5_usize,
    ) {
        let (truth, estimates): (Vec<_>, Vec<_>) = queries.iter().cloned().unzip();
        let on_map = truth.iter().flatten().count();
        let found = queries.iter().filter(|(places, estimate)| {
            let distance = |to: usize| estimate.map_or(usize::MAX, |place| place.abs_diff(to));
            places.clone().is_some_and(|places| places.map(distance).min() <= Some(tolerance))
        });
        let expected = (on_map > 0).then(|| found.count() as f64 / on_map as f64);
        prop_assert_eq!(recall_within(&truth, &estimates, tolerance).ok(), expected);
    }

    #[test]
    fn calibration_by_naive_loops(forecasts in forecasts(), bins in 1..=25_usize) {
        let diagram = reliability(&forecasts, bins).unwrap();
        let (mut filled, mut ece, mut mce) = (vec![], 0.0, 0.0_f64);
        for m in 0..bins {
            let (lower, upper) = (m as f64 / bins as f64, (m + 1) as f64 / bins as f64);
            let (mut count, mut sum, mut happened) = (0, 0.0, 0.0);
            for &(p, outcome) in &forecasts {
                if p >= lower && (p < upper || (m == bins - 1 && p == 1.0)) {
                    (count, sum) = (count + 1, sum + p);
                    happened += f64::from(outcome);
                }
            }
            if count > 0 {
                let n = f64::from(count);
                filled.push((lower, upper, count, sum / n, happened / n));
                ece += (happened - sum).abs() / forecasts.len() as f64;
                mce = mce.max((happened / n - sum / n).abs());
            }
        }
        let found = bins_of(&diagram);
        prop_assert_eq!(found.len(), filled.len());
        for (found, expected) in found.into_iter().zip(filled) {
            prop_assert_eq!((found.0, found.1), (expected.0, expected.1));
            prop_assert_eq!(found.2, usize::try_from(expected.2).unwrap());
            near(found.3, expected.3);
            prop_assert_eq!(found.4, expected.4);
        }
        near(expected_calibration_error(&diagram), ece);
        near(maximum_calibration_error(&diagram), mce);

        let (mut squares, mut distance) = (0.0, 0.0);
        for &(p, outcome) in &forecasts {
            let miss = if outcome { 1.0 - p } else { p };
            squares += miss * miss / forecasts.len() as f64;
            distance += miss / forecasts.len() as f64;
        }
        near(brier_score(&forecasts).unwrap(), squares);
        let (ece, mce) = (expected_calibration_error(&diagram), maximum_calibration_error(&diagram));
        prop_assert!(0.0 <= ece && ece <= mce + 1e-12 && mce <= 1.0);
        // Binning can only hide errors.
        prop_assert!(ece <= distance + 1e-12 && distance <= squares.sqrt() + 1e-12);
    }

    /// In each bin, k of n events with probability k / n happen.
    #[test]
    fn calibrated_bins_have_no_error(counts in prop::collection::vec((0..=4_u32, 0..3_usize), 1..9)) {
        let mut forecasts = vec![(0.5, true), (0.5, false)];
        for (k, times) in counts {
            let four = (0..4).map(|i| (f64::from(k) / 4.0, i < k));
            forecasts.extend(four.cycle().take(4 * times));
        }
        for bins in [1, 2, 4, 5, 10, 1000] {
            let diagram = reliability(&forecasts, bins).unwrap();
            prop_assert_eq!(expected_calibration_error(&diagram), 0.0);
            prop_assert_eq!(maximum_calibration_error(&diagram), 0.0);
        }
    }

    #[test]
    fn log_scores_are_logarithms_of_products(forecasts in forecasts()) {
        let given: Vec<_> = forecasts.iter().map(|&(p, o)| if o { p } else { 1.0 - p }).collect();
        let expected = given.iter().product::<f64>().ln() / given.len() as f64;
        for score in [binary_log_score(&forecasts).unwrap(), log_score(&given).unwrap()] {
            prop_assert!(score <= 0.0);
            prop_assert!(score == expected || (score - expected).abs() <= 1e-9, "{score} {expected}");
        }
    }

    #[test]
    fn localising_as_it_is_defined(
        steps in prop::collection::vec(((0..=4_u8).prop_map(|k| f64::from(k) / 4.0), prop::bool::weighted(0.7)), 0..12),
        level in (0..=4_u8).prop_map(|k| f64::from(k) / 4.0),
        hold in 0..5_usize,
    ) {
        let masses: Vec<_> = steps.iter().map(|step| step.0).collect();
        let reached = |k: &usize| masses[k - 1] >= level;
        let held = |k: &usize| {
            steps.get(k - 1..k - 1 + hold).is_some_and(|held| held.iter().all(|step| step.1))
        };
        let first = (1..=steps.len()).find(reached);
        prop_assert_eq!(steps_to_localize(&masses, level), Ok(first));
        let right = (1..=steps.len()).find(|k| reached(k) && held(k));
        prop_assert_eq!(steps_to_localize_correctly(&steps, level, hold), Ok(right));
        let any = steps_to_localize_correctly(&steps, level, 0);
        prop_assert_eq!(any, Ok(first));
    }
}
