//! What can be wrong with models and observations, one enum per concern. What
//! can be wrong with maps, sensors of places and scores stands with them.
//!
//! A message says what was found, where, and what was expected; where an error
//! has a source, the source says so. States and
//! symbols are counted from 0, as in slices; steps from 1, as in `y_1 … y_T`.

mod inference;

pub use inference::{InferenceError, LearnError, SequenceError};

use thiserror::Error;

/// Why a vector is not a probability distribution over states.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum BeliefError {
    /// There are no states at all.
    #[error("a belief needs at least one state, found none")]
    Empty,
    /// A probability is NaN, negative or infinite.
    #[error("state {state} has probability {value}, expected a finite value of at least 0")]
    Probability {
        /// The state, from 0.
        state: usize,
        /// What was found.
        value: f64,
    },
    /// The probabilities do not sum to one, or all weights are 0.
    #[error("the probabilities sum to {sum}, expected {expected}")]
    Sum {
        /// What they sum to.
        sum: f64,
        /// What was expected of the sum.
        expected: &'static str,
    },
    /// A state beyond the last one.
    #[error("state {state} does not exist, the belief has {states} states (0 to {})", states.saturating_sub(1))]
    State {
        /// The state asked for, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// A level outside 0 to 1.
    #[error("the level is {level}, expected a value from 0 to 1")]
    Level {
        /// What was given.
        level: f64,
    },
}

/// Why an operator is not a transition operator, or a control not one of its.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TransitionError {
    /// There are no states at all.
    #[error("a transition operator needs at least one state, found none")]
    Empty,
    /// The matrix is not square.
    #[error("the transition matrix has {rows} rows and {columns} columns, expected a square one")]
    NotSquare {
        /// Rows found.
        rows: usize,
        /// Columns found.
        columns: usize,
    },
    /// A slice does not hold n × n values.
    #[error("{found} values given for {states} states, expected {} (states squared)", states.saturating_mul(*states))]
    WrongLength {
        /// How many states were announced.
        states: usize,
        /// How many values were given.
        found: usize,
    },
    /// A probability is NaN, negative or infinite.
    #[error(
        "the transition from state {from} to state {to} has probability {value}, expected a finite value of at least 0"
    )]
    Entry {
        /// The state that is reached (row of A).
        to: usize,
        /// The state that is left (column of A).
        from: usize,
        /// What was found.
        value: f64,
    },
    /// A state beyond the last one.
    #[error(
        "the transition from state {from} to state {to} is out of range, there are {states} states (0 to {})",
        states.saturating_sub(1)
    )]
    OutOfRange {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
        /// How many states there are.
        states: usize,
    },
    /// An entry was given twice.
    #[error("the transition from state {from} to state {to} is given twice")]
    Duplicate {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
    },
    /// The probabilities of leaving a state do not sum to one.
    #[error("column {column} (the transitions out of state {column}) sums to {sum}, expected 1")]
    ColumnSum {
        /// The state that is left.
        column: usize,
        /// What its column sums to.
        sum: f64,
    },
    /// The two products are not those of one matrix and its transpose.
    #[error("v' (A u) is {forward} but u' (A' v) is {backward}: apply and apply_transpose differ")]
    Transpose {
        /// By A.
        forward: f64,
        /// By A'.
        backward: f64,
    },
    /// A move was seen or expected that the operator does not allow.
    #[error(
        "the move from state {from} to state {to} is forbidden, the transition operator has no such entry"
    )]
    Forbidden {
        /// The state that is reached.
        to: usize,
        /// The state that is left.
        from: usize,
    },
    /// More states or entries than 32-bit indices can name.
    #[error("{count} {what}, expected at most 4294967295 (32-bit indices)")]
    TooMany {
        /// States or entries.
        what: &'static str,
        /// How many there are.
        count: usize,
    },
    /// Operators of one family differ in size.
    #[error("operator {operator} has {found} states, expected {expected} as operator 0")]
    StateCount {
        /// The operator's number, from 0.
        operator: usize,
        /// Its states.
        found: usize,
        /// The states of operator 0.
        expected: usize,
    },
    /// A number that the operator is made from is not a valid one.
    #[error("{what} is {value}, expected {expected}")]
    Parameter {
        /// Which number.
        what: String,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A part of the operator is of another size than what it is built on.
    #[error("the {part} has {found} states, expected {expected} as the operator within")]
    PartStates {
        /// Which part.
        part: &'static str,
        /// Its states.
        found: usize,
        /// The states of the operator within.
        expected: usize,
    },
    /// A control that the operator does not know.
    #[error("unknown control: {0}")]
    Control(String),
}

/// Why an observation gives no likelihood.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LikelihoodError {
    /// A likelihood (or log-likelihood) is not a valid one.
    #[error("state {state} has {kind} {value}, expected {expected}")]
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
    #[error("the log factor is {value}, expected a value from -1e300 to 1e300")]
    LogFactor {
        /// What was found.
        value: f64,
    },
    /// The diagonal, or a vector given as an observation, has a wrong length.
    #[error("the likelihood has {found} values, expected one for each of {expected} states")]
    WrongLength {
        /// Values found.
        found: usize,
        /// The number of states.
        expected: usize,
    },
    /// A symbol that the table does not hold.
    #[error("symbol {symbol} does not exist, the table has {symbols} symbols (0 to {})", symbols.saturating_sub(1))]
    Symbol {
        /// The symbol, from 0.
        symbol: usize,
        /// How many symbols there are.
        symbols: usize,
    },
    /// A state is said to be known that the model does not have.
    #[error("state {state} is given as known, but there are {states} states (0 to {})", states.saturating_sub(1))]
    State {
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// The bound on the likelihoods of states that were not listed is not a
    /// valid one.
    #[error("the {kind} of states not listed is bounded by {value}, expected {expected}")]
    Bound {
        /// Likelihood or log-likelihood.
        kind: &'static str,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A state is listed twice in an observation.
    #[error("state {state} is listed twice")]
    Twice {
        /// The state, from 0.
        state: usize,
    },
    /// An observation lists a state that the model does not have.
    #[error("the observation lists state {state}, but there are {states} states (0 to {})", states.saturating_sub(1))]
    Listed {
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
    /// A sensor of your own has failed.
    #[error("the sensor failed")]
    Sensor(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// Why a table of observation probabilities is not one.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TableError {
    /// There are no states or no symbols.
    #[error(
        "a table needs at least one state and one symbol, found {states} states and {symbols} symbols"
    )]
    Empty {
        /// States found.
        states: usize,
        /// Symbols found.
        symbols: usize,
    },
    /// The rows are not of one length.
    #[error("the row of state {state} has {found} values, expected {expected} as state 0")]
    RowLength {
        /// The state, from 0.
        state: usize,
        /// Values in its row.
        found: usize,
        /// Values in the row of state 0.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    #[error(
        "state {state} shows symbol {symbol} with probability {value}, expected a finite value of at least 0"
    )]
    Entry {
        /// The state, from 0.
        state: usize,
        /// The symbol, from 0.
        symbol: usize,
        /// What was found.
        value: f64,
    },
    /// A state's probabilities do not sum to one.
    #[error("the probabilities of what state {state} shows sum to {sum}, expected 1")]
    RowSum {
        /// The state, from 0.
        state: usize,
        /// What they sum to.
        sum: f64,
    },
}

/// Why parts do not make a hidden Markov model.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts differ in their number of states.
    #[error("the {part} has {found} states, expected {expected} as the {first}")]
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
    #[error("the transition operator is not valid")]
    Transition(#[from] TransitionError),
}
