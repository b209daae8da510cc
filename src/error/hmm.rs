//! Errors of models.

use std::error::Error;
use std::fmt;

use super::TransitionError;

/// Parts that do not form a hidden Markov model.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts differ in their number of states.
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
    Order {
        /// A state that is missing, there twice, or does not exist.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The transition operator is not valid.
    Transition(TransitionError),
}

impl fmt::Display for HmmError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StateCount { part, found, first, expected } => {
                write!(f, "the {part} has {found} states, expected {expected} as the {first}")
            }
            Self::Order { state, states } => write!(
                f,
                "the order does not hold each of {states} states once: look for state {state}"
            ),
            Self::Transition(source) => write!(f, "the transition operator is not valid: {source}"),
        }
    }
}

impl Error for HmmError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Transition(source) => source.source(),
            _ => None,
        }
    }
}

impl From<TransitionError> for HmmError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}
