//! Errors of transition operators.

use super::{Disagreement, Number, OutOfRange};

/// An invalid transition operator, or a control that it does not accept.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TransitionError {
    /// There are no states.
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
    /// The slice does not hold n × n values.
    #[error("{found} values given for {states} states, expected {} (states squared)", .states.saturating_mul(*.states))]
    WrongLength {
        /// Number of states, n.
        states: usize,
        /// Number of values found.
        found: usize,
    },
    /// A row does not have one value per state.
    #[error("row {row} has {found} values, expected {expected}, as many as rows")]
    RowLength {
        /// The row, from 0.
        row: usize,
        /// Number of values found.
        found: usize,
        /// Number of rows, and so of states.
        expected: usize,
    },
    /// A probability is NaN, negative or infinite.
    #[error(
        "the transition from state {from} to state {to} has probability {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Entry {
        /// Destination state (row of A).
        to: usize,
        /// Source state (column of A).
        from: usize,
        /// Value found.
        value: f64,
    },
    /// An entry names a state that does not exist.
    #[error("the transition from state {from} to state {to} is out of range, there are {states} states (0 to {})", .states.saturating_sub(1))]
    OutOfRange {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
        /// Number of states.
        states: usize,
    },
    /// An entry is given twice.
    #[error("the transition from state {from} to state {to} is given twice")]
    Duplicate {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
    },
    /// The probabilities of the transitions out of a state (a column) do not sum to one.
    #[error(
        "column {column} (the transitions out of state {column}) sums to {sum}, expected 1",
        sum = Number(*.sum)
    )]
    ColumnSum {
        /// Source state.
        column: usize,
        /// Sum of the column.
        sum: f64,
    },
    /// The columns do not sum to one but the rows do: the matrix is probably transposed.
    #[error(
        "column {column} (the transitions out of state {column}) sums to {sum}, expected 1, but the rows sum to one: transpose, so that the entry at row i and column j is p(to i | from j)",
        sum = Number(*.sum)
    )]
    RowsSumToOne {
        /// Source state.
        column: usize,
        /// Sum of the column.
        sum: f64,
    },
    /// A weight is NaN, negative or infinite.
    #[error(
        "the transition from state {from} to state {to} has weight {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Weight {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
        /// Value found.
        value: f64,
    },
    /// A rate is NaN, negative or infinite.
    #[error(
        "the transition from state {from} to state {to} has rate {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Rate {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
        /// Value found.
        value: f64,
    },
    /// All transitions out of a state have weight 0.
    #[error(
        "column {column} (the transitions out of state {column}) has no weight above 0, expected at least one"
    )]
    NoWeight {
        /// Source state.
        column: usize,
    },
    /// The products with A and with A' are not those of one matrix and its transpose.
    #[error(
        "v' (A u) is {forward} but u' (A' v) is {backward}: apply and apply_transpose differ",
        forward = Number(*.forward),
        backward = Number(*.backward)
    )]
    Transpose {
        /// v' (A u), by the product with A.
        forward: f64,
        /// u' (A' v), by the product with A'.
        backward: f64,
    },
    /// A move that was observed or expected is not allowed by the operator.
    #[error(
        "the move from state {from} to state {to} is forbidden, the transition operator has no such entry"
    )]
    Forbidden {
        /// Destination state.
        to: usize,
        /// Source state.
        from: usize,
    },
    /// The statistics of moves belong to another operator.
    #[error("statistics of {found} operators given, expected those of {expected}")]
    Statistics {
        /// Number of operators in the statistics.
        found: usize,
        /// Number of operators.
        expected: usize,
    },
    /// There are more states or entries than 32-bit indices can address.
    #[error("{count} {what}, expected at most 4294967295 (32-bit indices)")]
    TooMany {
        /// Name of the counted items, such as "states" or "entries".
        what: &'static str,
        /// Number found.
        count: usize,
    },
    /// The operators of a family differ in their number of states.
    #[error("operator {operator} has {found} states, expected {expected} to match operator 0")]
    StateCount {
        /// Index of the operator, from 0.
        operator: usize,
        /// Number of states found.
        found: usize,
        /// Number of states of operator 0.
        expected: usize,
    },
    /// A parameter of the operator is out of range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// A part of the operator has another number of states than the operator it is built on.
    #[error("the {part} has {found} states, expected {expected} to match the inner operator")]
    PartStates {
        /// Name of the part.
        part: &'static str,
        /// Number of states of the part.
        found: usize,
        /// Number of states of the inner operator.
        expected: usize,
    },
    /// The operator is not the same at all steps, or its columns need not sum to one.
    #[error("there is no unique stationary distribution: {0}")]
    Stationary(&'static str),
    /// The chain has several closed classes of states, each with a stationary distribution.
    #[error(
        "there is no unique stationary distribution: from state {first} and from state {second}, the transition operator leads to different closed classes"
    )]
    ClosedClasses {
        /// A state from which `second` can't be reached.
        first: usize,
        /// A state from which `first` can't be reached.
        second: usize,
    },
    /// The elimination of states that computes the stationary distribution fills in too much.
    #[error(
        "the stationary distribution of {states} states takes an elimination of more than {most} entries: compute it by repeated products, and give it as `Prior::Stationary`"
    )]
    Elimination {
        /// Number of states of the closed class.
        states: usize,
        /// Largest number of entries allowed.
        most: usize,
    },
    /// The operator does not accept the control.
    #[error("{0}")]
    Control(String),
    /// An operator with restarts was given to an operator with evidence on moves.
    #[error(
        "an EvidenceTransition around a RestartTransition would take restarts for moves: put the restart outside, RestartTransition::new(EvidenceTransition::new(…)?, …)?.with_evidence(…)"
    )]
    Restarts,
    /// Two methods of the operator are not those of one matrix, as
    /// [`kit::check`](crate::transition::kit::check) found.
    #[error(transparent)]
    Disagreement(#[from] Disagreement),
    /// A method of the operator breaks the contract of its trait in another way.
    #[error("`{method}` {problem}")]
    Contract {
        /// Name of the method.
        method: &'static str,
        /// Description of the problem, with the expected behaviour.
        problem: String,
    },
}
