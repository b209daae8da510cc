//! [`BeliefError`]: errors of beliefs and of groups of states.

use super::{Number, Parameter};

/// An invalid probability distribution over states or grouping of them, or an invalid query of one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BeliefError {
    /// There are no states.
    #[error("a belief needs at least one state, found none")]
    Empty,
    /// A probability is NaN, negative or infinite.
    #[error(
        "state {state} has probability {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Probability {
        /// The state, from 0.
        state: usize,
        /// Value found.
        value: f64,
    },
    /// The probabilities do not sum to one, or all weights are 0.
    #[error("the probabilities sum to {sum}, expected {expected}", sum = Number(*.sum))]
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
    #[error(transparent)]
    Parameter(#[from] Parameter),
    /// There are no states.
    #[error("groups need at least one state, found none")]
    NoGroups,
    /// A group has no states, though a higher group number is used.
    #[error("no state is in group {group}, though groups are numbered up to {last}")]
    Gap {
        /// Number of the empty group, from 0.
        group: usize,
        /// Highest group number given.
        last: usize,
    },
    /// The state does not exist.
    #[error("state {state} does not exist, {states} states are grouped (0 to {})", .states.saturating_sub(1))]
    Ungrouped {
        /// The state asked for, from 0.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// A belief has a different number of states.
    #[error("the belief has {found} states, expected {expected}")]
    StateCount {
        /// Number of states of the belief.
        found: usize,
        /// Number of states, or of groups where a belief over groups is expected.
        expected: usize,
    },
    /// An output slice does not have one value per group.
    #[error("there is room for {found} groups, expected {expected}")]
    Room {
        /// Length of the slice.
        found: usize,
        /// Number of groups.
        expected: usize,
    },
}
