//! Errors of beliefs.

/// An invalid probability distribution over states, or an invalid query of one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BeliefError {
    /// There are no states.
    #[error("a belief needs at least one state, found none")]
    Empty,
    /// A probability is NaN, negative or infinite.
    #[error("state {state} has probability {value}, expected a finite value of at least 0")]
    Probability {
        /// The state, from 0.
        state: usize,
        /// Value found.
        value: f64,
    },
    /// The probabilities do not sum to one, or all weights are 0.
    #[error("the probabilities sum to {sum}, expected {expected}")]
    Sum {
        /// Sum found.
        sum: f64,
        /// Expected sum, in words.
        expected: &'static str,
    },
    /// The state does not exist.
    #[error("state {state} does not exist, the belief has {states} states (0 to {})", .states.saturating_sub(1))]
    State {
        /// The state asked for, from 0.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The level is outside 0 to 1.
    #[error("the level is {level}, expected a value from 0 to 1")]
    Level {
        /// Level found.
        level: f64,
    },
}
