//! Answers by falling score, at each threshold: precision and recall, and the receiver operating
//! characteristic.

use wayfix::error::OutOfRange;

/// Precision, recall and false positive rate of answers, at each threshold of their score.
///
/// Answers below a threshold are withheld. Only the order of the scores matters: probabilities,
/// their logarithms and scores of any scale, even infinite ones, will do.
///
/// ```
/// use wayfix_recognition::ThresholdCurve;
///
/// // Five queries show places of the map; one of them got no answer.
/// let answers = [(0.9, true), (0.7, true), (0.7, false), (0.4, true), (0.1, false)];
/// let curve = ThresholdCurve::precision_recall(&answers, 5)?;
/// let points = curve.points().iter().map(|p| (p.threshold, p.precision, p.recall));
/// let expected = [(0.9, 1.0, 0.2), (0.7, 2.0 / 3.0, 0.4), (0.4, 0.75, 0.6), (0.1, 0.6, 0.6)];
/// assert_eq!(points.collect::<Vec<_>>(), expected);
/// assert_eq!(curve.recall_at_precision(1.0)?, 0.2);
/// assert_eq!(curve.recall_at_precision(0.7)?, 0.6);
///
/// // The probability of being on the map, and whether the vehicle was.
/// let curve = ThresholdCurve::roc(&[(0.9, true), (0.6, false), (0.6, true), (0.2, false)])?;
/// let points = curve.points().iter().map(|p| (p.threshold, p.false_positive_rate, p.recall));
/// assert_eq!(points.collect::<Vec<_>>(), [(0.9, 0.0, 0.5), (0.6, 0.5, 1.0), (0.2, 1.0, 1.0)]);
/// assert_eq!(curve.area(), 0.875); // 3 pairs of 4 in order, and a tie
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ThresholdCurve {
    points: Vec<ThresholdPoint>,
    area: f64,
    average_precision: f64,
}

/// Point of a [`ThresholdCurve`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ThresholdPoint {
    /// Lowest score of the answers given.
    pub threshold: f64,
    /// Fraction of the answers given that are right.
    pub precision: f64,
    /// Fraction of the positives, or of all queries with a right answer, that are found: the true
    /// positive rate.
    pub recall: f64,
    /// Fraction of the negatives, or of the wrong answers, that are given; 0 if there are none.
    pub false_positive_rate: f64,
}

impl ThresholdCurve {
    /// Computes precision and recall of `answers`, each with its confidence and whether it is
    /// right; `positives` is the number of queries that have a right answer, found or
    /// not. O(N log N).
    ///
    /// An answer to a query that has no right answer is wrong. A query without an answer is left
    /// out of `answers`, but counts in `positives` if it has a right answer. With no answers at all
    /// the curve has no points.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if a confidence is NaN, if `positives` is 0, or if
    /// more answers than that are right.
    pub fn precision_recall(answers: &[(f64, bool)], positives: usize) -> Result<Self, OutOfRange> {
        let cuts = cuts("confidence", answers)?;
        if positives == 0 {
            return Err(OutOfRange::none("the number of queries that have a right answer"));
        }
        let [correct, wrong] = cuts.last().map_or([0, 0], |all| all.counts);
        if correct > positives {
            let expected = format!("at most {positives}, as many as queries that have one");
            return Err(OutOfRange::new("the number of right answers", correct as f64, expected));
        }
        Ok(Self::new(&cuts, [positives, wrong]))
    }

    /// Computes the receiver operating characteristic (ROC) of scores, each with whether it belongs
    /// to a positive. With queries that show a place of the map as positives and others as
    /// negatives, it shows how well the score tells them apart. O(N log N).
    ///
    /// Both rates end at 1; the corner (0, 0) before the first point is not listed.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if a score is NaN, or if positives or negatives are
    /// missing.
    pub fn roc(samples: &[(f64, bool)]) -> Result<Self, OutOfRange> {
        let cuts = cuts("score", samples)?;
        let all = cuts.last().map_or([0, 0], |all| all.counts);
        for (what, count) in
            ["the number of positives", "the number of negatives"].into_iter().zip(all)
        {
            if count == 0 {
                return Err(OutOfRange::none(what));
            }
        }
        Ok(Self::new(&cuts, all))
    }

    fn new(cuts: &[Cut], [positives, negatives]: [usize; 2]) -> Self {
        let mut points = Vec::with_capacity(cuts.len());
        // Twice the number of ordered pairs, so that ties are whole numbers: each negative counts
        // the positives above it, and those tied with it as half.
        let (mut twice, mut sum, mut before) = (0, 0.0, [0, 0]);
        for &Cut { threshold, counts: [right, wrong] } in cuts {
            let precision = right as f64 / (right + wrong) as f64;
            let recall = right as f64 / positives as f64;
            let false_positive_rate = wrong as f64 / negatives.max(1) as f64;
            points.push(ThresholdPoint { threshold, precision, recall, false_positive_rate });
            // Each negative at this cut gains 2 · before + (right − before) = right + before: the
            // positives above it twice, those tied with it once.
            twice += (wrong - before[1]) as u128 * (right + before[0]) as u128;
            sum += (right - before[0]) as f64 * precision;
            before = [right, wrong];
        }
        let pairs = positives as u128 * negatives as u128;
        // Both counts fit 64 bits, so their product and twice the sum fit 128: only the quotient
        // rounds.
        let area = if pairs == 0 { 1.0 } else { twice as f64 / (2 * pairs) as f64 };
        Self { points, area, average_precision: sum / positives as f64 }
    }

    /// Points of the curve, one for each score, highest first: answers of equal score enter
    /// together. Neither the recall nor the false positive rate falls along them.
    #[must_use]
    pub fn points(&self) -> &[ThresholdPoint] {
        &self.points
    }

    /// Area under the receiver operating characteristic, by straight lines that start from the
    /// corner (0, 0).
    ///
    /// It is the probability that a positive scores higher than a negative, where ties count half:
    /// the U statistic of Mann and Whitney (1947) divided by the number of pairs (Hanley and
    /// McNeil, 1982). 1 for perfect separation, 0.5 for chance, 0 for perfect separation the wrong
    /// way round. Pairs are counted in whole numbers, and only their ratio is rounded. Queries
    /// without an answer lose all their pairs; without negatives the area is 1.
    #[doc(alias = "auc")]
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Area under precision and recall, as average precision: Σ (R_n − R_{n−1}) P_n over the
    /// points, with R_0 = 0. From 0 to 1.
    ///
    /// The curve is taken as steps. Straight lines between the points would promise
    /// precisions that no threshold has (Davis and Goadrich, 2006).
    #[doc(alias = "auc")]
    #[must_use]
    pub fn average_precision(&self) -> f64 {
        self.average_precision
    }

    /// Largest recall at which the precision is at least `level`; 0 if it never is. O(points).
    ///
    /// Customary levels are 1 and 0.99, as a false match may spoil a map for good
    /// (Lowry et al., *Visual Place Recognition: A Survey*, 2016; Schubert et
    /// al., *Visual Place Recognition: A Tutorial*, 2023).
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `level` is not from 0 to 1.
    pub fn recall_at_precision(&self, level: f64) -> Result<f64, OutOfRange> {
        OutOfRange::check("the level", level, 0.0..=1.0, "a value from 0 to 1")?;
        // The recall never falls, so the last such point has the largest.
        let last = self.points.iter().rev().find(|point| point.precision >= level);
        Ok(last.map_or(0.0, |point| point.recall))
    }
}

/// Numbers of samples labelled true and false whose score is at least the threshold.
struct Cut {
    threshold: f64,
    counts: [usize; 2],
}

/// Cuts at each score, highest first, with ties together. O(N log N).
fn cuts(what: &'static str, samples: &[(f64, bool)]) -> Result<Vec<Cut>, OutOfRange> {
    if let Some(index) = samples.iter().position(|(score, _)| score.is_nan()) {
        return Err(OutOfRange::new(format!("{what} {index}"), f64::NAN, "a number"));
    }
    let mut sorted = samples.to_vec();
    sorted.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut counts = [0, 0];
    // Ties are equal as numbers, not in the total order, where 0 is above -0.
    let cut = |ties: &[(f64, bool)]| {
        ties.iter().for_each(|(_, label)| counts[usize::from(!label)] += 1);
        Cut { threshold: ties[0].0, counts }
    };
    Ok(sorted.chunk_by(|a, b| a.0 == b.0).map(cut).collect())
}
