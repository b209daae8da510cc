//! Diagonals: the likelihoods of one observation.

use super::sparse::{SparseDiagonal, SparseObservation};
use crate::error::{LikelihoodError, Parameter};
use crate::kernels::{self, Valid};
use crate::limits;

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
    /// Valid likelihoods with their maximum and, if available, their logarithms to base 2.
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
    /// The whole range is usable: differences beyond the range of a double's exponent are handled
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
        match self.values {
            Values::Linear(values) | Values::Log(values) => values.len(),
            Values::Checked { linear, .. } => linear.len(),
        }
    }

    /// Returns the likelihoods, or `None` if the values are logarithms.
    pub(crate) fn linear_values(&self) -> Option<&'a [f64]> {
        match self.values {
            Values::Linear(linear) | Values::Checked { linear, .. } => Some(linear),
            Values::Log(_) => None,
        }
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
            Values::Checked { largest, .. } => return Ok(largest),
        };
        kernels::largest(values, valid).map_err(|state| {
            let (kind, expected) = (valid.kind(), valid.expected());
            LikelihoodError::Value { state, kind, value: values[state], expected }
        })
    }

    /// Natural logarithms of the values, without the log factor.
    pub(crate) fn logs(&self) -> impl Iterator<Item = f64> + Clone + 'a {
        let (values, is_log) = match self.values {
            Values::Linear(values) | Values::Checked { linear: values, .. } => (values, false),
            Values::Log(values) => (values, true),
        };
        values.iter().map(move |&value| if is_log { value } else { value.ln() })
    }
}

/// Checks a log factor, the sum of which must stay finite over all steps.
pub(super) fn check_log_factor(value: f64) -> Result<(), LikelihoodError> {
    if limits::is_log(value) {
        return Ok(());
    }
    Err(Parameter::new("the log factor", value, "a value from -1e300 to 1e300").into())
}

/// Reusable memory for the values of a diagonal, kept from step to step.
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
    sparse: SparseDiagonal,
    /// True if diagonals are for a decoder, which takes logarithms to base 2.
    with_log2: bool,
}

impl Scratch {
    /// Returns a slice of `count` values to fill. Their initial contents are left over from
    /// earlier steps. Allocates only when it grows.
    #[inline]
    pub fn values(&mut self, count: usize) -> &mut [f64] {
        self.values.resize(count, 0.0);
        &mut self.values
    }

    /// Returns `count` values to fill, and `parts` separate scratches for the parts of a composed
    /// likelihood.
    pub fn with_parts(&mut self, count: usize, parts: usize) -> (&mut [f64], &mut [Scratch]) {
        self.values.resize(count, 0.0);
        self.parts.resize_with(parts.max(self.parts.len()), Scratch::default);
        (&mut self.values, &mut self.parts[..parts])
    }

    /// Asks for logarithms to base 2 with diagonals for which they cost nothing.
    pub(crate) fn ask_for_log2(&mut self) {
        self.with_log2 = true;
    }

    /// True if logarithms to base 2 are asked for.
    pub(super) fn takes_log2(&self) -> bool {
        self.with_log2
    }

    /// Returns the diagonal of an observation that lists some of so many states, all of which
    /// exist.
    pub(super) fn sparse(&mut self, states: usize, seen: &SparseObservation) -> Diagonal<'_> {
        self.sparse.write(states, &seen.listed, seen.elsewhere, self.with_log2)
    }

    /// Returns the diagonal of ones for so many states.
    pub(super) fn ones(&mut self, states: usize) -> Diagonal<'_> {
        self.sparse.write(states, &[], 1.0, self.with_log2)
    }
}
