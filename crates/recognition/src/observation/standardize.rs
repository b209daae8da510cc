//! Loops of the [`Standardizer`](super::Standardizer): W, B, m_i, u and s_i of section 11 of the
//! guide, Usual scores.

use super::Standardizer;
use super::rows::within;
use wayfix_kernels::{LANES, Simd, WithSimd};

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

/// Adds a query's scores within its row to the sums, and the squared differences of neighbours to
/// theirs.
pub(super) struct CountIn<'a> {
    pub(super) spread: Spread,
    pub(super) rows: &'a [f32],
    pub(super) weight: f64,
    pub(super) known: &'a mut Standardizer,
}

impl WithSimd for CountIn<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { spread, rows, weight, known: Standardizer { sums, squares, steps, .. } } = self;
        // Clipped about the usual score, which is that of before this query: a score cannot widen
        // its own bounds.
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
            // Clipped scores again, so that neighbours at extreme distances do not rule the
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
    pub(super) within: f64,
    /// Factor that turns a sum of scores into the usual score.
    pub(super) mean_share: f64,
    /// Variance u of the usual score about the true one.
    unsure: f64,
}

/// Estimates variances.
pub(super) struct Usual<'a>(pub(super) &'a Standardizer);

impl WithSimd for Usual<'_> {
    type Output = Spread;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Spread {
        let &Standardizer { count: n, ref sums, ref squares, .. } = self.0;
        let part = if n > 0.0 { 1.0 / n } else { 0.0 };
        let (mut within, mut all) = ([0.0; LANES], [0.0; LANES]);
        let (whole, rest) = (sums.as_chunks::<LANES>(), squares.as_chunks::<LANES>());
        let mut take = |l: usize, sum: f64, square: f64| {
            // Σ (x − mean)² = Q − S²/K, at least 0 but for rounding.
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
        // W and then B as in the guide; scores within a row have the variance 1 a priori.
        let within = (within + PRIOR_COUNT * PRIOR_WITHIN) / ((n - 1.0).max(0.0) + PRIOR_COUNT);
        let all = (all + PRIOR_COUNT) / (n + PRIOR_COUNT);
        let between = (all - within).max(LEAST_BETWEEN * all);
        let total = n * between + within;
        Spread { within, mean_share: between / total, unsure: between * within / total }
    }
}

/// Scores in units of each reference.
pub(super) struct Standardize<'a> {
    pub(super) known: &'a Standardizer,
    pub(super) spread: Spread,
    pub(super) rows: &'a [f32],
    pub(super) out: &'a mut [f64],
}

impl WithSimd for Standardize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { known, spread, rows, out } = self;
        let &Standardizer { count: n, ref sums, ref squares, .. } = known;
        let Spread { within, mean_share, unsure } = spread;
        let part = if n > 0.0 { 1.0 / n } else { 0.0 };
        let (known, prior) = (1.0 / ((n - 1.0).max(0.0) + OWN_COUNT), OWN_COUNT * within);
        for ((out, &row), (&sum, &square)) in out.iter_mut().zip(rows).zip(sums.iter().zip(squares))
        {
            // s_i² = own variance, shrunk towards W, plus that of the usual score.
            let own = ((square - sum * sum * part).max(0.0) + prior) * known;
            // Seven digits are enough, and take a quarter of the time.
            let inverse = 1.0 / ((own + unsure) as f32).sqrt();
            *out = f64::from((row - (sum * mean_share) as f32) * inverse);
        }
    }
}
