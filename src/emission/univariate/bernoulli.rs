//! Events that happen or not.

use rand::{Rng, RngExt};

use super::{Univariate, add_scaled, check};
use crate::emission::error::EmissionError;

/// Bernoulli distribution of an event: 1 if it happens, otherwise 0.
///
/// The component of the family [`Bernoulli`](crate::emission::Bernoulli).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bernoulli {
    probability: f64,
    /// Logarithms of the probabilities of 0 and 1.
    logs: [f64; 2],
}

impl Bernoulli {
    /// Creates the distribution with this probability of 1.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless it is from 0 to 1.
    pub fn new(probability: f64) -> Result<Self, EmissionError> {
        let valid = (0.0..=1.0).contains(&probability);
        let p = check("probability", probability, valid, "a value from 0 to 1")?;
        Ok(Self { probability: p, logs: [(-p).ln_1p(), p.ln()] })
    }

    /// Probability of 1.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }
}

impl Univariate for Bernoulli {
    const VALUES: &'static str = "0 or 1";
    type Point = bool;
    /// Weights of all, of 0 and of 1.
    type Sums = [f64; 3];

    fn point(value: f64) -> Option<bool> {
        (value == 0.0 || value == 1.0).then_some(value == 1.0)
    }

    fn log_density(&self, &happens: &bool) -> f64 {
        self.logs[usize::from(happens)]
    }

    fn add(&self, sums: &mut [f64; 3], &happens: &bool, weight: f64) {
        sums[0] += weight;
        sums[1 + usize::from(happens)] += weight;
    }

    fn add_expected(&self, sums: &mut [f64; 3], of: &Self, count: f64) {
        add_scaled(sums, count, [1.0, 1.0 - of.probability, of.probability]);
    }

    fn expected_log_density(&self, of: &Self) -> f64 {
        let shares = [1.0 - of.probability, of.probability].into_iter().zip(self.logs);
        shares.filter(|(share, _)| *share > 0.0).map(|(share, log)| share * log).sum()
    }

    fn add_pseudo_count(&self, sums: &mut [f64; 3], pseudo_count: f64) {
        for (value, _) in self.logs.iter().enumerate().filter(|(_, log)| **log > f64::NEG_INFINITY)
        {
            sums[0] += pseudo_count;
            sums[1 + value] += pseudo_count;
        }
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        let possible = self.logs.iter().filter(|log| **log > f64::NEG_INFINITY);
        pseudo_count * possible.sum::<f64>()
    }

    fn maximize(&self, &[_, zeros, ones]: &[f64; 3]) -> Result<Self, EmissionError> {
        Self::new(ones / (zeros + ones))
    }

    fn free_parameters(&self) -> usize {
        usize::from(0.0 < self.probability && self.probability < 1.0)
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        f64::from(u8::from(rng.random::<f64>() < self.probability))
    }
}
