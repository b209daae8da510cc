//! [`Diagonal`], the likelihoods of one observation, as numbers or as logarithms.
//!
//! Values of a user's sensor are unchecked; those of this crate's tables come `Checked`, with their
//! maximum, so that a step does not look at them again.

use crate::error::{LikelihoodError, Parameter};
use wayfix_kernels::limits;
use wayfix_kernels::{self as kernels, Valid};

/// Diagonal of B(y): one likelihood per state, as numbers or as logarithms, with an optional
/// common log factor.
///
/// The values are borrowed, so a table returns its column without copying.
#[derive(Debug, Clone, Copy)]
pub struct Diagonal<'a> {
    pub(crate) values: Values<'a>,
    pub(crate) log_factor: f64,
}

/// Values of a diagonal, in one of three forms.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Values<'a> {
    /// Likelihoods, unchecked.
    Linear(&'a [f64]),
    /// Natural logarithms of likelihoods, unchecked.
    Log(&'a [f64]),
    /// Valid likelihoods with their maximum and, if available, their base-2 logarithms.
    Checked { linear: &'a [f64], largest: f64, log2: Option<&'a [f64]> },
}

impl<'a> Diagonal<'a> {
    /// Creates a diagonal from likelihoods, each finite and at least 0.
    #[inline]
    #[must_use]
    pub fn linear(values: &'a [f64]) -> Self {
        Self::of(Values::Linear(values))
    }

    /// Creates a diagonal from natural logarithms of likelihoods, each at most 1e300 in
    /// magnitude, or −∞ (a likelihood of exactly 0).
    ///
    /// The whole range is usable: differences beyond the exponent range of a double are handled
    /// exactly.
    #[inline]
    #[must_use]
    pub fn log(values: &'a [f64]) -> Self {
        Self::of(Values::Log(values))
    }

    /// Adds ln c to the log factor, where c is a factor that was taken out of all values; it is
    /// added back in the log-likelihood.
    #[must_use]
    pub fn with_log_factor(self, log_factor: f64) -> Self {
        Self { log_factor: self.log_factor + log_factor, ..self }
    }

    /// Values, either as numbers or as logarithms.
    #[must_use]
    pub fn as_slice(&self) -> &'a [f64] {
        match self.values {
            Values::Linear(values) | Values::Log(values) => values,
            Values::Checked { linear, .. } => linear,
        }
    }

    /// True if the values are natural logarithms.
    #[must_use]
    pub fn is_log(&self) -> bool {
        matches!(self.values, Values::Log(_))
    }

    /// Logarithm of the factor that was taken out of all values.
    #[must_use]
    pub fn log_factor(&self) -> f64 {
        self.log_factor
    }

    /// True if a likelihood, given in the form of the values, is above 0.
    pub(crate) fn is_possible(&self, likelihood: f64) -> bool {
        likelihood > if self.is_log() { f64::NEG_INFINITY } else { 0.0 }
    }

    #[inline]
    pub(crate) fn of(values: Values<'a>) -> Self {
        Self { values, log_factor: 0.0 }
    }

    /// Creates a diagonal from values that are known to be valid and to have this maximum.
    #[inline]
    pub(crate) fn checked(linear: &'a [f64], largest: f64, log2: Option<&'a [f64]>) -> Self {
        Self::of(Values::Checked { linear, largest, log2 })
    }

    #[inline]
    pub(crate) fn len(&self) -> usize {
        self.as_slice().len()
    }

    /// Returns the likelihoods, or `None` if the values are logarithms.
    pub(crate) fn linear_values(&self) -> Option<&'a [f64]> {
        (!self.is_log()).then_some(self.as_slice())
    }

    /// Checks the length and the log factor.
    #[inline]
    pub(crate) fn check_shape(&self, states: usize) -> Result<(), LikelihoodError> {
        if self.len() != states {
            return Err(LikelihoodError::WrongLength { found: self.len(), expected: states });
        }
        check_log_factor(self.log_factor)
    }

    /// Checks length, values and log factor, and returns the largest value in the form of the
    /// diagonal (0 or −∞ if every state is ruled out).
    pub(crate) fn check(&self, states: usize) -> Result<f64, LikelihoodError> {
        self.check_shape(states)?;
        let (values, valid) = match self.values {
            Values::Linear(values) => (values, Valid::Likelihoods),
            Values::Log(values) => (values, Valid::Logs),
            // Whoever built it has checked the values.
            Values::Checked { largest, .. } => return Ok(largest),
        };
        kernels::largest(values, valid).map_err(|state| {
            let (kind, expected) = (valid.kind(), valid.expected());
            LikelihoodError::Value { state, kind, value: values[state], expected }
        })
    }

    /// Natural logarithms of the values, without the log factor.
    pub(crate) fn logs(&self) -> impl Iterator<Item = f64> + Clone + 'a {
        // ln 0 is −∞, as it should be; values were checked before.
        let (values, is_log) = (self.as_slice(), self.is_log());
        values.iter().map(move |&value| if is_log { value } else { value.ln() })
    }
}

/// Checks a log factor: sums of log factors over all steps must stay finite.
pub(super) fn check_log_factor(value: f64) -> Result<(), LikelihoodError> {
    if limits::is_log(value) {
        return Ok(());
    }
    Err(Parameter::new("the log factor", value, "a value from -1e300 to 1e300").into())
}
