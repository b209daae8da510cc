//! Payloads shared by the errors: a number out of its range, an error at a step, a failure with its
//! cause, two methods that disagree.

use std::borrow::Cow;
use std::error::Error;
use std::fmt;
use std::ops::RangeInclusive;

/// A number that is out of its range, such as a probability, a level or a count.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what} is {value}, expected {expected}", value = Number(*.value))]
pub struct OutOfRange {
    /// Name of the number.
    pub what: Cow<'static, str>,
    /// Value found.
    pub value: f64,
    /// Valid values, in words.
    pub expected: Cow<'static, str>,
}

impl OutOfRange {
    #[doc(hidden)]
    pub fn new(
        what: impl Into<Cow<'static, str>>,
        value: f64,
        expected: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self { what: what.into(), value, expected: expected.into() }
    }

    /// A number of things that differs from the expected one.
    #[doc(hidden)]
    pub fn count(what: impl Into<Cow<'static, str>>, found: usize, expected: usize) -> Self {
        Self::new(what, found as f64, expected.to_string())
    }

    /// An index of something that does not exist; there are `count` of them.
    #[doc(hidden)]
    pub fn index(what: impl Into<Cow<'static, str>>, index: usize, count: usize) -> Self {
        Self::new(what, index as f64, format!("0 to {}", count.saturating_sub(1)))
    }

    /// An empty collection, which needs at least one item.
    #[doc(hidden)]
    pub fn none(what: impl Into<Cow<'static, str>>) -> Self {
        Self::new(what, 0.0, "at least 1")
    }

    /// Checks that a value is in its range, which NaN never is.
    #[doc(hidden)]
    pub fn check(
        what: &'static str,
        value: f64,
        range: RangeInclusive<f64>,
        expected: &'static str,
    ) -> Result<(), Self> {
        if range.contains(&value) { Ok(()) } else { Err(Self::new(what, value, expected)) }
    }
}

/// A number in a message: in decimal notation, or in scientific notation if that is too long.
#[derive(Debug, Clone, Copy)]
pub struct Number(pub f64);

/// Largest number of characters of a number in decimal notation.
const LONGEST: usize = 24;

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // `to_string` writes 1e300 with all of its 301 digits, and never takes an exponent.
        let Self(value) = self;
        let text = value.to_string();
        if text.len() <= LONGEST { f.write_str(&text) } else { write!(f, "{value:e}") }
    }
}

/// An error at a numbered place, such as a step, with its cause.
///
/// The message ends with that of the cause, so that `source` is the source of the cause.
#[derive(Debug, Clone, PartialEq)]
pub struct At<E> {
    /// The number in the message: a step, from 1; a traverse, drive, labelled part or control, from
    /// 0; or the number of sequences.
    pub number: usize,
    /// Cause.
    pub cause: E,
    /// Words of the message before and after the number.
    words: &'static [&'static str; 2],
}

impl<E> At<E> {
    /// Creates an error with the words before and after the number.
    ///
    /// ```
    /// use wayfix::LikelihoodError;
    /// use wayfix::error::At;
    ///
    /// let cause = LikelihoodError::sensor("the image has no pixels");
    /// let error = At::new(&["step ", " has no valid likelihood"], 3, cause);
    /// let expected = "step 3 has no valid likelihood: the sensor failed: the image has no pixels";
    /// assert_eq!(error.to_string(), expected);
    /// ```
    pub fn new(words: &'static [&'static str; 2], number: usize, cause: E) -> Self {
        Self { number, cause, words }
    }
}

impl<E: fmt::Display> fmt::Display for At<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { number, cause, words: [before, after] } = self;
        write!(f, "{before}{number}{after}: {cause}")
    }
}

impl<E: Error> Error for At<E> {
    // Not the cause itself, which is already in the message.
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.cause.source()
    }
}

/// A failure with its cause.
///
/// The message ends with that of the cause, so that `source` is the source of the cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Failed<E> {
    /// The failure, such as "the sensor failed".
    pub what: &'static str,
    /// Cause.
    pub cause: E,
}

impl<E: fmt::Display> fmt::Display for Failed<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.what, self.cause)
    }
}

impl<E: Error> Error for Failed<E> {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.cause.source()
    }
}

/// A method of an operator or a sensor that does not agree with its other methods.
#[derive(Debug, Clone, PartialEq)]
pub struct Disagreement {
    /// Name of the method.
    pub method: &'static str,
    /// Destination state, or the state of a likelihood, if the value belongs to one.
    pub to: Option<usize>,
    /// Source state, if the value belongs to one.
    pub from: Option<usize>,
    /// Value returned, in the unit of the method: a number, or a natural or base-2 logarithm. Natural
    /// logarithms for sensors.
    pub found: f64,
    /// Value of the other methods, in the same unit.
    pub expected: f64,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { method, to, from, found, expected } = self;
        write!(f, "`{method}` gives {}", Number(*found))?;
        match (to, from) {
            (Some(to), Some(from)) => {
                write!(f, " for the transition from state {from} to state {to}")?;
            }
            (Some(state), None) | (None, Some(state)) => write!(f, " for state {state}")?,
            (None, None) => {}
        }
        write!(f, ", expected {} as by its other methods", Number(*expected))
    }
}

impl Error for Disagreement {}
