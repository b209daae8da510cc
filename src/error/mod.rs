//! Errors of models, observations, learning and snapshots, one enum per concern. Errors of maps
//! and of sensors are defined in their own modules.
//!
//! A message says what was found, where, and what was expected, and ends with the message of its
//! cause. As the cause is in the text already, `source` returns the cause's own source, so that a
//! printed chain repeats nothing. States and symbols are counted from 0, as in slices; steps from
//! 1, as in `y_1 … y_T`.

mod inference;
mod snapshot;

pub use inference::{InferenceError, LearnError, SequenceError};
pub use snapshot::SnapshotError;

use std::error::Error;
use std::fmt;
use std::sync::Arc;

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

/// An invalid transition operator, or a control that it does not accept.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TransitionError {
    /// There are no states.
    Empty,
    /// The matrix is not square.
    NotSquare {
        /// Rows found.
        rows: usize,
        /// Columns found.
        columns: usize,
    },
    /// The slice does not hold n × n values.
    WrongLength {
        /// Number of states, n.
        states: usize,
        /// Number of values found.
        found: usize,
    },
    /// A row does not have one value per state.
    RowLength {
        /// The row, from 0.
        row: usize,
        /// Number of values found.
        found: usize,
        /// Number of rows, and so of states.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    Entry {
        /// Destination state (row of A).
        to: usize,
        /// Source state (column of A).
        from: usize,
        /// Value found.
        value: f64,
    },
    /// An entry names a state that does not exist.
    OutOfRange {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
        /// Number of states.
        states: usize,
    },
    /// An entry is given twice.
    Duplicate {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
    },
    /// The probabilities of the transitions out of a state (a column) do not sum to one.
    ColumnSum {
        /// Source state.
        column: usize,
        /// Sum of the column.
        sum: f64,
    },
    /// The columns do not sum to one but the rows do: the matrix is probably transposed.
    RowsSumToOne {
        /// Source state.
        column: usize,
        /// Sum of the column.
        sum: f64,
    },
    /// A weight is NaN, negative or infinite.
    Weight {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
        /// Value found.
        value: f64,
    },
    /// All transitions out of a state have weight 0.
    NoWeight {
        /// Source state.
        column: usize,
    },
    /// The products with A and with A' are not those of one matrix and its transpose.
    Transpose {
        /// v' (A u), by the product with A.
        forward: f64,
        /// u' (A' v), by the product with A'.
        backward: f64,
    },
    /// A move that was observed or expected is not allowed by the operator.
    Forbidden {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
    },
    /// There are more states or entries than 32-bit indices can address.
    TooMany {
        /// Name of the counted items, such as "states" or "entries".
        what: &'static str,
        /// Number found.
        count: usize,
    },
    /// The operators of a family differ in their number of states.
    StateCount {
        /// Index of the operator, from 0.
        operator: usize,
        /// Number of states found.
        found: usize,
        /// Number of states of operator 0.
        expected: usize,
    },
    /// A parameter of the operator is out of range.
    Parameter {
        /// Name of the parameter.
        what: String,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// A part of the operator has another number of states than the operator it is built on.
    PartStates {
        /// Name of the part.
        part: &'static str,
        /// Number of states of the part.
        found: usize,
        /// Number of states of the inner operator.
        expected: usize,
    },
    /// The operator does not accept the control.
    Control(String),
}

impl fmt::Display for TransitionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "a transition operator needs at least one state, found none"),
            Self::NotSquare { rows, columns } => write!(
                f,
                "the transition matrix has {rows} rows and {columns} columns, expected a square one"
            ),
            Self::WrongLength { states, found } => write!(
                f,
                "{found} values given for {states} states, expected {} (states squared)",
                states.saturating_mul(*states)
            ),
            Self::RowLength { row, found, expected } => {
                write!(f, "row {row} has {found} values, expected {expected}, as many as rows")
            }
            Self::Entry { to, from, value } => write!(
                f,
                "the transition from state {from} to state {to} has probability {value}, expected a finite value of at least 0"
            ),
            Self::OutOfRange { to, from, states } => write!(
                f,
                "the transition from state {from} to state {to} is out of range, there are {states} states (0 to {})",
                states.saturating_sub(1)
            ),
            Self::Duplicate { to, from } => {
                write!(f, "the transition from state {from} to state {to} is given twice")
            }
            Self::ColumnSum { column, sum } => write!(
                f,
                "column {column} (the transitions out of state {column}) sums to {sum}, expected 1"
            ),
            Self::RowsSumToOne { column, sum } => write!(
                f,
                "column {column} (the transitions out of state {column}) sums to {sum}, expected 1, but the rows sum to one: transpose, so that the entry at row i and column j is p(to i | from j)"
            ),
            Self::Weight { to, from, value } => write!(
                f,
                "the transition from state {from} to state {to} has weight {value}, expected a finite value of at least 0"
            ),
            Self::NoWeight { column } => write!(
                f,
                "column {column} (the transitions out of state {column}) has no weight above 0, expected at least one"
            ),
            Self::Transpose { forward, backward } => write!(
                f,
                "v' (A u) is {forward} but u' (A' v) is {backward}: apply and apply_transpose differ"
            ),
            Self::Forbidden { to, from } => write!(
                f,
                "the move from state {from} to state {to} is forbidden, the transition operator has no such entry"
            ),
            Self::TooMany { what, count } => {
                write!(f, "{count} {what}, expected at most 4294967295 (32-bit indices)")
            }
            Self::StateCount { operator, found, expected } => write!(
                f,
                "operator {operator} has {found} states, expected {expected} as operator 0"
            ),
            Self::Parameter { what, value, expected } => {
                write!(f, "{what} is {value}, expected {expected}")
            }
            Self::PartStates { part, found, expected } => write!(
                f,
                "the {part} has {found} states, expected {expected} as the operator within"
            ),
            Self::Control(reason) => f.write_str(reason),
        }
    }
}

impl Error for TransitionError {}

/// A likelihood that could not be computed or is invalid.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum LikelihoodError {
    /// A likelihood (or log-likelihood) is out of range.
    Value {
        /// The state, from 0.
        state: usize,
        /// "likelihood" or "log-likelihood".
        kind: &'static str,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// The common log factor is NaN, or above 1e300 in magnitude.
    LogFactor {
        /// Value found.
        value: f64,
    },
    /// The diagonal, or a vector given as an observation, does not have one value per state.
    WrongLength {
        /// Number of values found.
        found: usize,
        /// Number of states.
        expected: usize,
    },
    /// The table does not have the symbol.
    Symbol {
        /// The symbol, from 0.
        symbol: usize,
        /// Number of symbols.
        symbols: usize,
    },
    /// The bound on the likelihoods of unlisted states is out of range.
    Bound {
        /// "likelihood" or "log-likelihood".
        kind: &'static str,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// A state is listed twice in an observation.
    Twice {
        /// The state, from 0.
        state: usize,
    },
    /// An observation lists a state that does not exist.
    Listed {
        /// The state, from 0.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// A sensor defined outside this crate failed.
    Sensor(Arc<dyn Error + Send + Sync>),
}

impl fmt::Display for LikelihoodError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value { state, kind, value, expected } => {
                write!(f, "state {state} has {kind} {value}, expected {expected}")
            }
            Self::LogFactor { value } => {
                write!(f, "the log factor is {value}, expected a value from -1e300 to 1e300")
            }
            Self::WrongLength { found, expected } => write!(
                f,
                "the likelihood has {found} values, expected one for each of {expected} states"
            ),
            Self::Symbol { symbol, symbols } => write!(
                f,
                "symbol {symbol} does not exist, the table has {symbols} symbols (0 to {})",
                symbols.saturating_sub(1)
            ),
            Self::Bound { kind, value, expected } => write!(
                f,
                "the {kind} of states not listed is bounded by {value}, expected {expected}"
            ),
            Self::Twice { state } => write!(f, "state {state} is listed twice"),
            Self::Listed { state, states } => write!(
                f,
                "the observation lists state {state}, but there are {states} states (0 to {})",
                states.saturating_sub(1)
            ),
            Self::Sensor(source) => write!(f, "the sensor failed: {source}"),
        }
    }
}

impl Error for LikelihoodError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Sensor(source) => source.source(),
            _ => None,
        }
    }
}

/// An invalid table of observation probabilities.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TableError {
    /// There are no states or no symbols.
    Empty {
        /// Number of states.
        states: usize,
        /// Number of symbols.
        symbols: usize,
    },
    /// The rows differ in length.
    RowLength {
        /// The state, from 0.
        state: usize,
        /// Number of values in its row.
        found: usize,
        /// Number of values in the row of state 0.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    Entry {
        /// The state, from 0.
        state: usize,
        /// The symbol, from 0.
        symbol: usize,
        /// Value found.
        value: f64,
    },
    /// The probabilities of a state's symbols do not sum to one.
    RowSum {
        /// The state, from 0.
        state: usize,
        /// Sum found.
        sum: f64,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty { states, symbols } => write!(
                f,
                "a table needs at least one state and one symbol, found {states} states and {symbols} symbols"
            ),
            Self::RowLength { state, found, expected } => write!(
                f,
                "the row of state {state} has {found} values, expected {expected} as state 0"
            ),
            Self::Entry { state, symbol, value } => write!(
                f,
                "state {state} shows symbol {symbol} with probability {value}, expected a finite value of at least 0"
            ),
            Self::RowSum { state, sum } => {
                write!(f, "the probabilities of what state {state} shows sum to {sum}, expected 1")
            }
        }
    }
}

impl Error for TableError {}

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
    /// The transition operator is not valid.
    Transition(TransitionError),
}

impl fmt::Display for HmmError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StateCount { part, found, first, expected } => {
                write!(f, "the {part} has {found} states, expected {expected} as the {first}")
            }
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
