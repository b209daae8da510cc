//! Why estimates cannot be scored.

use std::ops::RangeInclusive;

use thiserror::Error;

use crate::error::TransitionError;

/// Why estimates cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Truth and estimates, or path and controls, differ in length.
    #[error("{estimated} estimates or controls for {truth} states, expected one each")]
    Length {
        /// States given.
        truth: usize,
        /// Estimates, or controls, given.
        estimated: usize,
    },
    /// Nothing to score.
    #[error("no states to score, expected at least one")]
    Empty,
    /// A control that the operator does not know.
    #[error("control {index} is not valid")]
    Control {
        /// Its index, from 0.
        index: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// A state beyond the last one.
    #[error("state {state} at index {index} does not exist, there are {states} states (0 to {})", states - 1)]
    State {
        /// Where in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// Nothing to score of a kind that the score cannot do without.
    #[error("no {what} to score, expected at least one")]
    Missing {
        /// What there should have been.
        what: &'static str,
    },
    /// A confidence, score, probability or mass that is none.
    #[error("{what} {index} is {value}, expected {expected}")]
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
    #[error("the true places {range:?}{} are none, expected at least one", at(*index))]
    EmptyRange {
        /// Where in the slice, from 0, or `None` for a single range.
        index: Option<usize>,
        /// What was found.
        range: RangeInclusive<usize>,
    },
    /// More right answers than queries that have one.
    #[error("{correct} right answers for {positives} queries that have one, expected one each")]
    Positives {
        /// Right answers found.
        correct: usize,
        /// Queries that have one.
        positives: usize,
    },
    /// A level outside 0 to 1.
    #[error("the level is {level}, expected a value from 0 to 1")]
    Level {
        /// What was given.
        level: f64,
    },
    /// No bins to sort probabilities into.
    #[error("0 bins, expected at least one")]
    NoBins,
}

fn at(index: Option<usize>) -> String {
    index.map_or_else(String::new, |index| format!(" at index {index}"))
}
