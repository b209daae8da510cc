//! Counts of events.

use rand::Rng;
use rand_distr::Distribution;

use super::{Univariate, add_scaled, check};
use crate::emission::error::EmissionError;
use crate::emission::special::{ln_factorial, log_excess};

/// Largest count: whole numbers up to it are doubles.
const MOST: f64 = 9_007_199_254_740_992.0;

/// Count below which its logarithmic probability is a plain sum; above, that would lose digits.
const PLAIN: f64 = 64.0;

/// Poisson distribution of a count.
///
/// The component of the family [`Poisson`](crate::emission::Poisson).
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

    /// Mean of the counts, λ.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.rate
    }
}

/// A count, with the logarithm of its factorial.
#[derive(Debug)]
pub struct Count {
    value: f64,
    ln_factorial: (f64, f64),
}

impl Count {
    /// True for a whole number from 0 to 2^53.
    #[inline]
    pub(in crate::emission) fn is_valid(value: f64) -> bool {
        // A cast, since there is no instruction for the fraction on every processor.
        (0.0..=MOST).contains(&value) && value as i64 as f64 == value
    }

    /// Returns a whole number from 0 to 2^53.
    #[inline]
    pub(in crate::emission) fn new(value: f64) -> Option<Self> {
        Self::is_valid(value).then(|| Self { value, ln_factorial: ln_factorial(value) })
    }

    pub(in crate::emission) fn value(&self) -> f64 {
        self.value
    }

    /// ln(y!), and that less y (ln y − 1).
    pub(in crate::emission) fn ln_factorial(&self) -> (f64, f64) {
        self.ln_factorial
    }

    /// Logarithm of its probability in a Poisson distribution.
    #[inline]
    pub(in crate::emission) fn log_probability(&self, rate: f64, ln_rate: f64) -> f64 {
        let &Self { value, ln_factorial: (whole, _) } = self;
        if value == 0.0 {
            -rate
        } else if value < PLAIN {
            value * ln_rate - rate - whole
        } else {
            self.log_probability_of_many(rate, ln_rate)
        }
    }

    /// Apart, since its logarithm would otherwise be computed for few, too.
    #[cold]
    fn log_probability_of_many(&self, rate: f64, ln_rate: f64) -> f64 {
        let &Self { value, ln_factorial: (_, rest) } = self;
        if rate < 0.1 * value {
            value * (ln_rate - value.ln()) + (value - rate) - rest
        } else {
            -value * log_excess((rate - value) / value) - rest
        }
    }
}

impl Univariate for Poisson {
    const VALUES: &'static str = "a whole number from 0 to 2^53";
    type Point = Count;
    type Sums = [f64; 2];

    #[inline]
    fn point(value: f64) -> Option<Count> {
        Count::new(value)
    }

    #[inline]
    fn log_density(&self, y: &Count) -> f64 {
        y.log_probability(self.rate, self.ln_rate)
    }

    #[inline]
    fn add(&self, sums: &mut [f64; 2], y: &Count, weight: f64) {
        add_scaled(sums, weight, [1.0, y.value]);
    }

    fn add_expected(&self, sums: &mut [f64; 2], of: &Self, count: f64) {
        add_scaled(sums, count, [1.0, of.rate]);
    }

    fn expected_log_density(&self, of: &Self) -> f64 {
        if of.rate == 0.0 { -self.rate } else { of.rate * self.ln_rate - self.rate }
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
