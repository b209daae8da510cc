//! Normal distributions of single components, whatever the others are.

use super::normals::{LN_2_PI, Normals};
use super::step::density;
use crate::check::check_components;
use crate::{EmissionError, Tails};

impl Normals {
    /// Number of a component of an observation, `None` if it is missing.
    pub(crate) fn number(
        &self,
        row: &[f64],
        component: usize,
    ) -> Result<Option<f64>, EmissionError> {
        check_components(row, self.d)?;
        let value = row[component];
        if value.is_nan() && self.settings.missing {
            return Ok(None);
        }
        if !value.is_finite() {
            return Err(EmissionError::Observation {
                component,
                value,
                expected: "a finite value",
            });
        }
        Ok(Some(value))
    }

    /// Distance of a number from the mean of a component, in standard deviations, and the logarithm of
    /// that deviation.
    pub(crate) fn standardize(&self, at: usize, component: usize, y: f64) -> [f64; 2] {
        let variance = self.covariance(at, component, component);
        // Halves, whose difference is in range.
        let half = 0.5 * y - 0.5 * self.means[at * self.d + component];
        [2.0 * (half / variance.sqrt()), 0.5 * variance.ln()]
    }

    /// Logarithm of the density of a component by itself; −∞ for what is no number.
    pub(crate) fn log_marginal(&self, at: usize, component: usize, y: f64) -> f64 {
        if !y.is_finite() {
            return f64::NEG_INFINITY;
        }
        let [z, ln_deviation] = self.standardize(at, component, y);
        density(-0.5 * (z * z + LN_2_PI) - ln_deviation)
    }

    /// Tails of a component by itself.
    pub(crate) fn tails(&self, at: usize, component: usize, y: f64) -> Tails {
        Tails::of_normal(self.standardize(at, component, y)[0])
    }
}
