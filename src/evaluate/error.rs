//! Errors of scores.

use std::ops::RangeInclusive;

use std::error::Error;
use std::fmt;

use crate::error::TransitionError;

/// Estimates that cannot be scored.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Truth and estimates, or path and controls, differ in length.
    Length {
        /// States given.
        truth: usize,
        /// Estimates, or controls, given.
        estimated: usize,
    },
    /// There are no states to score.
    Empty,
    /// A control is not valid for the operator.
    Control {
        /// Its index, from 0.
        index: usize,
        /// The cause.
        source: TransitionError,
    },
    /// A state does not exist.
    State {
        /// Its index in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// The number of states.
        states: usize,
    },
    /// A kind of sample that the score needs is missing.
    Missing {
        /// Name of the missing samples.
        what: &'static str,
    },
    /// A confidence, score, probability or mass is not valid.
    Value {
        /// Kind of the value.
        what: &'static str,
        /// Its index in the slice, from 0.
        index: usize,
        /// The value given.
        value: f64,
        /// The valid range.
        expected: &'static str,
    },
    /// A range of true places is empty; off the map is `None`.
    EmptyRange {
        /// Its index in the slice, from 0, or `None` for a single range.
        index: Option<usize>,
        /// The range given.
        range: RangeInclusive<usize>,
    },
    /// There are more right answers than queries that have one.
    Positives {
        /// Right answers found.
        correct: usize,
        /// Queries that have one.
        positives: usize,
    },
    /// A level is not from 0 to 1.
    Level {
        /// The level given.
        level: f64,
    },
    /// The number of bins is 0.
    NoBins,
}

impl fmt::Display for EvaluationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { truth, estimated } => {
                write!(f, "{estimated} estimates or controls for {truth} states, expected one each")
            }
            Self::Empty => write!(f, "no states to score, expected at least one"),
            Self::Control { index, source } => write!(f, "control {index} is not valid: {source}"),
            Self::State { index, state, states } => write!(
                f,
                "state {state} at index {index} does not exist, there are {states} states (0 to {})",
                states - 1
            ),
            Self::Missing { what } => write!(f, "no {what} to score, expected at least one"),
            Self::Value { what, index, value, expected } => {
                write!(f, "{what} {index} is {value}, expected {expected}")
            }
            Self::EmptyRange { index, range } => {
                write!(f, "the true places {range:?}{} are none, expected at least one", at(*index))
            }
            Self::Positives { correct, positives } => write!(
                f,
                "{correct} right answers for {positives} queries that have one, expected one each"
            ),
            Self::Level { level } => {
                write!(f, "the level is {level}, expected a value from 0 to 1")
            }
            Self::NoBins => write!(f, "0 bins, expected at least one"),
        }
    }
}

impl Error for EvaluationError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Control { source, .. } => source.source(),
            _ => None,
        }
    }
}

fn at(index: Option<usize>) -> String {
    index.map_or_else(String::new, |index| format!(" at index {index}"))
}
