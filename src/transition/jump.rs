//! Evidence on moves at jumps, which no move of the inner operator leads to: restarts, and moves off
//! the map and back.

use std::f64::consts::LOG2_E;

use crate::error::{Parameter, TransitionError};
use crate::kernels;

/// Largest entry taken in linear space.
pub(super) const LARGEST: f64 = 1e300;

/// ln p(u) at a jump; if `None`, the log factor that the inner operator takes out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct JumpEvidence(Option<f64>);

impl JumpEvidence {
    /// Checks that the log-likelihood is finite; `place` names the jumps in errors.
    pub(crate) fn new(log: Option<f64>, place: &str) -> Result<Self, TransitionError> {
        if let Some(value) = log.filter(|log| !log.is_finite()) {
            let what = format!("the log-likelihood of evidence {place}");
            return Err(Parameter::new(what, value, "a finite number").into());
        }
        Ok(Self(log))
    }

    /// The log-likelihood that was given.
    #[cfg(feature = "serde")]
    pub(crate) fn given(self) -> Option<f64> {
        self.0
    }

    /// Logarithm of the factor of jumps at a step, for the log factor of the inner operator; 0
    /// without evidence.
    pub(crate) fn log_factor(self, inner: Option<f64>) -> f64 {
        inner.map_or(0.0, |taken_out| self.0.map_or(0.0, |log| log - taken_out))
    }

    /// Base-2 logarithm of the factor of jumps, on the grid of scores.
    pub(crate) fn log2_factor(self, inner: Option<f64>) -> f64 {
        kernels::on_grid(self.log_factor(inner) * LOG2_E)
    }

    /// Returns true if a jump of one of these probabilities is out of the range of doubles.
    pub(crate) fn needs_logs(
        self,
        inner: Option<f64>,
        mut probabilities: impl Iterator<Item = f64>,
    ) -> bool {
        let log = self.log_factor(inner);
        let beyond = |p: f64| p > 0.0 && !(f64::MIN_POSITIVE..=LARGEST).contains(&(p * log.exp()));
        log != 0.0 && probabilities.any(beyond)
    }
}

/// A product that is 0 if either factor is, even with an infinite other one.
pub(crate) fn times(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}
