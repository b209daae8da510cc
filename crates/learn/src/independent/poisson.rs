//! Poisson distribution: counts of events.

use rand::Rng;
use rand_distr::Distribution;

use super::counts::tails;
use super::family::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::check::check;
use crate::special::{INTEGERS, Odds, ln_factorial, log_excess};
use crate::{EmissionError, Tails};

/// Largest count: whole numbers up to it are doubles.
pub(super) const MOST: f64 = 9_007_199_254_740_992.0;

/// Count below which its logarithmic probability is a plain sum; above, that would lose digits.
const PLAIN: f64 = 64.0;

/// Poisson distribution of a count, a whole number from 0 to 2^53.
///
/// A [family](Self::family) of d counts has p(y) = Π_c λ_c^{y_c} exp(−λ_c) / y_c!. A rate of 0 is a
/// component that is always 0. Learning sets each rate to the weighted mean of the counts.
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
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// rate that is not from 0 to 2^53.
    pub fn family<R: AsRef<[f64]>>(rates: &[R]) -> Result<Independent<Self>, EmissionError> {
        Independent::of_one("list of rates", rates, Self::new)
    }

    /// Mean of the counts, λ.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.rate
    }
}

/// Probabilities of up to y counts, and of more: the time until the next one after y has a gamma
/// distribution.
pub(super) fn arrivals(y: f64, rate: f64) -> [f64; 2] {
    let [until, after] = Odds::gamma(y + 1.0).sides((rate / (y + 1.0)).ln());
    [after, until]
}

/// Returns true for a whole number from 0 to 2^53.
#[inline]
pub(crate) fn is_count(value: f64) -> bool {
    // There is no instruction for the fraction on every processor, and a cast is checked. Beside 2^52
    // there is no room for one.
    let is_whole = value >= INTEGERS || (value + INTEGERS) - INTEGERS == value;
    (0.0..=MOST).contains(&value) && is_whole
}

/// Logarithm of the probability of a count y in a Poisson distribution, of which ln(y!), and that
/// less y (ln y − 1), are known.
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

/// A function of its own, since its logarithm would otherwise be computed for small counts, too.
#[cold]
fn log_probability_of_many(y: f64, rest: f64, rate: f64, ln_rate: f64) -> f64 {
    if rate < 0.1 * y {
        y * (ln_rate - y.ln()) + (y - rate) - rest
    } else {
        -y * log_excess((rate - y) / y) - rest
    }
}

impl Univariate for Poisson {
    const VALUES: &'static str = "a whole number from 0 to 2^53";
    const HAS_ZERO: bool = true;
    /// The count y, with ln(y!), and that less y (ln y − 1).
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
        // A rate of 0 is no Poisson distribution there; a draw above the largest count is that one.
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

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Poisson for Independent<self::Poisson>: [], |family| {
        rates: Vec<Vec<f64>> = family.parameters(self::Poisson::rate),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Poisson>, f64)> = family.prior(),
    } => self::Poisson::family(&rates).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
