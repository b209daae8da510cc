//! The receiver operating characteristic of a score.

use super::EvaluationError;
use super::ranking::cuts;

/// The receiver operating characteristic (ROC) of a score: the fractions of positives
/// and of negatives that reach each threshold.
///
/// With queries that show a place of the map as positives and others as
/// negatives, the curve shows how well the score tells them apart. Only the order of the scores
/// matters.
///
/// ```
/// use wayfix::evaluate::RocCurve;
///
/// // The probability of being on the map, and whether the vehicle was.
/// let curve = RocCurve::new(&[(0.9, true), (0.6, false), (0.6, true), (0.2, false)])?;
/// let points = curve.points().iter();
/// let points = points.map(|p| (p.threshold(), p.false_positive_rate(), p.true_positive_rate()));
/// assert_eq!(points.collect::<Vec<_>>(), [(0.9, 0.0, 0.5), (0.6, 0.5, 1.0), (0.2, 1.0, 1.0)]);
/// assert_eq!(curve.area(), 0.875); // 3 pairs of 4 in order, and a tie
/// # Ok::<(), wayfix::evaluate::EvaluationError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RocCurve {
    points: Vec<RocPoint>,
    area: f64,
}

/// A point of a [`RocCurve`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RocPoint {
    threshold: f64,
    false_positive_rate: f64,
    true_positive_rate: f64,
}

impl RocCurve {
    /// Computes the curve of scores, each with whether it belongs to a positive. Scores may be
    /// infinite. O(N log N).
    ///
    /// # Errors
    ///
    /// [`EvaluationError`] if a score is NaN, or if there are no positives or
    /// no negatives.
    pub fn new(samples: &[(f64, bool)]) -> Result<Self, EvaluationError> {
        let cuts = cuts("score", samples)?;
        let (positives, negatives) =
            cuts.last().map_or((0, 0), |all| (all.positives, all.negatives));
        for (what, count) in [("positives", positives), ("negatives", negatives)] {
            if count == 0 {
                return Err(EvaluationError::Missing { what });
            }
        }
        let mut points = Vec::with_capacity(cuts.len());
        // Twice the number of pairs in order, so that ties are whole numbers: each negative with
        // the positives above it, and the tied ones as half.
        let (mut twice, mut before) = (0, (0, 0));
        for cut in cuts {
            points.push(RocPoint {
                threshold: cut.threshold,
                false_positive_rate: cut.negatives as f64 / negatives as f64,
                true_positive_rate: cut.positives as f64 / positives as f64,
            });
            twice += (cut.negatives - before.1) as u128 * (cut.positives + before.0) as u128;
            before = (cut.positives, cut.negatives);
        }
        let pairs = positives as u128 * negatives as u128;
        Ok(Self { points, area: twice as f64 / (2 * pairs) as f64 })
    }

    /// The points, one for each score, highest first: equal scores enter
    /// together. Neither rate falls along them, and both end at 1; the
    /// corner (0, 0) before the first point is not listed.
    #[must_use]
    pub fn points(&self) -> &[RocPoint] {
        &self.points
    }

    /// The area under the curve, by straight lines from the corner (0, 0) on.
    ///
    /// It is the probability that a positive scores higher than a negative,
    /// where ties count half: the U statistic of Mann and Whitney (1947) over
    /// the number of pairs (Hanley and McNeil, 1982). 1 for perfect separation, 0.5 for chance,
    /// 0 for perfect separation the wrong way round. Pairs are counted in whole numbers, and
    /// only their ratio is rounded.
    #[doc(alias = "auc")]
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }
}

impl RocPoint {
    /// The lowest score taken as positive.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.threshold
    }

    /// The fraction of the negatives taken as positives.
    #[must_use]
    pub fn false_positive_rate(&self) -> f64 {
        self.false_positive_rate
    }

    /// The fraction of the positives taken as positives: the recall.
    #[must_use]
    pub fn true_positive_rate(&self) -> f64 {
        self.true_positive_rate
    }
}
