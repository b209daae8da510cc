//! Standardised scores, in units of each reference's scores for other queries.

use super::ObservationError;
use super::rows::{RowMoments, scaled};
use super::standardize::{CountIn, Standardize};
use crate::kernels::run;

/// Brings the distances of a query to one scale for all references.
///
/// Distances are first taken in standard deviations of the query's own, then in those of each
/// reference over other queries, as in the test-normalisation of speaker recognition
/// (Auckenthaler, Carey and Lloyd-Thomas 2000). A reference that looks like everything (a dark tunnel, a plain wall) is near to most
/// queries, and one whose distances hardly vary is never very near to any; both are compared
/// with their own usual scores. The places of the queries need not be known, so that it learns
/// as the vehicle drives. Few queries change little: the prior mean and deviation of each
/// reference count as ten queries.
///
/// ```
/// use wayfix::observation::Standardizer;
///
/// // Reference 0 is near to everything.
/// let mut references = Standardizer::new(3)?;
/// for k in 0..30 {
///     references.observe(&[0.1, 0.8 + 0.01 * (k % 3) as f32, 0.9])?;
/// }
/// let mut scores = [0.0; 3];
/// references.scores(&[0.1, 0.4, 0.9], &mut scores)?;
/// assert!(scores[1] < scores[0]);
/// # Ok::<(), wayfix::observation::ObservationError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Standardizer {
    /// Number of queries observed.
    pub(crate) count: f64,
    /// For each reference, the sum of its scores for these queries, and of their squares.
    pub(crate) sums: Vec<f64>,
    pub(crate) squares: Vec<f64>,
}

impl Standardizer {
    /// Creates a standardizer for this many references, before any query.
    ///
    /// # Errors
    ///
    /// [`ObservationError::Parameter`] if there are none.
    pub fn new(references: usize) -> Result<Self, ObservationError> {
        if references == 0 {
            let (what, expected) = ("the number of references", "at least 1");
            return Err(ObservationError::Parameter { what, value: 0.0, expected });
        }
        Ok(Self { count: 0.0, sums: vec![0.0; references], squares: vec![0.0; references] })
    }

    /// Checks sums read from storage.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, ObservationError> {
        let Self { count, sums, squares } = &self;
        let parameter =
            |what, value, expected| Err(ObservationError::Parameter { what, value, expected });
        Self::new(sums.len())?;
        if squares.len() != sums.len() {
            let what = "the number of sums of squares";
            return parameter(what, squares.len() as f64, "as many as sums of scores");
        }
        // Far above any real count, and such that no variance overflows 32 bits.
        if !(0.0..=1e15).contains(count) {
            return parameter("the number of queries", *count, "from 0 to 1e15");
        }
        if let Some(&sum) = sums.iter().find(|sum| !(-1e17..=1e17).contains(*sum)) {
            return parameter("a sum of scores", sum, "from -1e17 to 1e17");
        }
        if let Some(&square) = squares.iter().find(|square| !(0.0..=1e35).contains(*square)) {
            return parameter("a sum of squared scores", square, "from 0 to 1e35");
        }
        Ok(self)
    }

    /// The number of references.
    #[must_use]
    pub fn references(&self) -> usize {
        self.sums.len()
    }

    /// The number of queries observed.
    #[must_use]
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Learns from a query, whose place need not be known. Leave out the queries of a vehicle that
    /// stands still, which show one place again and again. O(n).
    ///
    /// # Errors
    ///
    /// [`ObservationError`] for a row of another length, or with NaN or −∞.
    pub fn observe(&mut self, distances: &[f32]) -> Result<(), ObservationError> {
        let mut scores = vec![0.0; distances.len()];
        self.observed_scores(distances, &mut scores)
    }

    /// Reduces the weight of all queries so far to that of at most `count`: for queries from
    /// elsewhere, such as the references themselves.
    #[must_use]
    pub fn discounted(self, count: f64) -> Self {
        if !(count >= 0.0 && count < self.count) {
            return self;
        }
        let part = count / self.count;
        let scaled = |values: Vec<f64>| values.into_iter().map(|value| value * part).collect();
        Self { count, sums: scaled(self.sums), squares: scaled(self.squares) }
    }

    /// Computes the score of each reference, smaller for more alike: around 0 with a deviation of
    /// about 1 for wrong ones. Infinite distances give infinite scores. Learns nothing. O(n); no
    /// allocation.
    ///
    /// # Errors
    ///
    /// As [`observe`](Self::observe).
    ///
    /// # Panics
    ///
    /// If `out` differs in length from `distances`.
    pub fn scores(&self, distances: &[f32], out: &mut [f64]) -> Result<(), ObservationError> {
        let moments = self.moments(distances)?;
        self.scores_of(distances, &moments, out);
        Ok(())
    }

    /// Calls [`observe`](Self::observe), then [`scores`](Self::scores).
    ///
    /// # Errors
    ///
    /// As [`observe`](Self::observe); nothing is then learned.
    ///
    /// # Panics
    ///
    /// If `out` differs in length from `distances`.
    pub fn observed_scores(
        &mut self,
        distances: &[f32],
        out: &mut [f64],
    ) -> Result<(), ObservationError> {
        let moments = self.moments(distances)?;
        self.observed_scores_of(distances, &moments, out);
        Ok(())
    }

    /// Moments of a row, checked for its length, NaN and −∞.
    pub(crate) fn moments(&self, distances: &[f32]) -> Result<RowMoments, ObservationError> {
        let (found, expected) = (distances.len(), self.references());
        if found != expected {
            return Err(ObservationError::Distances { found, expected });
        }
        let moments = RowMoments::of(distances);
        let invalid = |d: &f32| d.is_nan() || *d == f32::NEG_INFINITY;
        match distances.iter().position(invalid) {
            Some(reference) if !moments.valid => {
                Err(ObservationError::Distance { reference, value: distances[reference] })
            }
            _ => Ok(moments),
        }
    }

    /// [`scores`](Self::scores) of a row with these [moments](Self::moments).
    pub(crate) fn scores_of(&self, distances: &[f32], moments: &RowMoments, out: &mut [f64]) {
        assert_eq!(out.len(), distances.len(), "out must have one value per reference");
        let (mean, unit) = (moments.mean, moments.inverse_deviation());
        let scores = distances.iter().map(|&d| scaled(f64::from(d) - mean, unit));
        out.iter_mut().zip(scores).for_each(|(out, score)| *out = score);
        self.standardize(out);
    }

    /// [`observed_scores`](Self::observed_scores) of a row with these
    /// [moments](Self::moments).
    pub(crate) fn observed_scores_of(
        &mut self,
        distances: &[f32],
        moments: &RowMoments,
        out: &mut [f64],
    ) {
        assert_eq!(out.len(), distances.len(), "out must have one value per reference");
        self.count += 1.0;
        let (mean, unit) = (moments.mean, moments.inverse_deviation());
        let (sums, squares) = (&mut self.sums, &mut self.squares);
        run(CountIn { distances, mean, unit, sums, squares, out });
        self.standardize(out);
    }

    fn standardize(&self, scores: &mut [f64]) {
        let (sums, squares) = (&self.sums, &self.squares);
        run(Standardize { count: self.count, sums, squares, scores });
    }
}

#[cfg(test)]
mod tests {
    use super::super::standardize::PRIOR_COUNT;
    use super::*;

    #[test]
    fn nothing_seen_changes_only_the_scale_of_the_query() {
        let none = Standardizer::new(4).unwrap();
        let mut scores = [0.0; 4];
        none.scores(&[1.0, 2.0, 3.0, 4.0], &mut scores).unwrap();
        let expected = [-3.0, -1.0, 1.0, 3.0].map(|x: f64| x / 5_f64.sqrt());
        let prior = ((1.0 * PRIOR_COUNT) / PRIOR_COUNT).sqrt();
        assert!(scores.iter().zip(expected).all(|(a, b)| (a - b / prior).abs() < 1e-6));
    }

    #[test]
    fn references_come_to_the_same_mean_and_deviation() {
        let rows = |k: u32| {
            let hub = 0.1 + 0.001 * (k % 7) as f32;
            [
                hub,
                0.5 + 0.3 * ((k * 5) % 11) as f32 / 11.0,
                0.9 - 0.4 * ((k * 3) % 13) as f32 / 13.0,
            ]
        };
        let mut standard = Standardizer::new(3).unwrap();
        // The prior counts as ten queries and moves the mean of a reference that hardly varies.
        (0..20_000).for_each(|k| standard.observe(&rows(k)).unwrap());
        let (mut sums, mut squares, mut scores) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for k in 0..2000 {
            standard.scores(&rows(k), &mut scores).unwrap();
            for i in 0..3 {
                sums[i] += scores[i] / 2000.0;
                squares[i] += scores[i] * scores[i] / 2000.0;
            }
        }
        assert!(sums.iter().all(|mean| mean.abs() < 0.05), "{sums:?}");
        assert!(squares.iter().all(|square| (square - 1.0).abs() < 0.05), "{squares:?}");
    }

    #[test]
    fn invalid_rows_are_errors() {
        let mut standard = Standardizer::new(2).unwrap();
        let before = standard.clone();
        assert!(standard.observe(&[1.0]).is_err());
        assert!(standard.observed_scores(&[1.0, f32::NAN], &mut [0.0; 2]).is_err());
        assert!(standard.observe(&[1.0, f32::NEG_INFINITY]).is_err());
        assert_eq!(standard, before);
        let mut scores = [0.0; 2];
        standard.observed_scores(&[1.0, f32::INFINITY], &mut scores).unwrap();
        assert!(scores[0].is_finite() && scores[1] == f64::INFINITY);
        standard.observed_scores(&[2.0, 2.0], &mut scores).unwrap();
        assert!(scores.iter().all(|score| score.is_finite()));
        assert!(Standardizer::new(0).is_err());
    }
}
