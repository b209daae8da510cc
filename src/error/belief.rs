//! Errors of beliefs.

use std::error::Error;
use std::fmt;

/// An invalid probability distribution over states, or an invalid query of one.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum BeliefError {
    /// There are no states.
    Empty,
    /// A probability is NaN, negative or infinite.
    Probability {
        /// The state, from 0.
        state: usize,
        /// Value found.
        value: f64,
    },
    /// The probabilities do not sum to one, or all weights are 0.
    Sum {
        /// Sum found.
        sum: f64,
        /// Expected sum, in words.
        expected: &'static str,
    },
    /// The state does not exist.
    State {
        /// The state asked for, from 0.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The level is outside 0 to 1.
    Level {
        /// Level found.
        level: f64,
    },
}

impl fmt::Display for BeliefError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "a belief needs at least one state, found none"),
            Self::Probability { state, value } => write!(
                f,
                "state {state} has probability {value}, expected a finite value of at least 0"
            ),
            Self::Sum { sum, expected } => {
                write!(f, "the probabilities sum to {sum}, expected {expected}")
            }
            Self::State { state, states } => write!(
                f,
                "state {state} does not exist, the belief has {states} states (0 to {})",
                states.saturating_sub(1)
            ),
            Self::Level { level } => {
                write!(f, "the level is {level}, expected a value from 0 to 1")
            }
        }
    }
}

impl Error for BeliefError {}
