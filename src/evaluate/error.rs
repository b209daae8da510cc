//! Why estimates cannot be scored.

use std::ops::RangeInclusive;

use std::error::Error;
use std::fmt;

use crate::error::TransitionError;

/// Why estimates cannot be scored.
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
    /// Nothing to score.
    Empty,
    /// A control that the operator does not know.
    Control {
        /// Its index, from 0.
        index: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// A state beyond the last one.
    State {
        /// Where in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// Nothing to score of a kind that the score cannot do without.
    Missing {
        /// What there should have been.
        what: &'static str,
    },
    /// A confidence, score, probability or mass that is none.
    Value {
        /// What it should have been.
        what: &'static str,
        /// Where in the slice, from 0.
        index: usize,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A range of true places that holds none; off the map is `None`.
    EmptyRange {
        /// Where in the slice, from 0, or `None` for a single range.
        index: Option<usize>,
        /// What was found.
        range: RangeInclusive<usize>,
    },
    /// More right answers than queries that have one.
    Positives {
        /// Right answers found.
        correct: usize,
        /// Queries that have one.
        positives: usize,
    },
    /// A level outside 0 to 1.
    Level {
        /// What was given.
        level: f64,
    },
    /// No bins to sort probabilities into.
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
