//! Curves against counting by hand, naive loops and what must hold for them.

use proptest::prelude::*;
use wayfix_recognition::ThresholdCurve;

use crate::kit::{cases, says};

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-12, "{found} instead of {expected}");
}

/// Few different scores, so that there are ties.
fn samples() -> impl Strategy<Value = Vec<(f64, bool)>> {
    let score = prop_oneof![
        8 => (-4..=4_i32).prop_map(f64::from),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NEG_INFINITY),
        1 => Just(-0.0),
        2 => -2.0..2.0,
    ];
    prop::collection::vec((score, any::<bool>()), 0..20)
}

fn thresholds(samples: &[(f64, bool)]) -> Vec<f64> {
    let mut all: Vec<f64> = samples.iter().map(|sample| sample.0).collect();
    all.sort_by(|a, b| b.partial_cmp(a).unwrap());
    all.dedup();
    all
}

/// Samples of one label that reach a threshold.
fn reach(samples: &[(f64, bool)], threshold: f64, label: bool) -> f64 {
    samples.iter().filter(|sample| sample.0 >= threshold && sample.1 == label).count() as f64
}

fn points_of(curve: &ThresholdCurve) -> Vec<(f64, f64, f64)> {
    curve.points().iter().map(|p| (p.threshold, p.precision, p.recall)).collect()
}

fn roc_points_of(curve: &ThresholdCurve) -> Vec<(f64, f64, f64)> {
    let points = curve.points().iter();
    points.map(|p| (p.threshold, p.false_positive_rate, p.recall)).collect()
}

#[test]
fn precision_and_recall_by_hand() {
    // Six queries have a right answer, one of them got none at all.
    let answers = [
        (0.3, true),
        (0.9, true),
        (0.5, false),
        (0.8, true),
        (0.5, true),
        (0.5, true),
        (0.1, false),
    ];
    let curve = ThresholdCurve::precision_recall(&answers, 6).unwrap();
    let expected = [
        (0.9, 1.0, 1.0 / 6.0),
        (0.8, 1.0, 2.0 / 6.0),
        (0.5, 4.0 / 5.0, 4.0 / 6.0),
        (0.3, 5.0 / 6.0, 5.0 / 6.0),
        (0.1, 5.0 / 7.0, 5.0 / 6.0),
    ];
    assert_eq!(points_of(&curve), expected);
    // 1/6 + 1/6 + (2/6) (4/5) + (1/6) (5/6)
    near(curve.average_precision(), 133.0 / 180.0);
    let recall_at = |level| curve.recall_at_precision(level).unwrap();
    assert_eq!(recall_at(1.0), 2.0 / 6.0);
    assert_eq!(recall_at(0.99), 2.0 / 6.0);
    // The precision falls to 4/5 in between, and rises again.
    assert_eq!(recall_at(5.0 / 6.0), 5.0 / 6.0);
    assert_eq!(recall_at(0.0), 5.0 / 6.0);
}

#[test]
fn curves_without_answers_or_without_right_ones() {
    let none = ThresholdCurve::precision_recall(&[], 3).unwrap();
    assert_eq!((none.points(), none.average_precision()), (&[][..], 0.0));
    assert_eq!(none.recall_at_precision(0.0), Ok(0.0));
    let wrong = ThresholdCurve::precision_recall(&[(1.0, false), (2.0, false)], 3).unwrap();
    assert_eq!(points_of(&wrong), [(2.0, 0.0, 0.0), (1.0, 0.0, 0.0)]);
    assert_eq!(wrong.average_precision(), 0.0);
    assert_eq!(wrong.recall_at_precision(0.5), Ok(0.0));
    let tied =
        ThresholdCurve::precision_recall(&[(0.0, true), (-0.0, false), (0.0, true)], 2).unwrap();
    assert_eq!(points_of(&tied), [(0.0, 2.0 / 3.0, 1.0)]);
    assert_eq!(tied.recall_at_precision(1.0), Ok(0.0));
    let (best, worst) = (f64::INFINITY, f64::NEG_INFINITY);
    let infinite = [(worst, false), (best, true), (best, true)];
    let infinite = ThresholdCurve::precision_recall(&infinite, 2).unwrap();
    assert_eq!(points_of(&infinite), [(best, 1.0, 1.0), (worst, 2.0 / 3.0, 1.0)]);
    assert_eq!(infinite.average_precision(), 1.0);
}

#[test]
fn what_is_no_curve_is_an_error() {
    says(
        ThresholdCurve::precision_recall(&[(0.5, true), (f64::NAN, false)], 1),
        "confidence 1 is NaN, expected a number",
    );
    says(
        ThresholdCurve::precision_recall(&[(0.5, false)], 0),
        "the number of queries that have a right answer is 0, expected at least 1",
    );
    says(
        ThresholdCurve::precision_recall(&[(0.5, true), (0.1, true), (0.2, false)], 1),
        "the number of right answers is 2, expected at most 1, as many as queries that have one",
    );
    let curve = ThresholdCurve::precision_recall(&[(0.5, true)], 1).unwrap();
    says(curve.recall_at_precision(99.0), "the level is 99, expected a value from 0 to 1");
    says(curve.recall_at_precision(f64::NAN), "the level is NaN, expected a value from 0 to 1");
    says(
        ThresholdCurve::roc(&[(0.5, true), (0.1, false), (f64::NAN, false)]),
        "score 2 is NaN, expected a number",
    );
    says(ThresholdCurve::roc(&[]), "the number of positives is 0, expected at least 1");
    says(ThresholdCurve::roc(&[(0.5, false)]), "the number of positives is 0, expected at least 1");
    says(ThresholdCurve::roc(&[(0.5, true)]), "the number of negatives is 0, expected at least 1");
}

#[test]
fn roc_by_hand() {
    let samples = [(0.8, true), (0.6, false), (0.6, true), (0.4, true), (0.4, false), (0.1, false)];
    let curve = ThresholdCurve::roc(&samples).unwrap();
    let third = 1.0 / 3.0;
    let expected =
        [(0.8, 0.0, third), (0.6, third, 2.0 / 3.0), (0.4, 2.0 / 3.0, 1.0), (0.1, 1.0, 1.0)];
    assert_eq!(roc_points_of(&curve), expected);
    // Of nine pairs, 0.4 loses to 0.6, and two are ties.
    assert_eq!(curve.area(), 7.0 / 9.0);

    let area = |samples: &[_]| ThresholdCurve::roc(samples).unwrap().area();
    assert_eq!(area(&[(1.0, true), (1.0, false), (1.0, false)]), 0.5);
    assert_eq!(area(&[(f64::INFINITY, true), (f64::NEG_INFINITY, false)]), 1.0);
    assert_eq!(area(&[(1.0, true), (2.0, false)]), 0.0);
    assert_eq!(area(&[(0.0, true), (-0.0, false)]), 0.5);
}

#[test]
fn precision_recall_and_roc_are_one_curve() {
    let samples = [(0.9, true), (0.6, false), (0.6, true), (0.2, false)];
    let curve = ThresholdCurve::precision_recall(&samples, 2).unwrap();
    assert_eq!(curve, ThresholdCurve::roc(&samples).unwrap());
    // A query without an answer loses against the wrong answer.
    let curve = ThresholdCurve::precision_recall(&[(0.9, true), (0.5, false)], 2).unwrap();
    assert_eq!(curve.area(), 0.5);
    // Nothing is wrong.
    let curve = ThresholdCurve::precision_recall(&[(0.9, true)], 2).unwrap();
    assert_eq!((curve.area(), curve.points()[0].false_positive_rate), (1.0, 0.0));
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn precision_and_recall_at_each_threshold(answers in samples(), unanswered in 0..4_usize) {
        let right = answers.iter().filter(|answer| answer.1).count();
        let positives = right + unanswered;
        prop_assume!(positives > 0);
        let curve = ThresholdCurve::precision_recall(&answers, positives).unwrap();
        let point = |threshold| {
            let (right, wrong) =
                (reach(&answers, threshold, true), reach(&answers, threshold, false));
            (threshold, right / (right + wrong), right / positives as f64)
        };
        let expected: Vec<_> = thresholds(&answers).into_iter().map(point).collect();
        prop_assert_eq!(points_of(&curve), expected.clone());

        let (mut area, mut before) = (0.0, 0.0);
        for (_, precision, recall) in &expected {
            area += (recall - before) * precision;
            before = *recall;
        }
        near(curve.average_precision(), area);
        prop_assert!((0.0..=1.0).contains(&curve.average_precision()));
        prop_assert!(curve.points().is_sorted_by(|a, b| a.recall <= b.recall));
        for level in [0.0, 0.3, 0.5, 2.0 / 3.0, 0.75, 0.99, 1.0] {
            let enough = expected.iter().filter(|point| point.1 >= level);
            let largest = enough.map(|point| point.2).fold(0.0, f64::max);
            prop_assert_eq!(curve.recall_at_precision(level), Ok(largest));
        }
    }

    #[test]
    fn the_area_under_the_roc_counts_pairs(samples in samples()) {
        let of = |label| samples.iter().filter(move |s| s.1 == label).map(|s| s.0);
        let (positives, negatives) = (of(true).count(), of(false).count());
        let curve = ThresholdCurve::roc(&samples);
        prop_assert_eq!(curve.is_ok(), positives > 0 && negatives > 0);
        let Ok(curve) = curve else { return Ok(()) };
        let mut won = 0.0;
        for a in of(true) {
            for b in of(false) {
                won += if a > b { 1.0 } else if a == b { 0.5 } else { 0.0 };
            }
        }
        prop_assert_eq!(curve.area(), won / (positives * negatives) as f64);
        prop_assert!((0.0..=1.0).contains(&curve.area()));

        let rate = |threshold, label, all| reach(&samples, threshold, label) / all as f64;
        let point = |t| (t, rate(t, false, negatives), rate(t, true, positives));
        let expected: Vec<_> = thresholds(&samples).into_iter().map(point).collect();
        prop_assert_eq!(roc_points_of(&curve), expected.clone());
        let (mut area, mut before) = (0.0, (0.0, 0.0));
        for (_, x, y) in expected {
            area += (x - before.0) * (y + before.1) / 2.0;
            before = (x, y);
        }
        near(curve.area(), area);
        prop_assert_eq!(before, (1.0, 1.0));

        // The other way round, what was won is lost.
        let negated: Vec<_> = samples.iter().map(|&(score, label)| (-score, label)).collect();
        near(ThresholdCurve::roc(&negated).unwrap().area(), 1.0 - curve.area());
    }

    /// Only the order of the scores matters, and not that of the samples.
    #[test]
    fn monotone_transforms_change_nothing(samples in samples()) {
        let right = samples.iter().filter(|s| s.1).count();
        prop_assume!(right > 0 && right < samples.len());
        let scores = thresholds(&samples);
        let rank = |score| scores.iter().rev().position(|s| *s == score).unwrap() as f64;
        let ranked: Vec<_> = samples.iter().rev().map(|&(s, label)| (rank(s).exp(), label)).collect();
        let curves = [&samples, &ranked].map(|s| ThresholdCurve::precision_recall(s, right + 1).unwrap());
        let [a, b] = &curves;
        prop_assert_eq!(a.average_precision(), b.average_precision());
        let rest = |curve| points_of(curve).into_iter().map(|p| (p.1, p.2)).collect::<Vec<_>>();
        prop_assert_eq!(rest(a), rest(b));
        let [a, b] = [&samples, &ranked].map(|s| ThresholdCurve::roc(s).unwrap());
        prop_assert_eq!(a.area(), b.area());
    }
}
