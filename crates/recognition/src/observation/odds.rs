//! Odds of a place, given a score (`guide::formulas`, Match odds), in loops that vectorise:
//! exponential and logarithm are polynomials.

use std::f32::consts::{LN_2, LOG2_E};

use super::error::ViewError;
use wayfix::error::Parameter;
use wayfix_kernels::{Simd, WithSimd, run};

/// Odds that a reference with a given [score](super::Standardizer) is the right one, against a
/// wrong one:
///
/// o(z) = ((1 − e) exp(−s (z − z₀)) + e)^(1/τ).
///
/// Scores in standard deviations of each reference have much the same odds whatever the descriptor
/// and the season: on eleven recordings and descriptors, from 16 × 32 pixels to networks, they fell
/// by two nats for each unit from −3 to 0, and were even near −1.15. So they need no labels. Beyond
/// three deviations scores are logarithms of distances, so the odds of a very near reference grow
/// as a power of its distance. With probability e a frame says nothing (it shows the inside of a
/// tunnel, or a lorry), so no frame counts against a place by more than ln e.
///
/// The **temperature** τ is for frames in sequence, which err together.
///
/// ```
/// use wayfix_recognition::observation::MatchOdds;
///
/// let single = MatchOdds::default().with_temperature(1.0)?;
/// assert!((single.log_odds(-1.15)).abs() < 1e-12);
/// assert!(single.log_odds(-3.0) > 3.5 && single.log_odds(5.0) > -3.1);
/// # Ok::<(), wayfix_recognition::observation::ViewError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOdds {
    pub(crate) slope: f64,
    pub(crate) even: f64,
    pub(crate) nothing: f64,
    pub(crate) temperature: f64,
}

impl Default for MatchOdds {
    /// s = 2, z₀ = −1.15, e = 0.05, and a temperature of 1.8.
    fn default() -> Self {
        Self { slope: 2.0, even: -1.15, nothing: 0.05, temperature: 1.8 }
    }
}

impl MatchOdds {
    /// Sets the temperature: above 1 for frames in sequence, 1 for single ones.
    ///
    /// # Errors
    ///
    /// [`ViewError::Parameter`] unless it is from 0.01 to 1000.
    pub fn with_temperature(self, temperature: f64) -> Result<Self, ViewError> {
        Parameter::check("the temperature", temperature, 0.01..=1000.0, "from 0.01 to 1000")?;
        Ok(Self { temperature, ..self })
    }

    /// Sets the probability that a frame says nothing.
    ///
    /// # Errors
    ///
    /// [`ViewError::Parameter`] unless it is from 1e-12 to 1.
    pub fn with_nothing(self, nothing: f64) -> Result<Self, ViewError> {
        let what = "the probability that a frame says nothing";
        Parameter::check(what, nothing, 1e-12..=1.0, "from 1e-12 to 1")?;
        Ok(Self { nothing, ..self })
    }

    /// Checks that all parameters give finite odds.
    #[cfg(feature = "serde")]
    pub(crate) fn checked(self) -> Result<Self, ViewError> {
        let Self { slope, even, nothing, temperature } = self;
        Parameter::check("the slope of the odds", slope, 0.0..=100.0, "from 0 to 100")?;
        Parameter::check("the score with even odds", even, -100.0..=100.0, "from -100 to 100")?;
        self.with_nothing(nothing)?.with_temperature(temperature)
    }

    /// Temperature.
    #[must_use]
    pub fn temperature(&self) -> f64 {
        self.temperature
    }

    /// Probability that a frame says nothing.
    #[must_use]
    pub fn nothing(&self) -> f64 {
        self.nothing
    }

    /// Log-odds of a score, divided by the temperature; −∞ for an infinite score, which belongs to
    /// a reference that is surely wrong.
    #[must_use]
    pub fn log_odds(&self, score: f64) -> f64 {
        if score == f64::INFINITY {
            return f64::NEG_INFINITY;
        }
        let says = (-self.slope * (score - self.even)).min(LARGEST_LOG_ODDS).exp();
        ((1.0 - self.nothing) * says + self.nothing).ln() / self.temperature
    }

    /// Replaces scores of the references by odds to the power of `weight`, within 1e-5 of
    /// [`log_odds`](Self::log_odds).
    pub(crate) fn odds_of(&self, weight: f64, scores: &mut [f64]) {
        run(Odds { log2_odds: self.log2_odds(), weight: weight as f32, scores });
    }

    /// log2 of the odds of each score.
    pub(crate) fn log2_odds_of(&self, scores: &[f64], out: &mut [f32]) {
        let log2_odds = self.log2_odds();
        out.iter_mut().zip(scores).for_each(|(out, score)| *out = log2_odds.of(*score));
    }

    fn log2_odds(&self) -> Log2Odds {
        let slope = self.slope as f32 * LOG2_E;
        Log2Odds {
            slope,
            even: slope * self.even as f32,
            nothing: self.nothing as f32,
            cooling: (1.0 / self.temperature) as f32,
        }
    }
}

/// Logarithm of the highest odds of a single frame, within the range of 32-bit floats: no score
/// that a real row gives reaches it.
const LARGEST_LOG_ODDS: f64 = 80.0;

/// Parameters of [`MatchOdds`], for logarithms to base 2.
#[derive(Clone, Copy)]
struct Log2Odds {
    slope: f32,
    even: f32,
    nothing: f32,
    cooling: f32,
}

impl Log2Odds {
    /// log2 of the odds of a score; −∞ for an infinite one.
    #[inline(always)]
    fn of(self, score: f64) -> f32 {
        let says = (self.even - self.slope * score as f32).min(LARGEST_LOG_ODDS as f32 * LOG2_E);
        // Below −126, 2^x would not be a normal number; the sum with `nothing`, at least 1e-12,
        // does not show it.
        let says = single_exp2(says.max(-126.0));
        let log2 = single_log2((1.0 - self.nothing) * says + self.nothing) * self.cooling;
        if score == f64::INFINITY { f32::NEG_INFINITY } else { log2 }
    }
}

struct Odds<'a> {
    log2_odds: Log2Odds,
    weight: f32,
    scores: &'a mut [f64],
}

impl WithSimd for Odds<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { log2_odds, weight, scores } = self;
        let (whole, rest) = scores.as_chunks_mut::<WIDTH>();
        whole.iter_mut().for_each(|scores| odds(log2_odds, weight, scores));
        // The rest, padded to a full width, goes through the same operations.
        let mut last = [0.0; WIDTH];
        last[..rest.len()].copy_from_slice(rest);
        odds(log2_odds, weight, &mut last);
        rest.copy_from_slice(&last[..rest.len()]);
    }
}

/// Number of scores handled side by side.
const WIDTH: usize = 16;

/// Turns scores into odds, in loops that each work on numbers of one type, so that they vectorise.
#[inline(always)]
fn odds(log2_odds: Log2Odds, weight: f32, scores: &mut [f64; WIDTH]) {
    let (mut log2, mut power, mut exponent) = ([0.0; WIDTH], [0.0; WIDTH], [0; WIDTH]);
    for l in 0..WIDTH {
        log2[l] = log2_odds.of(scores[l]);
    }
    for l in 0..WIDTH {
        // Within the range of normal doubles: the exponent below is put together from bits.
        (power[l], exponent[l]) = exp2_in_parts((weight * log2[l]).clamp(-1020.0, 1000.0));
    }
    for l in 0..WIDTH {
        let scale = f64::from_bits(((i64::from(exponent[l]) + 1023) << 52).cast_unsigned());
        let odds = f64::from(power[l]) * scale;
        scores[l] = if log2[l] == f32::NEG_INFINITY { 0.0 } else { odds };
    }
}

/// 1.5 × 2^23: 32-bit floats around it are whole numbers, given by their low bits.
const WHOLE: f32 = 12_582_912.0;

/// 2^x as a factor from 0.7 to 1.42 and an exponent, for |x| < 2^21, to 2e-7.
#[inline(always)]
fn exp2_in_parts(x: f32) -> (f32, i32) {
    // Adding `WHOLE` rounds x to a whole number, which the low bits then hold.
    let shifted = x + WHOLE;
    let exponent = shifted.to_bits().cast_signed() - WHOLE.to_bits().cast_signed();
    // Taylor's series at (x − exponent) ln 2, which is at most ln 2 / 2.
    let y = (x - (shifted - WHOLE)) * LN_2;
    let tail = 1.0 / 24.0 + y * (1.0 / 120.0 + y * (1.0 / 720.0));
    (1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * tail))), exponent)
}

/// 2^x, for x from −126 to 127.
#[inline(always)]
fn single_exp2(x: f32) -> f32 {
    let (power, exponent) = exp2_in_parts(x);
    power * f32::from_bits(((exponent + 127) << 23).cast_unsigned())
}

/// ln(1 + x), for x of at least 0.
#[inline(always)]
pub(super) fn ln_1p(x: f32) -> f32 {
    single_log2((1.0 + x).min(f32::MAX)) * LN_2
}

/// log2 of a normal number above 0, to an absolute or relative error of 2e-7.
#[inline(always)]
fn single_log2(x: f32) -> f32 {
    // The bits of √½, the smallest mantissa: with mantissas from √½ to √2, the logarithm near 1
    // does not cancel with an exponent.
    const ROOT: i32 = 0x3f35_04f3;
    let bits = x.to_bits().cast_signed();
    let exponent = (bits - ROOT) >> 23;
    let mantissa = f32::from_bits((bits - (exponent << 23)).cast_unsigned());
    // ln m = 2 artanh((m − 1) / (m + 1)).
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let series = 1.0 + square * (1.0 / 3.0 + square * (0.2 + square * (1.0 / 7.0)));
    exponent as f32 + t * series * (2.0 * LOG2_E)
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] MatchOdds: [], |odds| {
        slope: f64 = odds.slope,
        even: f64 = odds.even,
        nothing: f64 = odds.nothing,
        temperature: f64 = odds.temperature,
    } => Self { slope, even, nothing, temperature }.checked();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_of_rows_are_those_of_the_definition() {
        for temperature in [0.01, 0.5, 1.0, 2.5, 10.0] {
            let odds = MatchOdds::default().with_temperature(temperature).unwrap();
            let scores: Vec<f64> = (-900..900).map(|k| f64::from(k) * 0.0123).collect();
            let (mut row, mut logs) = (scores.clone(), vec![0.0; scores.len()]);
            odds.log2_odds_of(&scores, &mut logs);
            odds.odds_of(1.0, &mut row);
            for ((score, found), log2) in scores.iter().zip(row).zip(logs) {
                let exact = odds.log_odds(*score);
                let bound = 1e-6 + 3e-6 / temperature + 3e-7 * exact.abs();
                // Odds stay within the range of doubles.
                let most = exact.min(1000.0 * std::f64::consts::LN_2);
                assert!((found.ln() - most).abs() < bound, "{temperature}: {score} {found}");
                assert!((f64::from(log2 * LN_2) - exact).abs() < bound);
            }
        }
        let mut row = [f64::INFINITY, 1e30, -1e30];
        MatchOdds::default().odds_of(1.0, &mut row);
        assert!(row[0] == 0.0 && row[2] > 10.0);
        assert!((row[1].ln() - 0.05_f64.ln() / 1.8).abs() < 1e-5);
        // A weight is a power.
        let mut half = [-2.0, 1.0];
        MatchOdds::default().odds_of(0.5, &mut half);
        let exact = |score: f64| 0.5 * MatchOdds::default().log_odds(score);
        assert!((half[0].ln() - exact(-2.0)).abs() < 1e-5);
        assert!((half[1].ln() - exact(1.0)).abs() < 1e-5);
        assert_eq!(MatchOdds::default().log_odds(f64::INFINITY), f64::NEG_INFINITY);
    }

    #[test]
    fn invalid_temperatures_are_errors() {
        assert!(MatchOdds::default().with_temperature(0.0).is_err());
        assert!(MatchOdds::default().with_temperature(f64::NAN).is_err());
        assert!(MatchOdds::default().with_nothing(0.0).is_err());
    }
}
