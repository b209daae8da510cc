//! Negative binomial distribution: counts of events that come in clusters, by mean and dispersion.

use rand::Rng;
use rand_distr::Distribution;

use super::Independent;
use super::poisson::{MOST, arrivals, is_count};
use super::poisson::{expectation, tails};
use super::univariate::{Cumulative, Univariate};
use crate::error::check;
use crate::special::{Odds, excess_ratio, ln_factorial, log_excess, root, stirling};
use crate::{EmissionError, Tails};

/// Negative binomial distribution of a count, a whole number from 0 to 2^53, whose variance is
/// above that of a [`Poisson`](crate::independent::Poisson) count.
///
/// With means m_c, dispersions α_c and sizes r_c = 1 / α_c, a [family](Self::family) of d counts
/// has p(y) = Π_c Γ(y_c + r_c) / (Γ(r_c) y_c!) (r_c / (r_c + m_c))^{r_c} (m_c / (r_c + m_c))^{y_c}:
/// the variance is m + α m². It is the Poisson distribution where the dispersion is 0, and the
/// geometric one where it is 1.
///
/// Learning sets each mean to the weighted mean of the counts. If their variance is not above it,
/// the dispersion is 0, which is then the maximum (Levin and Reeds, 1977). Otherwise it has no
/// finite-dimensional sufficient statistic: learning maximises a lower bound of the
/// likelihood with the same value and the same first two derivatives at the present dispersion. So
/// no step lowers the likelihood, and near the maximum each doubles the number of correct digits.
///
/// The [prior](Independent::with_prior) is that of c further observations, whose expectations are
/// summed numerically in some thousand evaluations.
///
/// ```
/// use wayfix_learn::NegativeBinomial;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     NegativeBinomial::family(&[[2.0], [20.0]], &[[0.5], [0.5]])?, // means, then dispersions
/// )?;
/// assert_eq!(hmm.viterbi(&[[0.0], [7.0], [1.0], [14.0], [51.0]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NegativeBinomial {
    mean: f64,
    dispersion: f64,
    ln_mean: f64,
    /// ln(1 + α m)
    ln_spread: f64,
    /// Logarithm of the probability of 0.
    log_zero: f64,
    /// Error of Stirling's formula for the size.
    stirling_error_of_size: f64,
}

/// Largest count whose rising factorial is computed as a product.
const PRODUCT: f64 = 16.0;

impl NegativeBinomial {
    /// Creates the distribution with this mean and dispersion.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the mean is from 0 to 2^53 and the dispersion from 0 to
    /// 1e100.
    pub fn new(mean: f64, dispersion: f64) -> Result<Self, EmissionError> {
        let valid = (0.0..=MOST).contains(&mean);
        let mean = check("mean", mean, valid, "a value from 0 to 2^53")?;
        let valid = (0.0..=1e100).contains(&dispersion);
        let dispersion = check("dispersion", dispersion, valid, "a value from 0 to 1e100")?;
        let spread = dispersion * mean;
        let ln_spread = spread.ln_1p();
        // −ln(1 + α m) / α = −m (1 − α m / 2 + …): for so small a spread α m the second term is
        // below the last digit, and the quotient may underflow.
        let log_zero = if spread < 1e-16 { -mean } else { -ln_spread / dispersion };
        let stirling_error_of_size =
            if dispersion == 0.0 { 0.0 } else { stirling(dispersion.recip()) };
        Ok(Self {
            mean,
            dispersion,
            ln_mean: mean.ln(),
            ln_spread,
            log_zero,
            stirling_error_of_size,
        })
    }

    /// Creates a family from one row for each state, with the mean of each component, and one with
    /// the dispersions.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a mean outside 0
    /// to 2^53, or a dispersion outside 0 to 1e100.
    pub fn family(
        means: &[impl AsRef<[f64]>],
        dispersions: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        Independent::of_two(["list of means", "list of dispersions"], means, dispersions, Self::new)
    }

    /// Mean m.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Dispersion α. The size is 1 / α, the variance m + α m².
    #[must_use]
    pub fn dispersion(&self) -> f64 {
        self.dispersion
    }

    /// Log probability of a count above `PRODUCT` in saddle-point form (Loader, 2000): deviations
    /// of y and r from their expectations given y + r. `rest` is ln(y!) − y (ln y − 1).
    fn saddle_point_log_probability(&self, y: f64, rest: f64) -> f64 {
        // Stirling's formula for the gamma functions, with its errors Δ, leaves
        // Δ(r + y) − Δ(r) − rest − ½ ln(1 + α y) + r ln(1 + u) + y ln(1 + v), where
        // 1 + u = (r + y) / (r + m) and 1 + v = m (r + y) / (y (r + m)). As r u = −y v = d, the
        // last two terms are −r (u − ln(1 + u)) − y (v − ln(1 + v)), and nothing cancels. Where
        // 1 + u or 1 + v is small its logarithm comes from those of its factors.
        let Self { mean, dispersion, .. } = *self;
        let ln_grown = (dispersion * y).ln_1p();
        let d = (y - mean) / (1.0 + dispersion * mean);
        let (u, v) = (dispersion * d, -d / y);
        let of_size = if u < -0.5 {
            (u - (ln_grown - self.ln_spread)) / dispersion
        } else {
            d * u * excess_ratio(u)
        };
        let of_count = if v < -0.5 {
            v - (self.ln_mean - y.ln() + ln_grown - self.ln_spread)
        } else {
            log_excess(v)
        };
        let errors = if dispersion == 0.0 {
            0.0
        } else {
            stirling(dispersion.recip() + y) - self.stirling_error_of_size
        };
        errors - rest - 0.5 * ln_grown - of_size - y * of_count
    }
}

impl Univariate for NegativeBinomial {
    const VALUES: &'static str = "a whole number from 0 to 2^53";
    const HAS_ZERO: bool = true;
    const EXACT: bool = false;
    /// The count y, with ln(y!) and ln(y!) − y (ln y − 1).
    type Point = (f64, (f64, f64));
    /// 1, y, (y − m)², the sums of j / (1 + α j) and of its square over j < y, and the log density.
    type Statistics = [f64; 6];

    fn point(value: f64) -> Option<Self::Point> {
        is_count(value).then(|| (value, ln_factorial(value)))
    }

    fn log_density(&self, &(y, (ln_factorial, rest)): &Self::Point) -> f64 {
        if y == 0.0 {
            self.log_zero
        } else if self.mean == 0.0 {
            f64::NEG_INFINITY
        } else if y > PRODUCT {
            self.saddle_point_log_probability(y, rest)
        } else {
            // Γ(y + r) / Γ(r) = r^y Π (1 + α j) over j < y, also for α = 0. The logarithm is taken
            // before the product overflows.
            let (mut log, mut product, mut j) = (0.0, 1.0_f64, 1.0);
            while j < y {
                product *= 1.0 + self.dispersion * j;
                if product > 1e150 {
                    log += product.ln();
                    product = 1.0;
                }
                j += 1.0;
            }
            log += product.ln();
            log - ln_factorial + y * (self.ln_mean - self.ln_spread) + self.log_zero
        }
    }

    fn statistics(&self, point: &Self::Point) -> [f64; 6] {
        let y = point.0;
        let [first, second] = sums(y, self.dispersion);
        [1.0, y, (y - self.mean).powi(2), first, second, self.log_density(point)]
    }

    fn expectations(&self, of: &Self) -> [f64; 6] {
        let (mean, spread) = (of.mean, 1.0 + of.dispersion * of.mean);
        let point = |y| (y, ln_factorial(y));
        // The standard deviation, and 1 + α m, the length over which the tail falls by a factor of
        // about e.
        let scales = [(mean * spread).sqrt(), spread];
        let all = expectation(
            mean,
            scales,
            |y| of.log_density(&point(y)),
            |y| {
                let [_, _, _, first, second, log] = self.statistics(&point(y));
                [first, second, log]
            },
        );
        let square = mean * spread + (mean - self.mean).powi(2);
        [1.0, mean, square, all[0], all[1], all[2]]
    }

    fn expected_log_density(&self, expectations: &[f64; 6]) -> f64 {
        expectations[5]
    }

    fn maximize(&self, sums: &[f64; 6]) -> Result<Self, EmissionError> {
        let [_, mean, square, first, second, _] = sums.map(|sum| sum / sums[0]);
        // The mean is at its maximum whatever the dispersion; the bound is for this mean.
        let variance = square - (mean - self.mean).powi(2);
        let dispersion = if mean == 0.0 {
            self.dispersion
        } else {
            maximize(self.dispersion, mean, variance, [first, second])
        };
        Self::new(mean, dispersion)
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // A Poisson count whose rate has a gamma distribution. With a dispersion below 1e-40 no
        // rate but the mean is ever drawn. Draws above the largest count become the largest count.
        let rate = if self.dispersion < 1e-40 {
            self.mean
        } else {
            let (size, scale) = (self.dispersion.recip(), self.dispersion * self.mean);
            rand_distr::Gamma::new(size, scale).map_or(self.mean, |rates| rates.sample(rng))
        };
        rand_distr::Poisson::new(rate.min(MOST)).map_or(0.0, |counts| counts.sample(rng)).min(MOST)
    }
}

impl Cumulative for NegativeBinomial {
    /// O(1): an incomplete beta function on either side, in some hundred evaluations each.
    fn tails(&self, y: f64) -> Tails {
        // P(Y ≤ y) = P(X ≤ r / (r + m)) for X ~ Beta(r, y + 1), whose mode has odds r / (y + 1):
        // relative to it, the log-odds are ln((y + 1) / m).
        let size = self.dispersion.recip();
        tails(y, self, |y| {
            // Below this dispersion y + r rounds to r, and the counts are Poisson.
            if self.dispersion < 1e-100 {
                return arrivals(y, self.mean);
            }
            let ratio = (y + 1.0) / self.mean;
            let in_logs = || (y + 1.0).ln() - self.ln_mean;
            let odds = if ratio.is_finite() { ratio.ln() } else { in_logs() };
            Odds::beta(size, y + 1.0).tail_probabilities(odds)
        })
    }
}

// Dispersion of negative binomial counts: its sums and its M step.
//
// At the mean m of the counts, the log-likelihood of a dispersion α per observation is, up to a
// constant,
//
// ```text
// L(α) = Σ_j S_j ln(1 + α j) − (m + 1/α) ln(1 + α m),
// ```
//
// where S_j is the share of counts above j. From the present dispersion a to α = a + u, with
// x_j = j / (1 + a j) from 0 to 1 / a, the first sum grows by Σ_j S_j x_j H(x_j), where
// H(x) = ln(1 + u x) / x has a second derivative of the sign of u. So a quadrature for the measure
// S_j x_j that is exact for linear functions bounds it from below: for u > 0 the Gauss rule with
// one node, for u < 0 the Lobatto rule with nodes at the ends 0 and 1 / a. Both need only the
// sums of S_j x_j and S_j x_j², the first two derivatives at a (up to sign).

/// Integral of (j / (1 + α j))² from 0 to y, divided by y³, as a function of z = α y < 1.
///
/// It is (z − 2 ln(1 + z) + z / (1 + z)) / z³, by the series of ln(1 + z) = 2 artanh(z / (2 + z)).
fn square_ratio(z: f64) -> f64 {
    let v = z / (2.0 + z);
    let square = v * v;
    // With v = z / (2 + z), z + z / (1 + z) = 4 Σ v^(2k+1), and 2 ln(1 + z) is the same sum with
    // terms divided by 2k + 1. Those of k = 0 cancel, and what remains is
    // 4 v³ Σ v^2k (2k + 2) / (2k + 3). v³ / z³ is (2 + z)⁻³.
    let (mut sum, mut power, mut even) = (0.0, 1.0, 2.0);
    while power > 1e-18 {
        sum += power * even / (even + 1.0);
        power *= square;
        even += 2.0;
    }
    4.0 * sum / (2.0 + z).powi(3)
}

/// Antiderivatives at y of x = j / (1 + α j) and of x², with the Euler–Maclaurin corrections
/// −f/2 + f'/12 − f'''/720 + f⁽⁵⁾/30240.
fn summed(y: f64, alpha: f64) -> [f64; 2] {
    let z = alpha * y;
    let r = alpha.recip();
    // For small z the logarithm cancels against z, so series are used.
    let integrals = if z < 1.0 {
        [y * y * excess_ratio(z), y.powi(3) * square_ratio(z)]
    } else {
        [log_excess(z) * r * r, (z - 2.0 * z.ln_1p() + z / (1.0 + z)) * r.powi(3)]
    };
    // Derivatives of x = j t with t = 1 / (1 + α j), in terms of t, x and b = α t.
    let t = (1.0 + z).recip();
    let (x, b) = (y * t, alpha * t);
    let slopes = [t * t, 2.0 * x * t * t];
    let thirds = [6.0 * (b * t).powi(2), 12.0 * b * (1.0 - 2.0 * t) * t.powi(3)];
    let fifths = [120.0 * (b * b * t).powi(2), 240.0 * b.powi(3) * (1.0 - 3.0 * t) * t.powi(3)];
    let values = [x, x * x];
    std::array::from_fn(|k| {
        integrals[k] - 0.5 * values[k] + slopes[k] / 12.0 - thirds[k] / 720.0 + fifths[k] / 30240.0
    })
}

/// Sums of j / (1 + α j) and of its square over the whole numbers j below y. O(1).
fn sums(y: f64, alpha: f64) -> [f64; 2] {
    // The Euler–Maclaurin terms fall with powers of j + 1 / α: sum one by one until that is 16.
    let first = if y <= 32.0 { y } else { (16.0 - alpha.recip()).clamp(0.0, 16.0).ceil() };
    let (mut sums, mut j) = ([0.0; 2], 1.0);
    while j < first {
        let x = j / (1.0 + alpha * j);
        sums[0] += x;
        sums[1] += x * x;
        j += 1.0;
    }
    if y > first {
        let (low, high) = (summed(first, alpha), summed(y, alpha));
        sums = std::array::from_fn(|k| sums[k] + (high[k] - low[k]));
    }
    sums
}

/// Returns the dispersion that maximises the bound, from the present dispersion, the mean and
/// variance of the counts, and the means of their [`sums`] at the present dispersion.
fn maximize(present: f64, mean: f64, variance: f64, [first, second]: [f64; 2]) -> f64 {
    // Without overdispersion, the likelihood is maximal at a dispersion of 0 (Levin and Reeds
    // 1977).
    if variance <= mean {
        return 0.0;
    }
    // Derivative of (m + 1/α) ln(1 + α m) with respect to α, m² (z − ln(1 + z)) / z² with z = α m,
    // and the derivative of that with respect to ln α.
    let falls = |alpha: f64| {
        let slope = mean * mean * excess_ratio(alpha * mean);
        (slope, mean * mean / (1.0 + alpha * mean) - 2.0 * slope)
    };
    if first > falls(present).0 {
        // The likelihood rises with α. Gauss rule: the whole measure is at its mean x, so the sum
        // has the derivative first / (1 + u x).
        let x = second / first;
        let start = if present > 0.0 { present } else { (variance - mean) / mean / mean };
        root(start, |alpha| {
            let (slope, curvature) = falls(alpha);
            let ratio = first / (1.0 + (alpha - present) * x);
            (slope - ratio, curvature + ratio * ratio * x * alpha / first)
        })
    } else if present > 0.0 {
        // The likelihood falls with α. Lobatto rule: the weight a · second at 1 / a gives the right
        // first moment, and the rest of the measure is at 0. Their derivatives are weight · a / α
        // and the rest itself.
        let at_end = present * second;
        root(present, |alpha| {
            let (slope, curvature) = falls(alpha);
            let ratio = at_end * (present / alpha);
            (slope - (first - at_end) - ratio, curvature + ratio)
        })
    } else {
        present
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] NegativeBinomial for Independent<self::NegativeBinomial>: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(self::NegativeBinomial::mean),
        dispersions: Vec<Vec<f64>> = family.parameters(self::NegativeBinomial::dispersion),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::NegativeBinomial>, f64)> = family.prior(),
    } => self::NegativeBinomial::family(&means, &dispersions)
        .and_then(|new| crate::independent::with_settings(new, missing, prior));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums computed with 50 digits.
    #[test]
    #[expect(clippy::excessive_precision, reason = "digits as they were computed")]
    fn sums_are_those_of_their_terms() {
        for (y, alpha, first, second) in [
            (0.0, 1.0, 0.0, 0.0),
            (5.0, 0.3, 5.416_359_955_833_640, 7.953_075_892_542_071),
            (32.0, 2.0, 14.642_678_347_006_246, 6.949_150_518_431_722),
            (33.0, 2.0, 15.134_986_039_313_938, 7.191_517_382_337_048),
            (33.0, 1e-9, 527.999_988_560_000_3, 11_439.999_442_432_022),
            (1000.0, 1e-12, 499_499.999_667_166_5, 332_833_499.500_999_5),
            (1000.0, 0.001, 306_602.756_940_062_5, 113_580_659.713_426_05),
            (1000.0, 0.04, 22_666.739_065_922_108, 523_897.335_108_278_6),
            (1000.0, 3.0, 332.217_819_731_097_07, 110.492_060_030_099_48),
            (1000.0, 1e50, 9.99e-48, 9.99e-98),
            (20_000.0, 1e-4, 90_135_437.725_781_62, 469_419_867_231.681_8),
        ] {
            let found = sums(y, alpha);
            for (found, expected) in found.into_iter().zip([first, second]) {
                let off = (found - expected).abs();
                assert!(off <= 1e-12 * expected, "{y}, {alpha}: {found}, not {expected}");
            }
        }
    }
}
