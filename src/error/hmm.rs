//! Errors of models.

use super::{Number, TransitionError};

/// Parts that do not form a hidden Markov model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts differ in their number of states.
    #[error("the {part} has {found} states, expected {expected} as the {first}")]
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
    /// An order of the states does not hold each of them once.
    #[error("the order does not hold each of {states} states once: look for state {state}")]
    Order {
        /// A state that is missing, there twice, or does not exist.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The transition operator has no one stationary distribution, so that the prior can't be one.
    #[error("the prior cannot be stationary: {0}")]
    Stationary(TransitionError),
    /// A prior that is said to be stationary changes by a transition.
    #[error(
        "the prior is not stationary: state {state} has probability {before}, and {after} after a transition",
        before = Number(*.before),
        after = Number(*.after)
    )]
    NotStationary {
        /// The state that changes most.
        state: usize,
        /// Its probability by the prior.
        before: f64,
        /// The one after a transition.
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
