//! Beta distribution: shares, by their mean and their spread around it.
//!
//! With the mean m = a / s of shapes a and b, s = a + b, and the Kullback–Leibler divergence
//! D(y) = m ln(m / y) + (1 − m) ln((1 − m) / (1 − y)), Stirling's formula turns the density into
//!
//! ```text
//! ln p(y) = ½ ln(a b / 2πs) + Δ(s) − Δ(a) − Δ(b) − s D(y) − ln y − ln(1 − y)
//! ```
//!
//! where Δ is the error of the formula. D is a sum of two positive terms, and nothing cancels for
//! large shapes.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::Distribution;

use super::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::error::{LOG_DENSITY_FLOOR, check, check_spread};
use crate::special::{Odds, ln_minus_digamma, log_excess, root, stirling};
use crate::{EmissionError, Tails};

/// Beta distribution of a number between 0 and 1, such as a share or an occupancy.
///
/// With shapes a_c and b_c, a [family](Self::family) of d numbers has
/// p(y) = Π_c y_c^{a_c − 1} (1 − y_c)^{b_c − 1} Γ(a_c + b_c) / (Γ(a_c) Γ(b_c)), of y_c above 0 and
/// below 1: the mean is m = a / (a + b), the variance m (1 − m) / (a + b + 1).
///
/// Learning finds the shapes whose expected logarithms of y and of 1 − y, ψ(a) − ψ(a + b) and
/// ψ(b) − ψ(a + b), equal the observed means, to the last digits, also for large shapes.
/// Observations that are all alike determine none, an [error](EmissionError::TooFew), unless there
/// is a conjugate prior of c [observations](Independent::with_prior) with given shapes, whose
/// expected logarithms are known.
///
/// ```
/// use wayfix_learn::Beta;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Beta::family(&[[2.0], [12.0]], &[[18.0], [3.0]])?, // a road that is free, and one that is full
/// )?;
/// let occupied = [[0.04], [0.2], [0.11], [0.7], [0.85], [0.9]];
/// assert_eq!(hmm.viterbi(&occupied)?.states(), [0, 0, 0, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beta {
    shapes: [f64; 2],
    /// Sum s of the shapes.
    sum: f64,
    /// Mean of y, a / s, and of 1 − y, b / s.
    mean: [f64; 2],
    ln_mean: [f64; 2],
    /// Log density at the mean, without the terms −ln y − ln(1 − y).
    constant: f64,
}

/// A number y and 1 − y, with their logarithms.
type Pair = ([f64; 2], [f64; 2]);

impl Beta {
    /// Creates the distribution with these shapes.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless both are from 1e-100 to 1e100.
    pub fn new(alpha: f64, beta: f64) -> Result<Self, EmissionError> {
        let (is_valid, expected) = (1e-100..=1e100, "a value from 1e-100 to 1e100");
        let a = check("first shape", alpha, is_valid.contains(&alpha), expected)?;
        let b = check("second shape", beta, is_valid.contains(&beta), expected)?;
        let sum = a + b;
        let (mean, logs) = ([a / sum, b / sum], [a.ln(), b.ln(), sum.ln()]);
        let constant = 0.5 * (logs[0] + logs[1] - logs[2] - TAU.ln())
            + (stirling(sum) - stirling(a) - stirling(b));
        Ok(Self { shapes: [a, b], sum, mean, ln_mean: mean.map(f64::ln), constant })
    }

    /// Creates a family from one row for each state, with the first shape a of each component, and
    /// one with the second shapes b.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, or a shape
    /// outside 1e-100 to 1e100.
    pub fn family(
        alphas: &[impl AsRef<[f64]>],
        betas: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        let lists = ["list of first shapes", "list of second shapes"];
        Independent::of_two(lists, alphas, betas, Self::new)
    }

    /// First shape, a. The mean is a / (a + b).
    #[must_use]
    pub fn alpha(&self) -> f64 {
        self.shapes[0]
    }

    /// Second shape, b.
    #[must_use]
    pub fn beta(&self) -> f64 {
        self.shapes[1]
    }

    /// Log-odds of y relative to those of the mean, and the divergence
    /// m ln(m / y) + (1 − m) ln((1 − m) / (1 − y)).
    fn log_odds_and_divergence(&self, (y, ln): Pair) -> (f64, f64) {
        let [m, n] = self.mean;
        // y − m, by whichever of y and 1 − y has more digits.
        let above = if m < 0.5 { y[0] - m } else { n - y[1] };
        // With y = m (1 + u) and 1 − y = n (1 + v), m u + n v = 0, so that
        // D = m (u − ln(1 + u)) + n (v − ln(1 + v)). Where 1 + u is small, ln(1 + u) is the
        // difference of the logarithms instead, which has more digits.
        let part = |k: usize, u: f64| {
            let far = ln[k] - self.ln_mean[k];
            let log = if u.abs() < 0.5 { u.ln_1p() } else { far };
            (log, self.mean[k] * if u < -0.5 { u - far } else { log_excess(u) })
        };
        let ((a, first), (b, second)) = (part(0, above / m), part(1, -above / n));
        (a - b, first + second)
    }

    /// Mean whose odds are `odds` times those of the present mean.
    fn moved(&self, odds: f64) -> [f64; 2] {
        let [m, n] = self.mean;
        let total = m * odds + n;
        if total.is_finite() { [m * odds / total, n / total] } else { [1.0, n / m / odds] }
    }
}

fn pair(values: [f64; 2]) -> Pair {
    (values, values.map(f64::ln))
}

impl Univariate for Beta {
    const VALUES: &'static str = "a value above 0 and below 1";
    type Point = Pair;
    /// 1, the log-odds relative to the present mean, and the divergence from it: linear functions
    /// of 1, ln y and ln(1 − y).
    type Statistics = [f64; 3];

    fn point(value: f64) -> Option<Pair> {
        (value > 0.0 && value < 1.0).then(|| ([value, 1.0 - value], [value.ln(), (-value).ln_1p()]))
    }

    // The formula at the top: the terms of the usual form cancel where shapes are large.
    fn log_density(&self, &y: &Pair) -> f64 {
        let [ln, ln_rest] = y.1;
        (self.constant - self.sum * self.log_odds_and_divergence(y).1 - ln - ln_rest)
            .max(LOG_DENSITY_FLOOR)
    }

    #[inline]
    fn statistics(&self, &y: &Pair) -> [f64; 3] {
        let (odds, divergence) = self.log_odds_and_divergence(y);
        [1.0, odds, divergence]
    }

    fn expectations(&self, of: &Self) -> [f64; 3] {
        // For y ~ `of`, with mean m, shapes a and b, and their sum s: E ln y = ln m − (ln a − ψ(a))
        // + (ln s − ψ(s)), and likewise for 1 − y with b.
        let (odds, divergence) = self.log_odds_and_divergence((of.mean, of.ln_mean));
        let [a, b, s] = [of.shapes[0], of.shapes[1], of.sum].map(|x| ln_minus_digamma(x).0);
        [1.0, odds - a + b, divergence + (self.mean[0] * a + self.mean[1] * b - s)]
    }

    fn expected_log_density(&self, &[_, _, divergence]: &[f64; 3]) -> f64 {
        self.constant - self.sum * divergence
    }

    fn maximize(&self, sums: &[f64; 3]) -> Result<Self, EmissionError> {
        let [_, odds, divergence] = sums.map(|sum| sum / sums[0]);
        let start = odds.clamp(-700.0, 700.0).exp();
        let [m, n] = self.moved(start);
        let least = self.log_odds_and_divergence(pair([m, n])).1;
        // The divergence of the mean with these log-odds is the least possible; the excess over it
        // is the spread. Near the mean the divergence is m n δ² / 2 for a difference δ of log-odds.
        // The error of δ is some units in the last place of 1, and gives that of the divergence.
        let near = m * n;
        let size = divergence + 8.0 * (near * divergence).sqrt() + 64.0 * f64::EPSILON * near;
        let rest = check_spread("shapes", sums[0], divergence - least, size)?;
        // For a given sum s, the mean at which the expected log-odds equal the observed ones. The
        // shapes s m and s n change by n and −m in logarithms with each unit of log-odds.
        let mean_for_sum = |sum: f64| {
            let odds = root(start, |odds_ratio| {
                let mean = self.moved(odds_ratio);
                let [(a, slope_a), (b, slope_b)] = mean.map(|part| ln_minus_digamma(sum * part));
                let value = odds_ratio.ln() - a + b - odds;
                (value, 1.0 - slope_a * mean[1] - slope_b * mean[0])
            });
            self.moved(odds)
        };
        // The expected divergence at that mean falls as s grows, so its root is unique.
        let sum = root((0.5 / rest).clamp(1e-90, 1e90), |sum| {
            let mean = mean_for_sum(sum);
            let shapes = mean.map(|part| sum * part);
            let [a, b] = shapes.map(ln_minus_digamma);
            let whole = ln_minus_digamma(sum);
            let expected = self.log_odds_and_divergence(pair(mean)).1
                + (self.mean[0] * a.0 + self.mean[1] * b.0 - whole.0);
            // d / d ln s along the solutions above, by implicit differentiation: s ψ'(s) − s / (1 /
            // ψ'(a) + 1 / ψ'(b)). For large s only its leading term, since the terms cancel.
            let slope = if sum > 1e5 {
                -0.5 / sum
            } else {
                let [a, b] = [(1.0 - a.1) / shapes[0], (1.0 - b.1) / shapes[1]];
                (1.0 - whole.1) - sum * (a.recip() + b.recip()).recip()
            };
            ((divergence / expected).ln(), -slope / expected)
        });
        let [a, b] = mean_for_sum(sum).map(|part| sum * part);
        Self::new(a, b)
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let [a, b] = self.shapes;
        let drawn = rand_distr::Beta::new(a, b).map_or(f64::NAN, |draw| draw.sample(rng));
        // Shapes that are too small or too large for the algorithm leave all probability at the two
        // ends.
        let drawn = if drawn.is_nan() {
            f64::from(u8::from(rng.random::<f64>() < self.mean[0]))
        } else {
            drawn
        };
        // 0 and 1 are not valid observations: they become the nearest valid double.
        drawn.clamp(f64::from_bits(1), 1.0 - 0.5 * f64::EPSILON)
    }
}

impl Cumulative for Beta {
    /// O(1): an integral of the density of the log odds, in some hundred evaluations.
    fn tails(&self, y: f64) -> Tails {
        // `Odds` counts log-odds from those of the mean, as `log_odds_and_divergence` does.
        let u = match Self::point(y) {
            Some(y) => self.log_odds_and_divergence(y).0,
            None if y >= 1.0 => f64::INFINITY,
            None => f64::NEG_INFINITY,
        };
        Tails::between(Odds::beta(self.shapes[0], self.shapes[1]).tail_probabilities(u))
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Beta for Independent<self::Beta>: [], |family| {
        alphas: Vec<Vec<f64>> = family.parameters(self::Beta::alpha),
        betas: Vec<Vec<f64>> = family.parameters(self::Beta::beta),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Beta>, f64)> = family.prior(),
    } => self::Beta::family(&alphas, &betas).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
