//! Poisson distribution: counts of events, ln p(y) = y ln λ − λ − ln y!.
//!
//! For large counts the three terms cancel. With ln y! = y (ln y − 1) + rest, where the rest is
//! known to all its digits, ln p(y) = −y (u − ln(1 + u)) − rest with u = (λ − y) / y (Loader 2000).

use rand::Rng;
use rand_distr::Distribution;

use super::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::error::check;
use crate::special::{Odds, TWO_POW_52, ln_factorial, log_excess};
use crate::{EmissionError, Tails};

/// Largest count, 2^53: every whole number up to it is a double.
pub(super) const MOST: f64 = 9_007_199_254_740_992.0;

/// Count below which the log probability is a plain sum; above, that would lose digits.
const PLAIN: f64 = 64.0;

/// Poisson distribution of a count, a whole number from 0 to 2^53.
///
/// A [family](Self::family) of d counts has p(y) = Π_c λ_c^{y_c} exp(−λ_c) / y_c!. A component with
/// a rate of 0 is always 0. Learning sets each rate to the weighted mean of the counts.
///
/// The [prior](Independent::with_prior) of c observations with mean m is the gamma density of λ
/// with shape c m + 1 and rate c (Gelman et al., *Bayesian Data Analysis*, 2013).
///
/// ```
/// use wayfix_learn::{Poisson, Rows};
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Poisson::family(&[[3.0], [10.0]])?, // one rate for each state and component
/// )?;
/// let events = [2.0, 4.0, 3.0, 11.0, 9.0, 12.0];
/// let path = hmm.viterbi(&Rows::new(&events, 1)?)?;
/// assert_eq!(path.states(), [0, 0, 0, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poisson {
    rate: f64,
    ln_rate: f64,
}

impl Poisson {
    /// Creates the distribution with this mean.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the rate is from 0 to 2^53.
    pub fn new(rate: f64) -> Result<Self, EmissionError> {
        let valid = (0.0..=MOST).contains(&rate);
        let rate = check("rate", rate, valid, "a value from 0 to 2^53")?;
        Ok(Self { rate, ln_rate: rate.ln() })
    }

    /// Creates a family from one row for each state, with the rate λ of each component.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, or a rate
    /// outside 0 to 2^53.
    pub fn family<R: AsRef<[f64]>>(rates: &[R]) -> Result<Independent<Self>, EmissionError> {
        Independent::of_one("list of rates", rates, Self::new)
    }

    /// Mean of the counts, λ.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.rate
    }
}

/// Probabilities of at most y events, and of more.
pub(super) fn arrivals(y: f64, rate: f64) -> [f64; 2] {
    // In a Poisson process the (y + 1)-th event comes after a gamma time of shape y + 1: at most y
    // events up to the time `rate` means that it comes later.
    let [until, after] = Odds::gamma(y + 1.0).tail_probabilities((rate / (y + 1.0)).ln());
    [after, until]
}

/// True for a whole number from 0 to 2^53.
#[inline]
pub(crate) fn is_count(value: f64) -> bool {
    // Adding 2^52 rounds to a whole number: a double of that size has no bits for a fraction. Not
    // every processor has an instruction for rounding, and a cast costs more.
    let is_whole = value >= TWO_POW_52 || (value + TWO_POW_52) - TWO_POW_52 == value;
    (0.0..=MOST).contains(&value) && is_whole
}

/// Log probability of a count y with ln(y!) and ln(y!) − y (ln y − 1), under a rate with its
/// logarithm.
#[inline]
pub(crate) fn log_probability(
    (y, (ln_factorial, rest)): (f64, (f64, f64)),
    (rate, ln_rate): (f64, f64),
) -> f64 {
    if y == 0.0 {
        -rate
    } else if y < PLAIN {
        y * ln_rate - rate - ln_factorial
    } else {
        log_probability_of_many(y, rest, rate, ln_rate)
    }
}

/// Out of line, since the compiler would otherwise compute its logarithm for small counts as well.
#[cold]
fn log_probability_of_many(y: f64, rest: f64, rate: f64, ln_rate: f64) -> f64 {
    // For a rate far below the count, rate / y is small, and the difference of the logarithms has
    // more digits.
    if rate < 0.1 * y {
        y * (ln_rate - y.ln()) + (y - rate) - rest
    } else {
        -y * log_excess((rate - y) / y) - rest
    }
}

impl Univariate for Poisson {
    const VALUES: &'static str = "a whole number from 0 to 2^53";
    const HAS_ZERO: bool = true;
    /// The count y, with ln(y!) and ln(y!) − y (ln y − 1).
    type Point = (f64, (f64, f64));
    type Statistics = [f64; 2];

    #[inline]
    fn point(value: f64) -> Option<Self::Point> {
        is_count(value).then(|| (value, ln_factorial(value)))
    }

    #[inline]
    fn log_density(&self, &y: &Self::Point) -> f64 {
        log_probability(y, (self.rate, self.ln_rate))
    }

    #[inline]
    fn statistics(&self, &(y, _): &Self::Point) -> [f64; 2] {
        [1.0, y]
    }

    fn expectations(&self, of: &Self) -> [f64; 2] {
        [1.0, of.rate]
    }

    fn expected_log_density(&self, &[_, mean]: &[f64; 2]) -> f64 {
        if mean == 0.0 { -self.rate } else { mean * self.ln_rate - self.rate }
    }

    fn maximize(&self, &[weight, sum]: &[f64; 2]) -> Result<Self, EmissionError> {
        Self::new(sum / weight)
    }

    fn free_parameters(&self) -> usize {
        1
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // rand_distr rejects a rate of 0, whose counts are 0. Draws above the largest count become
        // the largest count.
        let draw = rand_distr::Poisson::new(self.rate).map_or(0.0, |counts| counts.sample(rng));
        draw.min(MOST)
    }
}

impl Cumulative for Poisson {
    /// O(1): an incomplete gamma function on either side, in some hundred evaluations each.
    fn tails(&self, y: f64) -> Tails {
        tails(y, self, |y| arrivals(y, self.rate))
    }
}

// Expectations over counts, also where far too many have a probability to sum over them all.

/// Log probability below which counts above the mean are negligible.
const LEAST: f64 = -100.0;

/// Expectations of functions of a count under a unimodal or falling distribution with this mean.
/// `scales` are the widths of its middle and of its tail, over which it falls by a factor of e.
///
/// Counts below 256 are summed one by one, larger ones in blocks that are small relative to the
/// count and the scales. Three numbers stand for a block, not necessarily whole ones: Gaussian
/// quadrature for a sum over consecutive integers, exact for polynomials up to degree five. Takes
/// some thousand evaluations.
pub(super) fn expectation<const N: usize>(
    mean: f64,
    scales: [f64; 2],
    log_probability: impl Fn(f64) -> f64,
    values: impl Fn(f64) -> [f64; N],
) -> [f64; N] {
    let mut sums = [0.0; N];
    let mut add = |y: f64, weight: f64| {
        let log = log_probability(y);
        if log > LEAST {
            let weight = weight * log.exp();
            sums.iter_mut().zip(values(y)).for_each(|(sum, value)| *sum += weight * value);
        }
        log
    };
    let widest = scales[0].max(scales[1]) / 16.0;
    // More than 40 deviations below the mean the probability is 0. The loop ends where the
    // upper tail is negligible.
    let mut y = (mean - 40.0 * scales[0]).floor().max(0.0);
    while y <= MOST {
        let length = widest.min(y / 32.0).floor();
        let log = if y < 256.0 || length < 4.0 {
            y += 1.0;
            add(y - 1.0, 1.0)
        } else {
            // The nodes of the Gram polynomial of degree 3 for L consecutive integers are the
            // middle and √((3 L² − 7) / 20) on either side; the weights give the variance
            // (L² − 1) / 12.
            let (middle, square) = (y + 0.5 * (length - 1.0), length * length);
            let node = ((3.0 * square - 7.0) / 20.0).sqrt();
            let share = (square - 1.0) / (24.0 * node * node);
            y += length;
            add(middle - node, share * length);
            add(middle, (1.0 - 2.0 * share) * length);
            add(middle + node, share * length)
        };
        if log <= LEAST && y > mean {
            break;
        }
    }
    sums
}

/// Tails of any number in a distribution of counts, where `sides` returns P(Y ≤ y) and P(Y > y) of
/// a count y.
pub(super) fn tails<F: Univariate>(y: f64, of: &F, sides: impl Fn(f64) -> [f64; 2]) -> Tails {
    if y < 0.0 {
        return Tails::between([0.0, 1.0]);
    }
    if y == f64::INFINITY {
        return Tails::between([1.0, 0.0]);
    }
    // The part below a count y is P(Y ≤ y − 1). Between two counts there is no probability at y
    // itself.
    let count = y.floor();
    match F::point(y).map(|y| of.log_density(&y).exp()) {
        Some(at) => {
            let below = if count == 0.0 { 0.0 } else { sides(count - 1.0)[0] };
            Tails { below, at, above: sides(count)[1] }
        }
        None => Tails::between(sides(count)),
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Poisson for Independent<self::Poisson>: [], |family| {
        rates: Vec<Vec<f64>> = family.parameters(self::Poisson::rate),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Poisson>, f64)> = family.prior(),
    } => self::Poisson::family(&rates).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
