//! Stored matrices, for which inference has loops of its own.

use super::{DenseTransition, SparseTransition};
use crate::kernels::Lines;

/// A stored matrix, for which this crate has loops of its own.
///
/// Returned by [`Transition::stored`](super::Transition::stored).
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a>(Form<'a>);

/// Storage format.
#[derive(Debug, Clone, Copy)]
enum Form<'a> {
    Sparse(&'a SparseTransition),
    Dense(&'a DenseTransition),
}

impl<'a> Stored<'a> {
    pub(crate) fn sparse(matrix: &'a SparseTransition) -> Self {
        Self(Form::Sparse(matrix))
    }

    pub(crate) fn dense(matrix: &'a DenseTransition) -> Self {
        Self(Form::Dense(matrix))
    }

    /// The matrix, if it is sparse.
    pub(crate) fn as_sparse(self) -> Option<&'a SparseTransition> {
        match self.0 {
            Form::Sparse(matrix) => Some(matrix),
            Form::Dense(_) => None,
        }
    }

    /// Rows and columns, if values have 64 bits and all above 0 are at least 2^-100.
    pub(crate) fn plain_lines(self) -> Option<(Lines<'a>, Lines<'a>)> {
        match self.0 {
            Form::Sparse(matrix) => matrix.lines().filter(|_| matrix.plain),
            Form::Dense(matrix) => matrix.plain.then(|| matrix.lines()),
        }
    }
}
