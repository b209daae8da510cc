//! Scores and odds of references, against their definitions.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix_recognition::observation::{MatchOdds, Standardizer};
use wayfix_recognition::{Options, Recognizer};

use super::rows::{INF, row, within};
use crate::kit::{cases, text};

/// Sums over queries, and the scores of a further query, by the formulas of the guide.
struct Usual {
    count: f64,
    sums: Vec<f64>,
    squares: Vec<f64>,
}

impl Usual {
    /// Variance of one reference's scores over queries, the share of a mean that moves a usual
    /// score, and the variance of that about the true one.
    fn spread(&self) -> (f64, f64, f64) {
        let (n, references) = (self.count, self.sums.len() as f64);
        let own = |(sum, square): (&f64, &f64)| square - if n > 0.0 { sum * sum / n } else { 0.0 };
        let apart: f64 = self.sums.iter().zip(&self.squares).map(own).sum();
        let all: f64 = self.squares.iter().sum();
        // Priors of three queries.
        let within = (apart / references + 3.0 * 0.65) / (3.0 + (n - 1.0).max(0.0));
        let all = (all / references + 3.0) / (3.0 + n);
        let between = (all - within).max(0.02 * all);
        let total = n * between + within;
        (within, n * between / total, between * within / total)
    }

    fn means(&self) -> Vec<f64> {
        let share = self.spread().1;
        self.sums
            .iter()
            .map(|s| if self.count > 0.0 { share * s / self.count } else { 0.0 })
            .collect()
    }

    /// A score counts as at most 2.5 deviations from the usual one, and an infinite one as average.
    fn learn(&mut self, row: &[f32]) {
        let (means, most) = (self.means(), 2.5 * self.spread().0.sqrt());
        for (i, score) in within(row).into_iter().enumerate() {
            let score = score.clamp(means[i] - most, means[i] + most);
            let score = if row[i] == INF { 0.0 } else { score };
            self.sums[i] += score;
            self.squares[i] += score * score;
        }
        self.count += 1.0;
    }

    fn scores(&self, row: &[f32]) -> Vec<f64> {
        let ((pooled, _, unsure), means) = (self.spread(), self.means());
        let of = |(i, score): (usize, f64)| {
            let n = self.count;
            let own = self.squares[i] - if n > 0.0 { self.sums[i].powi(2) / n } else { 0.0 };
            let variance = (own + 10.0 * pooled) / (10.0 + (n - 1.0).max(0.0));
            (score - means[i]) / (variance + unsure).sqrt()
        };
        within(row).into_iter().enumerate().map(of).collect()
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn scores_are_those_of_the_definition(
        (before, query) in (1..40_usize).prop_flat_map(|n| (vec(row(n), 0..9), row(n))),
    ) {
        let n = query.len();
        let mut references = Standardizer::new(n).unwrap();
        let mut usual = Usual { count: 0.0, sums: vec![0.0; n], squares: vec![0.0; n] };
        for row in before.iter().chain([&query]) {
            let mut found = vec![f64::NAN; n];
            references.scores(row, &mut found).unwrap();
            for (found, expected) in found.iter().zip(usual.scores(row)) {
                // Scores have the digits of 32 bits.
                let close = (found - expected).abs() < 2e-6 * expected.abs().max(1.0);
                prop_assert!(*found == expected || close, "{found}, expected {expected}");
            }
            references.observe(row).unwrap();
            usual.learn(row);
        }
        prop_assert_eq!(references.count(), before.len() as f64 + 1.0);
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
    let odds = |shares| text(MatchOdds::new(shares));
    let range = "expected from 0 to 1";
    assert_eq!(
        odds([0.1, 1.1, -0.2]),
        format!("the share of views that match weakly is 1.1, {range}")
    );
    assert_eq!(
        odds([0.1, 0.9, f64::NAN]),
        format!("the share of views that match clearly is NaN, {range}")
    );
    assert_eq!(
        odds([0.0, 0.5, 0.5]),
        "the share of views that say nothing is 0, expected from 1e-12 to 1"
    );
    assert_eq!(odds([0.25, 0.25, 0.25]), "the sum of the shares of views is 0.75, expected 1");
    // A query unlike all references is an error if the vehicle cannot be off the map.
    let mut track = Recognizer::from_distances(3, Options::default()).unwrap().track();
    assert_eq!(
        text(track.step(&[INF; 3])),
        "the query of step 1 is not valid: the query is infinitely far from all references, and there is no state off the map"
    );
}
