//! Precision and recall.

use super::EvaluationError;
use super::check::check_level;
use super::ranking::cuts;

/// Precision and recall of answers, for each threshold of their confidence.
///
/// Answers below a threshold are withheld. The precision is the fraction of the answers given
/// that is right; the recall is the fraction of all queries with a right answer that got it.
/// Only the order of the confidences matters: probabilities, their logarithms and scores of any
/// scale will do.
///
/// ```
/// use wayfix::evaluate::PrecisionRecallCurve;
///
/// // Five queries show places of the map; one of them got no answer.
/// let answers = [(0.9, true), (0.7, true), (0.7, false), (0.4, true), (0.1, false)];
/// let curve = PrecisionRecallCurve::new(&answers, 5)?;
/// let points = curve.points().iter().map(|p| (p.threshold(), p.precision(), p.recall()));
/// let expected = [(0.9, 1.0, 0.2), (0.7, 2.0 / 3.0, 0.4), (0.4, 0.75, 0.6), (0.1, 0.6, 0.6)];
/// assert_eq!(points.collect::<Vec<_>>(), expected);
/// assert_eq!(curve.recall_at_precision(1.0)?, 0.2);
/// assert_eq!(curve.recall_at_precision(0.7)?, 0.6);
/// # Ok::<(), wayfix::evaluate::EvaluationError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PrecisionRecallCurve {
    points: Vec<PrecisionRecallPoint>,
    average_precision: f64,
}

/// A point of a [`PrecisionRecallCurve`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PrecisionRecallPoint {
    threshold: f64,
    precision: f64,
    recall: f64,
}

impl PrecisionRecallCurve {
    /// Computes the curve of `answers`, each with its confidence and whether it is
    /// right; `positives` is the number of queries that have a right answer, found or
    /// not. O(N log N).
    ///
    /// An answer to a query that has no right one is wrong. A query without an
    /// answer is left out of `answers`, but counts in `positives` if it has a
    /// right one. With no answers at all the curve has no points. Confidences
    /// may be infinite.
    ///
    /// # Errors
    ///
    /// [`EvaluationError`] if a confidence is NaN, if `positives` is 0, or if
    /// more answers than that are right.
    pub fn new(answers: &[(f64, bool)], positives: usize) -> Result<Self, EvaluationError> {
        let cuts = cuts("confidence", answers)?;
        if positives == 0 {
            return Err(EvaluationError::Missing { what: "queries that have a right answer" });
        }
        let correct = cuts.last().map_or(0, |all| all.positives);
        if correct > positives {
            return Err(EvaluationError::Positives { correct, positives });
        }
        let (mut points, mut sum, mut before) = (Vec::with_capacity(cuts.len()), 0.0, 0);
        for cut in cuts {
            let precision = cut.positives as f64 / (cut.positives + cut.negatives) as f64;
            let recall = cut.positives as f64 / positives as f64;
            points.push(PrecisionRecallPoint { threshold: cut.threshold, precision, recall });
            sum += (cut.positives - before) as f64 * precision;
            before = cut.positives;
        }
        Ok(Self { points, average_precision: sum / positives as f64 })
    }

    /// The points, one for each confidence, highest first: answers of equal
    /// confidence enter together. The recall never falls along them.
    #[must_use]
    pub fn points(&self) -> &[PrecisionRecallPoint] {
        &self.points
    }

    /// The area under the curve, as average precision: Σ (R_n − R_{n−1}) P_n
    /// over the points, with R_0 = 0. From 0 to 1.
    ///
    /// The curve is taken as steps. Straight lines between the points would promise
    /// precisions that no threshold has (Davis and Goadrich, 2006).
    #[doc(alias = "auc")]
    #[must_use]
    pub fn average_precision(&self) -> f64 {
        self.average_precision
    }

    /// The largest recall at which the precision is at least `level`; 0 if it
    /// never is. O(points).
    ///
    /// Customary levels are 1 and 0.99, as a false match may spoil a map for good
    /// (Lowry et al., *Visual Place Recognition: A Survey*, 2016; Schubert et
    /// al., *Visual Place Recognition: A Tutorial*, 2023).
    ///
    /// # Errors
    ///
    /// [`EvaluationError::Parameter`] if `level` is not from 0 to 1.
    pub fn recall_at_precision(&self, level: f64) -> Result<f64, EvaluationError> {
        check_level(level)?;
        // The recall never falls, so the last is the largest.
        let last = self.points.iter().rev().find(|point| point.precision >= level);
        Ok(last.map_or(0.0, |point| point.recall))
    }
}

impl PrecisionRecallPoint {
    /// The lowest confidence of the answers given.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// The fraction of the answers given that is right.
    #[must_use]
    pub fn precision(&self) -> f64 {
        self.precision
    }

    /// The fraction of all queries with a right answer that got it.
    #[must_use]
    pub fn recall(&self) -> f64 {
        self.recall
    }
}
