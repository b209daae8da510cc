//! Errors of models.

use super::{Number, TransitionError};

/// Parts that do not form a hidden Markov model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts differ in their number of states.
    #[error("the {part} has {found} states, expected {expected} to match the {first}")]
    StateCount {
        /// Name of the part that differs from the first.
        part: &'static str,
        /// Number of states of the part.
        found: usize,
        /// Name of the first part.
        first: &'static str,
        /// Number of states of the first part.
        expected: usize,
    },
    /// An order of the states does not hold each state exactly once.
    #[error("the order must hold each of the {states} states once: check state {state}")]
    Order {
        /// A state that is missing, occurs twice, or does not exist.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The transition operator has no unique stationary distribution that the prior could be.
    #[error("the prior cannot be stationary: {0}")]
    Stationary(TransitionError),
    /// A prior declared stationary changes in a transition.
    #[error(
        "the prior is not stationary: state {state} has probability {before}, and {after} after a transition",
        before = Number(*.before),
        after = Number(*.after)
    )]
    NotStationary {
        /// The state that changes most.
        state: usize,
        /// Its prior probability.
        before: f64,
        /// Its probability after a transition.
        after: f64,
    },
    /// The transition operator is not valid.
    #[error("the transition operator is not valid: {0}")]
    Transition(TransitionError),
}

impl From<TransitionError> for HmmError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}
