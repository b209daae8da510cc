//! Standardised scores, in units of each reference's scores for other queries: W, B, m_i, u and s_i of
//! `guide::formulas`, Usual scores.

use super::error::ViewError;
use super::rows::{RowScratch, row_scores, within};
use wayfix::error::OutOfRange;
use wayfix_kernels::{LANES, Simd, WithSimd, run};

/// Prior, counted in queries, of the variance of one reference's scores over queries and of the
/// variance of all scores.
const PRIOR_COUNT: f64 = 3.0;
const PRIOR_WITHIN: f64 = 0.65;
/// Prior count of a reference's own variance about the mean of all, in queries.
const OWN_COUNT: f64 = 10.0;
/// Smallest share of the variance that lies between references.
const LEAST_BETWEEN: f64 = 0.02;

/// Deviations beyond which a score counts as that many in the sums, so that neither a match nor a
/// broken query becomes usual.
const CLIP: f32 = 2.5;

/// Brings the distances of a query to one scale for all references.
///
/// A distance is first scored within its row: its difference from the median, in median deviations,
/// and beyond three of them as a logarithm, up to 1000, so that a few references that are saturated
/// or broken move no other score. Then it is compared with the usual scores of its reference for
/// other queries, as in the test-normalisation of speaker recognition (Auckenthaler, Carey and
/// Lloyd-Thomas 2000). A reference that looks like everything (a dark tunnel, a plain wall) is near
/// to most queries; one with nearly constant distances is never very near to any.
///
/// The places of the queries need not be known, so it learns as the vehicle drives. It also learns
/// how far the mean of a few queries can be trusted: with a variance B between references, and W of
/// one reference over queries, n queries move the usual score by the share n B / (n B + W) of their
/// mean (empirical Bayes; Efron and Morris 1975), and the rest counts as uncertainty.
///
/// ```
/// use wayfix_recognition::observation::Standardizer;
///
/// // Reference 0 is near to everything.
/// let mut references = Standardizer::new(5)?;
/// for k in 0..30 {
///     let other = |i: usize| 0.8 + 0.02 * ((k * i) % 5) as f32;
///     references.observe(&[0.1, other(1), other(2), other(3), other(4)])?;
/// }
/// let mut scores = [0.0; 5];
/// references.scores(&[0.1, 0.4, 0.84, 0.8, 0.88], &mut scores)?;
/// assert!(scores[1] < scores[0]);
/// # Ok::<(), wayfix_recognition::observation::ViewError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Standardizer {
    /// Number of queries observed.
    pub(crate) count: f64,
    /// For each reference, the sum of its scores for these queries, and of their squares.
    pub(crate) sums: Vec<f64>,
    pub(crate) squares: Vec<f64>,
    /// For each reference, the sum of squared differences between its scores and those of the next.
    pub(crate) steps: Vec<f64>,
}

impl Standardizer {
    /// Creates a standardizer for this many references, before any query.
    ///
    /// # Errors
    ///
    /// [`ViewError::Parameter`] if there are none.
    pub fn new(references: usize) -> Result<Self, ViewError> {
        if references == 0 {
            let (what, expected) = ("the number of references", "at least 1");
            return Err(OutOfRange::new(what, 0.0, expected).into());
        }
        Ok(Self {
            count: 0.0,
            sums: vec![0.0; references],
            squares: vec![0.0; references],
            steps: vec![0.0; references],
        })
    }

    /// Checks sums read from storage.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, ViewError> {
        let Self { count, sums, squares, steps } = &self;
        Self::new(sums.len())?;
        let lengths = [
            ("the number of sums of squares", squares.len()),
            ("the number of sums of steps", steps.len()),
        ];
        if let Some(&(what, found)) = lengths.iter().find(|(_, found)| *found != sums.len()) {
            return Err(OutOfRange::new(what, found as f64, "as many as sums of scores").into());
        }
        // Far above any real count, and low enough that no variance overflows 32 bits.
        let ranges: [(_, &[f64], _, _); 4] = [
            ("the number of queries", &[*count], 0.0..=1e15, "from 0 to 1e15"),
            ("a sum of scores", sums, -1e17..=1e17, "from -1e17 to 1e17"),
            ("a sum of squared steps", steps, 0.0..=1e35, "from 0 to 1e35"),
            ("a sum of squared scores", squares, 0.0..=1e35, "from 0 to 1e35"),
        ];
        for (what, values, range, expected) in ranges {
            values
                .iter()
                .try_for_each(|value| OutOfRange::check(what, *value, range.clone(), expected))?;
        }
        Ok(self)
    }

    /// Number of references.
    #[must_use]
    pub fn references(&self) -> usize {
        self.sums.len()
    }

    /// Number of queries observed.
    #[must_use]
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Learns from a query; its place need not be known. Leave out the queries of a vehicle that
    /// stands still, which show one place again and again. O(n) time and memory.
    ///
    /// # Errors
    ///
    /// [`ViewError`] for a row of a different length, or with NaN or −∞.
    pub fn observe(&mut self, distances: &[f32]) -> Result<(), ViewError> {
        let rows = self.row_scores(distances)?;
        self.add_scores(self.spread(), &rows, 1.0);
        Ok(())
    }

    /// Reduces the weight of all queries so far to that of at most `count`: for queries from
    /// elsewhere, such as the references themselves.
    #[must_use]
    pub fn discounted(self, count: f64) -> Self {
        if !(count >= 0.0 && count < self.count) {
            return self;
        }
        // Sums and counts shrink alike, so means and variances stay; only their weight falls.
        let part = count / self.count;
        let scaled = |values: Vec<f64>| values.into_iter().map(|value| value * part).collect();
        Self {
            count,
            sums: scaled(self.sums),
            squares: scaled(self.squares),
            steps: scaled(self.steps),
        }
    }

    /// Computes the score of each reference, smaller for more alike: around 0 with a deviation of
    /// about 1 for wrong ones. Infinite distances give infinite scores. Learns nothing. O(n) time and
    /// memory.
    ///
    /// # Errors
    ///
    /// As [`observe`](Self::observe).
    ///
    /// # Panics
    ///
    /// If `out` differs in length from `distances`.
    pub fn scores(&self, distances: &[f32], out: &mut [f64]) -> Result<(), ViewError> {
        let rows = self.row_scores(distances)?;
        self.standardize(self.spread(), &rows, out);
        Ok(())
    }

    fn row_scores(&self, distances: &[f32]) -> Result<Vec<f32>, ViewError> {
        self.check(distances)?;
        let mut rows = Vec::new();
        row_scores(distances, &mut rows, &mut RowScratch::default())?;
        Ok(rows)
    }

    /// Checks the length of a row.
    pub(crate) fn check(&self, distances: &[f32]) -> Result<(), ViewError> {
        let (found, expected) = (distances.len(), self.references());
        if found == expected { Ok(()) } else { Err(ViewError::Distances { found, expected }) }
    }

    /// Learns from [row scores](row_scores), with the weight of this many queries; `spread` is the
    /// one from [before](Self::spread).
    pub(crate) fn add_scores(&mut self, spread: Spread, rows: &[f32], weight: f64) {
        self.count += weight;
        run(AddScores { spread, rows, weight, known: self });
    }

    /// Usual score of a reference within its row.
    pub(crate) fn usual(&self, spread: Spread, reference: usize) -> f32 {
        (self.sums[reference] * spread.mean_share) as f32
    }

    /// Variances of usual scores.
    pub(crate) fn spread(&self) -> Spread {
        run(EstimateSpread(self))
    }

    /// Quantile of the changes from reference to reference, on the scale of a change from view to
    /// view; 0 before any query. O(n). `scratch` is overwritten.
    #[expect(clippy::cast_sign_loss, reason = "a count times a share")]
    pub(crate) fn step_quantile(&self, share: f64, scratch: &mut Vec<f64>) -> f64 {
        let pairs = self.squares.windows(2).zip(&self.steps);
        let changes = pairs.map(|(two, step)| step / (two[0] + two[1]));
        scratch.clear();
        scratch.reserve(self.squares.len());
        // References that no query tells apart are repeated images, or broken.
        scratch.extend(changes.filter(|change| change.is_finite() && *change > 0.0));
        let at = (scratch.len() as f64 * share) as usize;
        if at >= scratch.len() {
            return 0.0;
        }
        *scratch.select_nth_unstable_by(at, f64::total_cmp).1
    }

    /// Computes [`scores`](Self::scores) from [row scores](row_scores).
    pub(crate) fn standardize(&self, spread: Spread, rows: &[f32], out: &mut [f64]) {
        assert_eq!(out.len(), rows.len(), "out must have one value per reference");
        run(Standardize { known: self, spread, rows, out });
    }
}

/// Adds a query's scores within its row to the sums, and the squared differences of neighbours to
/// theirs.
struct AddScores<'a> {
    spread: Spread,
    rows: &'a [f32],
    weight: f64,
    known: &'a mut Standardizer,
}

impl WithSimd for AddScores<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { spread, rows, weight, known: Standardizer { sums, squares, steps, .. } } = self;
        // Clipped around the usual score from before this query, so that a score cannot widen its
        // own bounds.
        let most = CLIP * (spread.within as f32).sqrt();
        for ((sum, square), &score) in sums.iter_mut().zip(squares).zip(rows) {
            let usual = (*sum * spread.mean_share) as f32;
            let clipped = score.max(usual - most).min(usual + most);
            // References at an infinite distance were not compared; they count as average.
            let score = if score.is_finite() { f64::from(clipped) } else { 0.0 };
            *sum += weight * score;
            *square += weight * score * score;
        }
        for ((step, &a), &b) in steps.iter_mut().zip(rows).zip(&rows[1..]) {
            // Clipped scores again, so that neighbours at extreme distances do not dominate the
            // threshold.
            let difference = f64::from(within(a) - within(b));
            let compared = a.is_finite() & b.is_finite();
            *step += if compared { weight * difference * difference } else { 0.0 };
        }
    }
}

/// Variances of scores, by empirical Bayes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread {
    /// Mean variance W of one reference's scores over queries.
    within: f64,
    /// Factor that turns a sum of scores into the usual score.
    mean_share: f64,
    /// Variance u of the usual score about the true one.
    mean_variance: f64,
}

/// Estimates variances.
struct EstimateSpread<'a>(&'a Standardizer);

impl WithSimd for EstimateSpread<'_> {
    type Output = Spread;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Spread {
        let &Standardizer { count: n, ref sums, ref squares, .. } = self.0;
        let part = if n > 0.0 { 1.0 / n } else { 0.0 };
        let (mut within, mut all) = ([0.0; LANES], [0.0; LANES]);
        let (whole, rest) = (sums.as_chunks::<LANES>(), squares.as_chunks::<LANES>());
        let mut take = |l: usize, sum: f64, square: f64| {
            // Σ (x − mean)² = Q − S²/K (`guide::formulas`, Usual scores), at least 0 but for
            // rounding.
            within[l] += (square - sum * sum * part).max(0.0);
            all[l] += square;
        };
        for (sums, squares) in whole.0.iter().zip(rest.0) {
            for l in 0..LANES {
                take(l, sums[l], squares[l]);
            }
        }
        whole.1.iter().zip(rest.1).for_each(|(sum, square)| take(0, *sum, *square));
        let references = sums.len() as f64;
        let within: f64 = within.iter().sum::<f64>() / references;
        let all: f64 = all.iter().sum::<f64>() / references;
        // W and then B (`guide::formulas`, Usual scores); a priori, scores within a row have the
        // variance 1.
        let within = (within + PRIOR_COUNT * PRIOR_WITHIN) / ((n - 1.0).max(0.0) + PRIOR_COUNT);
        let all = (all + PRIOR_COUNT) / (n + PRIOR_COUNT);
        let between = (all - within).max(LEAST_BETWEEN * all);
        let total = n * between + within;
        Spread { within, mean_share: between / total, mean_variance: between * within / total }
    }
}

/// Scores in units of each reference.
struct Standardize<'a> {
    known: &'a Standardizer,
    spread: Spread,
    rows: &'a [f32],
    out: &'a mut [f64],
}

impl WithSimd for Standardize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { known, spread, rows, out } = self;
        let &Standardizer { count: n, ref sums, ref squares, .. } = known;
        let Spread { within, mean_share, mean_variance } = spread;
        let part = if n > 0.0 { 1.0 / n } else { 0.0 };
        let (known, prior) = (1.0 / ((n - 1.0).max(0.0) + OWN_COUNT), OWN_COUNT * within);
        for ((out, &row), (&sum, &square)) in out.iter_mut().zip(rows).zip(sums.iter().zip(squares))
        {
            // s_i² of `guide::formulas`: the own variance, shrunk towards W, plus that of the usual
            // score.
            let own = ((square - sum * sum * part).max(0.0) + prior) * known;
            // Seven digits are enough, and take a quarter of the time.
            let inverse = 1.0 / ((own + mean_variance) as f32).sqrt();
            *out = f64::from((row - (sum * mean_share) as f32) * inverse);
        }
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Standardizer: [], |known| {
        count: f64 = known.count,
        sums: Vec<f64> = known.sums,
        squares: Vec<f64> = known.squares,
        steps: Vec<f64> = known.steps,
    } => Self { count, sums, squares, steps }.checked();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(k: u32, n: u32) -> Vec<f32> {
        let noise = |i: u32| ((k * 37 + i * 101 + k * i) % 89) as f32 / 89.0;
        (0..n).map(|i| noise(i) - if i < 4 { 0.7 } else { 0.0 }).collect()
    }

    #[test]
    fn references_come_to_the_same_mean_and_deviation() {
        let n = 40;
        let mut standard = Standardizer::new(n as usize).unwrap();
        (0..2000).for_each(|k| standard.observe(&row(k, n)).unwrap());
        let mut scores = vec![0.0; n as usize];
        let (mut sums, mut squares) = (scores.clone(), scores.clone());
        for k in 0..2000 {
            standard.scores(&row(k, n), &mut scores).unwrap();
            for (i, score) in scores.iter().enumerate() {
                sums[i] += score / 2000.0;
                squares[i] += score * score / 2000.0;
            }
        }
        assert!(sums.iter().all(|mean| mean.abs() < 0.1), "{sums:?}");
        assert!(squares.iter().all(|square| (square - 1.0).abs() < 0.2), "{squares:?}");
    }

    #[test]
    fn like_references_are_not_told_apart_by_a_few_queries() {
        // All references are alike, so that their means over ten queries are noise.
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32
        };
        let mut standard = Standardizer::new(200).unwrap();
        for _ in 0..10 {
            let alike: Vec<f32> = (0..200).map(|_| noise()).collect();
            standard.observe(&alike).unwrap();
        }
        let Spread { mean_share, .. } = standard.spread();
        // Of the prior, which expects a third of the variance between references.
        assert!(10.0 * mean_share < 0.65, "{mean_share}");
    }

    #[test]
    fn invalid_rows_are_errors() {
        let mut standard = Standardizer::new(2).unwrap();
        let before = standard.clone();
        assert!(standard.observe(&[1.0]).is_err());
        assert!(standard.scores(&[1.0, f32::NAN], &mut [0.0; 2]).is_err());
        assert!(standard.observe(&[1.0, f32::NEG_INFINITY]).is_err());
        assert_eq!(standard, before);
        let mut scores = [0.0; 2];
        standard.observe(&[1.0, f32::INFINITY]).unwrap();
        standard.scores(&[1.0, f32::INFINITY], &mut scores).unwrap();
        assert!(scores[0].is_finite() && scores[1] == f64::INFINITY);
        standard.scores(&[2.0, 2.0], &mut scores).unwrap();
        assert!(scores.iter().all(|score| score.is_finite()));
        assert!(Standardizer::new(0).is_err());
    }
}
