//! Transition operators that can be learned.

use super::{MoveCounts, TransitionEntries};
use crate::error::TransitionError;

/// A transition operator that can be estimated from expected moves.
///
/// [`SparseTransition`](crate::SparseTransition) and
/// [`DenseTransition`](crate::DenseTransition) have a free parameter for each
/// entry above 0, [`TiedTransition`](crate::transition::TiedTransition) shares some of them,
/// [`SwitchedTransition`](crate::transition::SwitchedTransition) learns each of its
/// operators, and [`Fixed`](crate::Fixed) keeps any operator as it is.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say how it is learned",
    note = "to keep it as it is, wrap it in `wayfix::Fixed`"
)]
pub trait LearnTransition: TransitionEntries + Sized {
    /// How many sets of moves are counted apart: one, unless controls choose
    /// among several operators; none, if nothing is learned from them.
    fn families(&self) -> usize {
        1
    }

    /// The set, below [`families`](Self::families), in which the moves of a step
    /// under this control are counted; those of another are not.
    fn family(&self, control: &Self::Control) -> usize {
        let _ = control;
        0
    }

    /// The operator that makes these moves most probable, each free parameter
    /// having been seen `pseudo_count` times besides. What is 0 stays 0, and
    /// what was not seen at all (or less than 2.2e-308 times) stays as it is.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that the operator does not
    /// allow.
    fn reestimate(&self, counts: &[MoveCounts], pseudo_count: f64)
    -> Result<Self, TransitionError>;

    /// What the pseudo-counts stand for, the logarithm of a Dirichlet density
    /// but for a constant: `pseudo_count` Σ ln θ over the free parameters above
    /// 0.
    fn log_prior(&self, pseudo_count: f64) -> f64;
}
