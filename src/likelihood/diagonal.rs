//! What a likelihood hands to inference.

use crate::error::LikelihoodError;
use crate::kernels::{self, LARGEST_LOG, Valid};

/// The diagonal of B(y): one likelihood per state, as numbers or as
/// logarithms, with a common factor taken out if wanted.
///
/// It borrows its values, so a table hands out its column without copying.
#[derive(Debug, Clone, Copy)]
pub struct Diagonal<'a> {
    pub(crate) values: Values<'a>,
    pub(crate) log_factor: f64,
}

/// In which form the likelihoods are.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Values<'a> {
    /// As they come from a sensor.
    Linear(&'a [f64]),
    /// As natural logarithms.
    Log(&'a [f64]),
    /// Known to be valid, with the largest of them and, if at hand, their
    /// logarithms to base 2.
    Checked { linear: &'a [f64], largest: f64, log2: Option<&'a [f64]> },
}

impl<'a> Diagonal<'a> {
    /// From likelihoods, each finite and at least 0.
    #[inline]
    #[must_use]
    pub fn linear(values: &'a [f64]) -> Self {
        Self::of(Values::Linear(values))
    }

    /// From natural logarithms of likelihoods, each at most 1e300 in size, or −∞
    /// (which is a likelihood of exactly 0).
    ///
    /// They may lie anywhere there: differences beyond the range of a double's
    /// exponent are handled exactly.
    #[inline]
    #[must_use]
    pub fn log(values: &'a [f64]) -> Self {
        Self::of(Values::Log(values))
    }

    /// The same with ln c added to every log-likelihood: c is a factor that
    /// was taken out of all values, and belongs into the log-likelihood.
    #[must_use]
    pub fn with_log_factor(self, log_factor: f64) -> Self {
        Self { log_factor: self.log_factor + log_factor, ..self }
    }

    #[inline]
    pub(crate) fn of(values: Values<'a>) -> Self {
        Self { values, log_factor: 0.0 }
    }

    /// For values that are known to be valid and have this maximum.
    #[inline]
    pub(crate) fn checked(linear: &'a [f64], largest: f64, log2: Option<&'a [f64]>) -> Self {
        Self::of(Values::Checked { linear, largest, log2 })
    }

    #[inline]
    pub(crate) fn len(&self) -> usize {
        match self.values {
            Values::Linear(values) | Values::Log(values) => values.len(),
            Values::Checked { linear, .. } => linear.len(),
        }
    }

    /// The likelihoods, unless they are logarithms.
    pub(crate) fn linear_values(&self) -> Option<&'a [f64]> {
        match self.values {
            Values::Linear(linear) | Values::Checked { linear, .. } => Some(linear),
            Values::Log(_) => None,
        }
    }

    /// Checks length and factor.
    #[inline]
    pub(crate) fn check_shape(&self, states: usize) -> Result<(), LikelihoodError> {
        if self.len() != states {
            return Err(LikelihoodError::WrongLength { found: self.len(), expected: states });
        }
        check_log_factor(self.log_factor)
    }

    /// Checks length, values and factor, and returns the largest value in the
    /// form that the diagonal has (0 or −∞ if every state is ruled out).
    pub(crate) fn check(&self, states: usize) -> Result<f64, LikelihoodError> {
        self.check_shape(states)?;
        let (values, valid) = match self.values {
            Values::Linear(values) => (values, Valid::Likelihoods),
            Values::Log(values) => (values, Valid::Logs),
            Values::Checked { largest, .. } => return Ok(largest),
        };
        kernels::largest(values, valid).map_err(|state| {
            let (kind, expected) = (valid.kind(), valid.expected());
            LikelihoodError::Value { state, kind, value: values[state], expected }
        })
    }

    /// The natural logarithm of each value, without the log factor.
    pub(crate) fn logs(&self) -> impl Iterator<Item = f64> + Clone + 'a {
        let (values, is_log) = match self.values {
            Values::Linear(values) | Values::Checked { linear: values, .. } => (values, false),
            Values::Log(values) => (values, true),
        };
        values.iter().map(move |&value| if is_log { value } else { value.ln() })
    }
}

/// A common factor must stay finite over all steps.
pub(super) fn check_log_factor(value: f64) -> Result<(), LikelihoodError> {
    let valid = value.abs() <= LARGEST_LOG;
    if valid { Ok(()) } else { Err(LikelihoodError::LogFactor { value }) }
}

/// Memory that a likelihood may fill, kept from step to step.
///
/// ```
/// let mut scratch = wayfix::Scratch::default();
/// let b = scratch.values(3);
/// assert_eq!(b.len(), 3);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    values: Vec<f64>,
    parts: Vec<Scratch>,
}

impl Scratch {
    /// A slice of `count` values to fill; what it holds before is left over
    /// from earlier steps. Allocates only when it grows.
    #[inline]
    pub fn values(&mut self, count: usize) -> &mut [f64] {
        self.values.resize(count, 0.0);
        &mut self.values
    }

    /// Values to fill, beside as many further scratches for the parts of a
    /// composed likelihood as are asked for.
    pub fn with_parts(&mut self, count: usize, parts: usize) -> (&mut [f64], &mut [Scratch]) {
        self.values.resize(count, 0.0);
        self.parts.resize_with(parts.max(self.parts.len()), Scratch::default);
        (&mut self.values, &mut self.parts[..parts])
    }
}
