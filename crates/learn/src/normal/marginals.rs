//! Marginal distributions of single components: N(μ_c, Σ_cc), whatever the other components are.

use super::normals::{LN_2_PI, Normals};
use super::step::density;
use crate::check::check_components;
use crate::{EmissionError, Tails};

impl Normals {
    /// Value of a component of an observation, or `None` if it is missing.
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

    /// Distance of a number from the mean of a component in standard deviations, and the logarithm
    /// of the standard deviation.
    pub(crate) fn standardize(&self, at: usize, component: usize, y: f64) -> [f64; 2] {
        let variance = self.covariance(at, component, component);
        // The difference of two halves does not overflow.
        let half = 0.5 * y - 0.5 * self.means[at * self.d + component];
        [2.0 * (half / variance.sqrt()), 0.5 * variance.ln()]
    }

    /// Logarithm of the marginal density of a component; −∞ unless y is finite.
    pub(crate) fn log_marginal(&self, at: usize, component: usize, y: f64) -> f64 {
        if !y.is_finite() {
            return f64::NEG_INFINITY;
        }
        let [z, ln_deviation] = self.standardize(at, component, y);
        density(-0.5 * (z * z + LN_2_PI) - ln_deviation)
    }

    /// Tails of the marginal distribution of a component.
    pub(crate) fn tails(&self, at: usize, component: usize, y: f64) -> Tails {
        Tails::of_normal(self.standardize(at, component, y)[0])
    }
}
