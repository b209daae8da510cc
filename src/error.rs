//! What can be wrong, one enum per concern.
//!
//! Every message says what was found, where, and what was expected. States,
//! places as states, entries and symbols are counted from 0, as in slices;
//! steps are counted from 1, as in `y_1 … y_T`.

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
    /// The probabilities do not sum to one (or, for weights, sum to zero or
    /// overflow).
    #[error("the probabilities sum to {sum}, expected {expected}")]
    Sum {
        /// What they sum to.
        sum: f64,
        /// What was expected of the sum.
        expected: &'static str,
    },
    /// A state beyond the last one.
    #[error("state {state} does not exist, the belief has {states} states (0 to {})", states - 1)]
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
        states - 1
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
    /// The common log factor is NaN or infinite.
    #[error("the log factor is {value}, expected a finite value")]
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
    #[error("symbol {symbol} does not exist, the table has {symbols} symbols (0 to {})", symbols - 1)]
    Symbol {
        /// The symbol, from 0.
        symbol: usize,
        /// How many symbols there are.
        symbols: usize,
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
    #[error("the {part} has {found} states, expected {expected} as the prior")]
    StateCount {
        /// Which part differs from the prior.
        part: &'static str,
        /// Its states.
        found: usize,
        /// The states of the prior.
        expected: usize,
    },
    /// The transition operator is not valid.
    #[error("the transition operator is not valid")]
    Transition(#[from] TransitionError),
}

/// Why inference stopped at a step.
///
/// Steps are counted from 1: step k is about observation `y_k`, which is
/// `ys[k - 1]` of a batch.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum InferenceError {
    /// The model rules the observation out: its probability given all before
    /// it is exactly zero.
    #[error("the observation of step {step} is impossible under the model")]
    Impossible {
        /// The step, from 1.
        step: usize,
    },
    /// The likelihood could not be had.
    #[error("step {step} has no valid likelihood")]
    Likelihood {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: LikelihoodError,
    },
    /// The control is not one that the transition operator knows.
    #[error("step {step} has no valid control")]
    Control {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// The transition operator gave a value that is no probability: it does
    /// not keep its contract.
    #[error(
        "at step {step} the transition operator predicts {value} for state {state}, expected a probability"
    )]
    Predicted {
        /// The step, from 1.
        step: usize,
        /// The state, from 0.
        state: usize,
        /// What it predicted.
        value: f64,
    },
    /// A batch has not as many controls as observations.
    #[error("{controls} controls for {observations} observations, expected one each")]
    ControlCount {
        /// Controls given.
        controls: usize,
        /// Observations given.
        observations: usize,
    },
    /// A snapshot is of another model.
    #[error("the snapshot has {found} states, expected {expected} as the model")]
    Snapshot {
        /// States in the snapshot.
        found: usize,
        /// States of the model.
        expected: usize,
    },
}

/// Why places and roads do not make a map.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MapError {
    /// There are no places at all.
    #[error("a map needs at least one place, found none")]
    Empty,
    /// Two places share an id.
    #[error("place {id} is given twice")]
    DuplicatePlace {
        /// The id.
        id: u32,
    },
    /// A coordinate is not on Earth.
    #[error("place {id} has {coordinate} {value}, expected degrees from {} to {limit}", -limit)]
    Coordinate {
        /// The place's id.
        id: u32,
        /// "latitude" or "longitude".
        coordinate: &'static str,
        /// What was found.
        value: f64,
        /// The largest magnitude that is valid.
        limit: f64,
    },
    /// A road starts or ends at a place that does not exist.
    #[error("the road from place {from} to place {to} needs place {missing}, which does not exist")]
    UnknownPlace {
        /// Where the road starts, by id.
        from: u32,
        /// Where it ends, by id.
        to: u32,
        /// Which of the two is missing.
        missing: u32,
    },
    /// A road was given twice.
    #[error("the road from place {from} to place {to} is given twice")]
    DuplicateRoad {
        /// Where it starts, by id.
        from: u32,
        /// Where it ends, by id.
        to: u32,
    },
    /// A road leads from a place to itself.
    #[error("the road from place {id} leads to itself; staying is the turning rule's matter")]
    Loop {
        /// The place's id.
        id: u32,
    },
    /// A road's length is NaN, infinite, zero or negative.
    #[error(
        "the road from place {from} to place {to} has length {length}, expected metres above 0"
    )]
    Length {
        /// Where it starts, by id.
        from: u32,
        /// Where it ends, by id.
        to: u32,
        /// What was found.
        length: f64,
    },
    /// A file could not be opened or read.
    #[error("cannot read {file}: {reason}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// A line of a file is not as expected.
    #[error("{file}, line {line}: {problem}")]
    Line {
        /// The file.
        file: String,
        /// The line, from 1.
        line: u64,
        /// What is wrong and what was expected.
        problem: String,
    },
}

/// Why a turning rule or table gives no turning probabilities.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TurningError {
    /// A number of the rule is out of its range.
    #[error("{what} is {value}, expected {expected}")]
    Rule {
        /// Which number.
        what: String,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// A turn with no road for it.
    #[error(
        "no road leads from place {from} to place {to}, but its turning probability is {value}"
    )]
    NoRoad {
        /// Where the turn starts, by id.
        from: u32,
        /// Where it ends, by id.
        to: u32,
        /// Its probability.
        value: f64,
    },
    /// The probabilities of a place do not sum to one (paper eq. 1).
    #[error("the turning probabilities of place {id} sum to {sum}, expected 1")]
    Sum {
        /// The place's id.
        id: u32,
        /// What they sum to.
        sum: f64,
    },
    /// The probabilities are no transition operator.
    #[error(transparent)]
    Transition(#[from] TransitionError),
}

/// Why an observation model cannot be built.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ObservationError {
    /// A number is out of its range.
    #[error("{what} is {value}, expected {expected}")]
    Parameter {
        /// Which number.
        what: &'static str,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// No neighbours at all, so nothing can be confused.
    #[error("no place has a neighbour, so a mean correct probability of {mean} cannot be reached")]
    NoNeighbours {
        /// The mean asked for.
        mean: f64,
    },
    /// A place has so many neighbours that nothing is left for itself.
    #[error(
        "place {id} has {neighbours} neighbours, which leaves it a correct probability of {correct}, expected above 0"
    )]
    TooManyNeighbours {
        /// The place's id.
        id: u32,
        /// How many neighbours it has.
        neighbours: usize,
        /// What is left for seeing itself.
        correct: f64,
    },
    /// The probabilities are no table.
    #[error(transparent)]
    Table(#[from] TableError),
}

/// Why estimates cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Truth and estimate differ in length.
    #[error("{estimated} estimates for {truth} true states, expected one each")]
    Length {
        /// True states given.
        truth: usize,
        /// Estimates given.
        estimated: usize,
    },
    /// Nothing to score.
    #[error("no states to score, expected at least one")]
    Empty,
    /// A state beyond the last one.
    #[error("state {state} at index {index} does not exist, there are {states} states (0 to {})", states - 1)]
    State {
        /// Where in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
}
