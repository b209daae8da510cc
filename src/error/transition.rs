//! Errors of transition operators.

use std::error::Error;
use std::fmt;

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
