//! Errors of scores: estimates and truths that cannot be compared.

use std::ops::RangeInclusive;

use crate::error::{At, Number, Parameter, TransitionError};

/// Estimates that cannot be scored.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
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
    /// There are no states to score.
    #[error("no states to score, expected at least one")]
    Empty,
    /// A control is not valid for the operator.
    #[error(transparent)]
    Control(At<TransitionError>),
    /// A state does not exist.
    #[error("state {state} at index {index} does not exist, there are {states} states (0 to {})", .states - 1)]
    State {
        /// Its index in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// The number of states.
        states: usize,
    },
    /// A kind of sample that the score needs is missing.
    #[error("no {what} to score, expected at least one")]
    Missing {
        /// Name of the missing samples.
        what: &'static str,
    },
    /// A confidence, score, probability or mass is not valid.
    #[error("{what} {index} is {value}, expected {expected}", value = Number(*.value))]
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
    #[error("the range of true places {range:?}{} is empty, expected at least one place", at(*.index))]
    EmptyRange {
        /// Its index in the slice, from 0, or `None` for a single range.
        index: Option<usize>,
        /// The range given.
        range: RangeInclusive<usize>,
    },
    /// There are more right answers than queries that have one.
    #[error("{correct} right answers for {positives} queries that have one, expected one each")]
    Positives {
        /// Right answers found.
        correct: usize,
        /// Queries that have one.
        positives: usize,
    },
    /// A level is not from 0 to 1.
    #[error(transparent)]
    Parameter(#[from] Parameter),
    /// The number of bins is 0.
    #[error("0 bins, expected at least one")]
    NoBins,
}

impl EvaluationError {
    /// An invalid control, by its index from 0.
    pub(super) fn control(index: usize, cause: TransitionError) -> Self {
        Self::Control(At::new(&["control ", " is not valid"], index, cause))
    }
}

fn at(index: Option<usize>) -> String {
    index.map_or_else(String::new, |index| format!(" at index {index}"))
}
