//! Transition operators that can be learned.

use super::{MoveCounts, TransitionEntries};
use crate::error::TransitionError;

/// A transition operator that can be estimated from expected moves.
///
/// [`SparseTransition`](crate::SparseTransition) and
/// [`DenseTransition`](crate::DenseTransition) have a free parameter for each
/// entry above 0, [`TiedTransition`](crate::transition::TiedTransition) shares some of them,
/// [`SwitchedTransition`](crate::transition::SwitchedTransition) learns each of its
/// operators, [`RestartTransition`](crate::transition::RestartTransition) and
/// [`EvidenceTransition`](crate::transition::EvidenceTransition) learn the operator within, and
/// [`Fixed`](crate::Fixed) keeps any operator as it is.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say how it is learned",
    note = "to keep it as it is, wrap it in `wayfix::Fixed`"
)]
pub trait LearnTransition: TransitionEntries + Sized {
    /// Number of separate sets of moves to count: one, unless controls choose
    /// among several operators; 0, if nothing is learned from moves.
    fn families(&self) -> usize {
        1
    }

    /// The set in which the moves of a step under this control are counted; moves of a set not
    /// below [`families`](Self::families) are not counted.
    fn family(&self, control: &Self::Control) -> usize {
        let _ = control;
        0
    }

    /// Lists the entries out of a state whose moves are counted: by default all, or those of A
    /// less the [restarts](Self::restart_log2), which are the same out of all states.
    fn counted(&self, control: &Self::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing(control, from)
    }

    /// Lists the same entries as pairs (to, log2 p), as
    /// [`outgoing_log2`](TransitionEntries::outgoing_log2) does.
    fn counted_log2(
        &self,
        control: &Self::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.outgoing_log2(control, from)
    }

    /// The part of row `to` of A that is the same for all states and not counted, as log2 p; −∞, the
    /// default, if all moves are counted.
    ///
    /// With restarts, learning takes O(counted entries + n) a step, although there are n² moves.
    fn restart_log2(&self, control: &Self::Control, to: usize) -> f64 {
        let _ = (control, to);
        f64::NEG_INFINITY
    }

    /// Returns the operator that makes these moves most probable, with `pseudo_count` added to the
    /// count of each free parameter. Entries of 0 stay 0, and columns without counts (or less than
    /// 2.2e-308 in all) stay as they are.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that the operator does not
    /// allow.
    fn maximize(&self, counts: &[MoveCounts], pseudo_count: f64) -> Result<Self, TransitionError>;

    /// Log-prior that the pseudo-counts stand for, a Dirichlet density but for a constant:
    /// `pseudo_count` Σ ln θ over the free parameters above 0.
    fn log_prior(&self, pseudo_count: f64) -> f64;

    /// Number of parameters that learning may change independently of each other, as information
    /// criteria count them before learning: the entries above 0 less one for each column, if
    /// nothing is tied.
    fn free_parameters(&self) -> usize;
}
