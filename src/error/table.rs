//! [`TableError`]: errors of likelihood tables.

use super::Number;

/// An invalid table of observation probabilities.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// There are no states or no symbols.
    #[error(
        "a table needs at least one state and one symbol, found {states} states and {symbols} symbols"
    )]
    Empty {
        /// Number of states.
        states: usize,
        /// Number of symbols.
        symbols: usize,
    },
    /// The rows differ in length.
    #[error("the row of state {state} has {found} values, expected {expected} to match state 0")]
    RowLength {
        /// The state, from 0.
        state: usize,
        /// Number of values in its row.
        found: usize,
        /// Number of values in the row of state 0.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    #[error(
        "state {state} shows symbol {symbol} with probability {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Entry {
        /// The state, from 0.
        state: usize,
        /// The symbol, from 0.
        symbol: usize,
        /// Value found.
        value: f64,
    },
    /// The likelihood of the states that a symbol does not list is NaN, negative or infinite.
    #[error(
        "states that symbol {symbol} does not list show it with probability {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Elsewhere {
        /// The symbol, from 0.
        symbol: usize,
        /// Value found.
        value: f64,
    },
    /// A symbol lists a state twice.
    #[error("symbol {symbol} lists state {state} twice")]
    Twice {
        /// The symbol, from 0.
        symbol: usize,
        /// The state, from 0.
        state: usize,
    },
    /// A symbol lists a state that does not exist.
    #[error("symbol {symbol} lists state {state}, but there are {states} states (0 to {})", .states.saturating_sub(1))]
    Listed {
        /// The symbol, from 0.
        symbol: usize,
        /// The state.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The probabilities of the symbols in a state do not sum to one.
    #[error(
        "the symbol probabilities of state {state} sum to {sum}, expected 1",
        sum = Number(*.sum)
    )]
    RowSum {
        /// The state, from 0.
        state: usize,
        /// Sum found.
        sum: f64,
    },
}
