//! Routines for many sequences, in parallel with the feature `rayon`.

use super::batch::{self, Room};
use super::filtering::FilteredSequence;
use super::posteriors::Posteriors;
use super::smoother::SmoothedSequence;
use super::viterbi::ViterbiPath;
use crate::error::SequenceError;
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::{Transition, TransitionEntries};

/// # Many sequences
///
/// Each method for one sequence has a counterpart with `_all` for many, of any lengths. Results
/// are equal up to rounding (paths and errors exactly). With the feature `rayon`, sequences run
/// in parallel, with the same results to the bit.
///
/// With a [`SparseTransition`](crate::SparseTransition) or a
/// [`DenseTransition`](crate::DenseTransition) of more than eight states, groups of eight
/// sequences of nearly the same length run side by side, one in each lane of a vector: a step
/// then takes less time, most so with dense matrices, and a group takes 128 n T bytes beside its
/// results.
///
/// Results of such sequences share blocks of memory of up to 32 MB, which live as long as any
/// result in them; a clone has memory of its own.
///
/// The result at index i is that of sequence i. A sequence that fails does not affect the others;
/// its [`SequenceError`] names it, so that the results can also be collected into one.
///
/// ```
/// # let hmm = wayfix::canberra::hmm(5, 1.0)?;
/// let drives = [vec![4, 5, 6], vec![4, 4, 5, 5], vec![80]];
/// let smoothed = hmm.smooth_all(&drives);
/// assert_eq!(smoothed[1].as_ref().unwrap().posteriors().steps(), 4);
/// let scores: Vec<f64> = hmm.log_likelihood_all(&drives[..2]).into_iter().collect::<Result<_, _>>()?;
/// # assert_eq!(scores.len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
impl<A: Transition + Sync, B: Likelihood + Sync> Hmm<A, B> {
    /// Runs [`forward`](Self::forward) on each sequence.
    pub fn forward_all<S>(&self, sequences: &[S]) -> Vec<Result<FilteredSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let finish = |(logs, log): (Vec<f64>, f64), rows| {
            FilteredSequence::new(Posteriors::from_part(self.states(), rows), logs, log)
        };
        let single = |sequence: &S| self.forward(sequence);
        batch::each(self, sequences, Room::Rows, batch::filter, finish, single)
    }

    /// Runs [`smooth`](Self::smooth) on each sequence.
    pub fn smooth_all<S>(&self, sequences: &[S]) -> Vec<Result<SmoothedSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let finish =
            |log: f64, rows| SmoothedSequence::new(Posteriors::from_part(self.states(), rows), log);
        let single = |sequence: &S| self.smooth(sequence);
        batch::each(self, sequences, Room::Rows, batch::smooth, finish, single)
    }

    /// Runs [`log_likelihood`](Self::log_likelihood) on each sequence.
    pub fn log_likelihood_all<S>(&self, sequences: &[S]) -> Vec<Result<f64, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let single = |sequence: &S| self.log_likelihood(sequence);
        batch::each(self, sequences, Room::Nothing, batch::log_likelihood, |log, _| log, single)
    }

    /// Runs [`viterbi`](Self::viterbi) on each sequence.
    pub fn viterbi_all<S>(&self, sequences: &[S]) -> Vec<Result<ViterbiPath, SequenceError>>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let single = |sequence: &S| self.viterbi(sequence);
        batch::each(self, sequences, Room::Nothing, batch::viterbi, |path, _| path, single)
    }
}
