//! What can be wrong with models and observations, one enum per concern. What
//! can be wrong with maps, sensors of places and scores stands with them.
//!
//! A message says what was found, where, and what was expected, and ends with that of
//! its cause. As the cause is in the text, `source` is what is behind the cause, so that a
//! chain says nothing twice. States and symbols are counted from 0, as in slices; steps from 1, as in `y_1 … y_T`.

mod inference;
mod snapshot;

pub use inference::{InferenceError, LearnError, SequenceError};
pub use snapshot::SnapshotError;

use std::error::Error;
use std::fmt;
use std::sync::Arc;

/// Why a vector is not a probability distribution over states.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum BeliefError {
    /// There are no states at all.
    Empty,
    /// A probability is NaN, negative or infinite.
    Probability {
        /// The state, from 0.
        state: usize,
        /// What was found.
        value: f64,
    },
    /// The probabilities do not sum to one, or all weights are 0.
    Sum {
        /// What they sum to.
        sum: f64,
        /// What was expected of the sum.
        expected: &'static str,
    },
    /// A state beyond the last one.
    State {
        /// The state asked for, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// A level outside 0 to 1.
    Level {
        /// What was given.
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

/// Why an operator is not a transition operator, or a control not one of its.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TransitionError {
    /// There are no states at all.
    Empty,
    /// The matrix is not square.
    NotSquare {
        /// Rows found.
        rows: usize,
        /// Columns found.
        columns: usize,
    },
    /// A slice does not hold n × n values.
    WrongLength {
        /// How many states were announced.
        states: usize,
        /// How many values were given.
        found: usize,
    },
    /// A row has not a value for each state.
    RowLength {
        /// The row, from 0.
        row: usize,
        /// Values found.
        found: usize,
        /// How many rows there are, and so states.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    Entry {
        /// The state that is reached (row of A).
        to: usize,
        /// The state that is left (column of A).
        from: usize,
        /// What was found.
        value: f64,
    },
    /// A state beyond the last one.
    OutOfRange {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
        /// How many states there are.
        states: usize,
    },
    /// An entry was given twice.
    Duplicate {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
    },
    /// The probabilities of leaving a state do not sum to one.
    ColumnSum {
        /// The state that is left.
        column: usize,
        /// What its column sums to.
        sum: f64,
    },
    /// The same of a matrix whose rows sum to one: it is given as its transpose.
    RowsSumToOne {
        /// The state that is left.
        column: usize,
        /// What its column sums to.
        sum: f64,
    },
    /// A weight is NaN, negative or infinite.
    Weight {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
        /// What was found.
        value: f64,
    },
    /// No weight above 0 leads out of a state.
    NoWeight {
        /// The state that is left.
        column: usize,
    },
    /// The two products are not those of one matrix and its transpose.
    Transpose {
        /// By A.
        forward: f64,
        /// By A'.
        backward: f64,
    },
    /// A move was seen or expected that the operator does not allow.
    Forbidden {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
    },
    /// More states or entries than 32-bit indices can name.
    TooMany {
        /// States or entries.
        what: &'static str,
        /// How many there are.
        count: usize,
    },
    /// Operators of one family differ in size.
    StateCount {
        /// The operator's number, from 0.
        operator: usize,
        /// Its states.
        found: usize,
        /// The states of operator 0.
        expected: usize,
    },
    /// A number that the operator is made from is not a valid one.
    Parameter {
        /// Which number.
        what: String,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A part of the operator is of another size than what it is built on.
    PartStates {
        /// Which part.
        part: &'static str,
        /// Its states.
        found: usize,
        /// The states of the operator within.
        expected: usize,
    },
    /// A control that the operator does not know.
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
            Self::Control(value) => write!(f, "unknown control: {value}"),
        }
    }
}

impl Error for TransitionError {}

/// Why an observation gives no likelihood.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum LikelihoodError {
    /// A likelihood (or log-likelihood) is not a valid one.
    Value {
        /// The state, from 0.
        state: usize,
        /// "likelihood" or "log-likelihood".
        kind: &'static str,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// The common log factor is NaN, or beyond 1e300 in size.
    LogFactor {
        /// What was found.
        value: f64,
    },
    /// The diagonal, or a vector given as an observation, has a wrong length.
    WrongLength {
        /// Values found.
        found: usize,
        /// The number of states.
        expected: usize,
    },
    /// A symbol that the table does not hold.
    Symbol {
        /// The symbol, from 0.
        symbol: usize,
        /// How many symbols there are.
        symbols: usize,
    },
    /// The bound on the likelihoods of states that were not listed is not a
    /// valid one.
    Bound {
        /// Likelihood or log-likelihood.
        kind: &'static str,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A state is listed twice in an observation.
    Twice {
        /// The state, from 0.
        state: usize,
    },
    /// An observation lists a state that the model does not have.
    Listed {
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// A sensor of your own has failed.
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

/// Why a table of observation probabilities is not one.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TableError {
    /// There are no states or no symbols.
    Empty {
        /// States found.
        states: usize,
        /// Symbols found.
        symbols: usize,
    },
    /// The rows are not of one length.
    RowLength {
        /// The state, from 0.
        state: usize,
        /// Values in its row.
        found: usize,
        /// Values in the row of state 0.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    Entry {
        /// The state, from 0.
        state: usize,
        /// The symbol, from 0.
        symbol: usize,
        /// What was found.
        value: f64,
    },
    /// A state's probabilities do not sum to one.
    RowSum {
        /// The state, from 0.
        state: usize,
        /// What they sum to.
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

/// Why parts do not make a hidden Markov model.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts differ in their number of states.
    StateCount {
        /// Which part differs from the first.
        part: &'static str,
        /// Its states.
        found: usize,
        /// The first part.
        first: &'static str,
        /// The states of the first part.
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
