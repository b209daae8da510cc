//! Odds of a place, given its score: a mixture of views that match clearly, weakly or not at all
//! (`guide::formulas`, Match odds). One exponential a place, a polynomial that vectorises.

use std::f32::consts::{LN_2, LOG2_E};

use super::error::ViewError;
use wayfix::error::OutOfRange;
use wayfix_kernels::{Simd, WithSimd, run};

/// Scores below this count as this: how near a single match may be is bounded.
const NEAREST: f64 = -6.0;
/// φ at a mean of −½ is `WEAK` e, and at a mean of −3⁄2 it is `CLEAR` e³, with e = exp(−z ⁄ 2).
const WEAK: f32 = 0.882_496_9;
const CLEAR: f32 = 0.324_652_47;

/// Odds that a view shows a place rather than another, given the [standardised
/// score](super::Standardizer::scores) z of the place:
///
/// o(z) = w₀ + w₁ φ(z, ½) + w₂ φ(z, 3⁄2), with φ(z, μ) = exp(−μ z − μ² ⁄ 2).
///
/// Scores of wrong places are about standard normal, and φ is the density of a normal distribution
/// with mean −μ over theirs. So a view matches its place clearly, weakly, or says nothing, with the
/// three shares w, and over wrong places the mean of the odds is one, but for the bound on scores
/// (to within 0.001). No view counts against a place by more than ln w₀, and none counts for it by
/// more than at a score of −6.
///
/// The means are small beside those of single views, which are −1 to −5: views in sequence err
/// together, so each is less than an independent witness. The shares differ from one camera and
/// season to the next; a [`Recognizer`](crate::Recognizer) learns them as it goes, from the default
/// of 0.1, 0.45 and 0.45.
///
/// ```
/// use wayfix_recognition::observation::MatchOdds;
///
/// let odds = MatchOdds::default();
/// assert!(odds.log_odds(-4.0) > 3.5);
/// assert!(odds.log_odds(1.0) < -0.9 && odds.log_odds(50.0) > 0.09_f64.ln());
/// # Ok::<(), wayfix_recognition::observation::ViewError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOdds {
    pub(crate) shares: [f64; 3],
}

impl Default for MatchOdds {
    /// Shares of 0.1, 0.45 and 0.45.
    fn default() -> Self {
        Self { shares: [0.1, 0.45, 0.45] }
    }
}

impl MatchOdds {
    /// Creates odds from the shares of views that say nothing, match weakly, and match clearly.
    ///
    /// # Errors
    ///
    /// [`ViewError::Parameter`] for a share that is not from 0 to 1, a first share below 1e-12, or
    /// shares whose sum is not one to within 1e-9.
    pub fn new(shares: [f64; 3]) -> Result<Self, ViewError> {
        let kinds = [
            "the share of views that say nothing",
            "the share of views that match weakly",
            "the share of views that match clearly",
        ];
        for (kind, share) in kinds.iter().zip(shares) {
            OutOfRange::check(kind, share, 0.0..=1.0, "from 0 to 1")?;
        }
        OutOfRange::check(kinds[0], shares[0], 1e-12..=1.0, "from 1e-12 to 1")?;
        let sum: f64 = shares.iter().sum();
        let one = 1.0 - 1e-9..=1.0 + 1e-9;
        OutOfRange::check("the sum of the shares of views", sum, one, "1")?;
        Ok(Self { shares })
    }

    /// Shares of views that say nothing, match weakly, and match clearly.
    #[must_use]
    pub fn shares(&self) -> [f64; 3] {
        self.shares
    }

    /// Log-odds of a score; −∞ for an infinite score, which belongs to a reference that was not
    /// compared or is surely wrong.
    #[must_use]
    pub fn log_odds(&self, score: f64) -> f64 {
        if score == f64::INFINITY {
            return f64::NEG_INFINITY;
        }
        let [nothing, weak, clear] = self.shares;
        let z = score.max(NEAREST);
        (nothing + weak * (-0.5 * z - 0.125).exp() + clear * (-1.5 * z - 1.125).exp()).ln()
    }

    /// Odds of each score.
    pub(crate) fn odds_of(&self, scores: &[f64], out: &mut [f64]) {
        run(ScoresToOdds { shares: self.shares.map(|share| share as f32), scores, out });
    }

    /// Expected numbers of views of each kind, for the probabilities of places: Σ b w φ ⁄ o.
    pub(crate) fn kinds(&self, scores: &[f64], belief: &[f64]) -> [f64; 3] {
        run(Kinds { shares: self.shares.map(|share| share as f32), scores, belief })
    }
}

/// Number of places at a time.
const WIDTH: usize = 16;

/// The terms of the odds of a score.
#[inline(always)]
fn terms([nothing, weak, clear]: [f32; 3], score: f64) -> [f32; 3] {
    // exp(−z ⁄ 2) underflows from z = 174 on, where both terms are far below `nothing`.
    let e = exp2((-0.5 * LOG2_E) * score.clamp(NEAREST, 160.0) as f32);
    [nothing, weak * WEAK * e, clear * CLEAR * (e * e * e)]
}

struct ScoresToOdds<'a> {
    shares: [f32; 3],
    scores: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for ScoresToOdds<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { shares, scores, out } = self;
        for (out, score) in out.iter_mut().zip(scores) {
            let [nothing, weak, clear] = terms(shares, *score);
            *out = if *score == f64::INFINITY { 0.0 } else { f64::from(nothing + weak + clear) };
        }
    }
}

struct Kinds<'a> {
    shares: [f32; 3],
    scores: &'a [f64],
    belief: &'a [f64],
}

impl WithSimd for Kinds<'_> {
    type Output = [f64; 3];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [f64; 3] {
        let Self { shares, scores, belief } = self;
        // Independent sums in each lane, so that they vectorise.
        let mut sums = [[0.0; WIDTH]; 3];
        let mut take = |l: usize, score: f64, belief: f64| {
            let [nothing, weak, clear] = terms(shares, score);
            let part = belief / f64::from(nothing + weak + clear);
            sums[0][l] += part * f64::from(nothing);
            sums[1][l] += part * f64::from(weak);
            sums[2][l] += part * f64::from(clear);
        };
        let (whole, rest) = (scores.as_chunks::<WIDTH>(), belief.as_chunks::<WIDTH>());
        for (scores, belief) in whole.0.iter().zip(rest.0) {
            for l in 0..WIDTH {
                take(l, scores[l], belief[l]);
            }
        }
        whole
            .1
            .iter()
            .zip(rest.1)
            .enumerate()
            .for_each(|(l, (score, belief))| take(l, *score, *belief));
        sums.map(|sums| sums.iter().sum())
    }
}

/// Largest whole number to whose precision 32-bit floats round a sum: 1.5 · 2^23.
const WHOLE: f32 = 12_582_912.0;

/// 2^x for x from −126 to 126, to 2e-7 of its value.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    // Adding `WHOLE` rounds x to a whole number, which the low bits then hold.
    let shifted = x + WHOLE;
    let exponent = shifted.to_bits().cast_signed() - WHOLE.to_bits().cast_signed();
    // Taylor's series at (x − exponent) ln 2, which is at most ln 2 / 2.
    let y = (x - (shifted - WHOLE)) * LN_2;
    let tail = 1.0 / 24.0 + y * (1.0 / 120.0 + y * (1.0 / 720.0));
    let power = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * tail)));
    power * f32::from_bits(((exponent + 127) << 23).cast_unsigned())
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] MatchOdds: [], |odds| {
        shares: [f64; 3] = odds.shares,
    } => Self::new(shares);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_of_rows_are_those_of_the_definition() {
        for shares in
            [[0.1, 0.45, 0.45], [0.3, 0.7, 0.0], [1e-12, 0.0, 1.0 - 1e-12], [1.0, 0.0, 0.0]]
        {
            let odds = MatchOdds::new(shares).unwrap();
            let mut scores: Vec<f64> = (-90..300).map(|k| 0.1 * f64::from(k)).collect();
            scores.extend([1e3, 1e30, f64::MAX, f64::INFINITY, -1e30]);
            let mut row = vec![0.0; scores.len()];
            odds.odds_of(&scores, &mut row);
            for (score, odds_of) in scores.iter().zip(&row) {
                let exact = odds.log_odds(*score).exp();
                assert!((odds_of - exact).abs() <= 3e-6 * exact, "{score}: {odds_of} and {exact}");
            }
            // The kinds of views share each place's belief.
            let belief: Vec<f64> = row.iter().map(|o| f64::from(u8::from(*o > 0.0))).collect();
            let kinds = odds.kinds(&scores, &belief);
            let places: f64 = belief.iter().sum();
            assert!((kinds.iter().sum::<f64>() - places).abs() < 1e-4);
            let clear = |z: f64| shares[2] * (-1.5 * z - 1.125).exp() / odds.log_odds(z).exp();
            let exact: f64 =
                scores.iter().filter(|z| z.is_finite()).map(|z| clear(z.max(NEAREST))).sum();
            assert!((kinds[2] - exact).abs() < 1e-4, "{kinds:?} and {exact}");
        }
    }

    #[test]
    fn odds_of_wrong_places_have_the_mean_one() {
        let (mut mean, mut all) = (0.0, 0.0);
        for k in -1000..1000 {
            let z = 0.01 * f64::from(k);
            let density = (-0.5 * z * z).exp();
            mean += density * MatchOdds::default().log_odds(z).exp();
            all += density;
        }
        // The bound on how near a match may be takes a little.
        assert!((mean / all - 1.0).abs() < 1e-3, "{}", mean / all);
    }
}
