//! Matrices that are stored, which inference goes through by itself.

use super::SparseTransition;

/// A matrix that the loops of this crate know how to go through.
///
/// Handed out by [`Transition::stored`](super::Transition::stored).
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a>(Form<'a>);

/// In which form it is stored.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Form<'a> {
    Sparse(&'a SparseTransition),
}

impl<'a> Stored<'a> {
    pub(crate) fn sparse(matrix: &'a SparseTransition) -> Self {
        Self(Form::Sparse(matrix))
    }

    pub(crate) fn form(self) -> Form<'a> {
        self.0
    }
}
