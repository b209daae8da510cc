//! Routines for many sequences, in lanes where the model allows it, and in parallel with the
//! feature `rayon`.
//!
//! Each pairs the routine for one sequence with its counterpart for eight in lanes;
//! `engines::lanes` applies the two to any number of sequences, and falls back to the former for
//! any lane that leaves the range of doubles.

use std::ops::ControlFlow;

use super::forward::FilteredSequence;
use super::posteriors::Posteriors;
use super::smoother::SmoothedSequence;
use crate::error::SequenceError;
use crate::hmm::Hmm;
use crate::inference::decoding::viterbi::ViterbiPath;
use crate::inference::engines::lanes::{self, LaneRoutine};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels::LANES;

/// # Many sequences
///
/// Each method for one sequence has two counterparts for many, of any lengths:
///
/// | method | takes | for |
/// |---|---|---|
/// | with `_map_all` | an iterator of sequences | any number of them: passes each result to a visitor, in order, and keeps none |
/// | with `_all` | a slice of sequences | results that are all needed and fit in memory |
///
/// Results equal those for one sequence up to rounding (paths and errors exactly). With the
/// feature `rayon`, sequences run in parallel, with the same results to the bit; source and visitor
/// are called on the caller's thread.
///
/// With a [`SparseTransition`](crate::SparseTransition) or a
/// [`DenseTransition`](crate::DenseTransition) of more than eight states, groups of eight
/// sequences of nearly the same length run side by side, one in each lane of a vector, wherever
/// that makes a step faster: most with dense matrices, not with large sparse ones. A group takes
/// 128 n T bytes in addition to its results. `_all` finds groups among all sequences, `_map_all`
/// among 64 consecutive ones.
///
/// **Memory** of `_map_all`: sequences are processed in chunks of at most 64 consecutive ones, or
/// fewer if n T adds up to 262,144 (32,768 where they run one by one); for each thread, up to
/// four chunks are in progress or waiting to be visited. Posteriors of a chunk share a block of
/// memory, which is reused for a later chunk if the visitor has dropped its results by then. A
/// result that is kept keeps the whole block alive; a clone has memory of its own.
///
/// **A sequence that fails** does not affect the others. Its [`SequenceError`] names it, so that
/// results can also be collected into a single `Result`.
///
/// ```
/// use std::ops::ControlFlow;
/// # let hmm = wayfix::canberra::hmm(5, 1.0)?;
/// let drives = [vec![4, 5, 6], vec![4, 4, 5, 5], vec![80]];
/// let smoothed = hmm.smooth_all(&drives);
/// assert_eq!(smoothed[1].as_ref().unwrap().posteriors().steps(), 4);
/// let scores: Vec<f64> = hmm.log_likelihood_all(&drives[..2]).into_iter().collect::<Result<_, _>>()?;
/// # assert_eq!(scores.len(), 2);
///
/// // A million drives, as they are read, with a word on progress.
/// let source = (0..1_000_000).map(|k| vec![4; 1 + k % 3]);
/// let mut steps = 0;
/// let stopped = hmm.smooth_map_all(source, |index, smoothed| {
///     match smoothed {
///         Ok(smoothed) => steps += smoothed.posteriors().steps(),
///         Err(error) => eprintln!("{error}"),
///     }
///     if index % 100 == 99 {
///         println!("{} drives, {steps} steps", index + 1);
///     }
///     if index < 499 { ControlFlow::Continue(()) } else { ControlFlow::Break(index) }
/// });
/// assert_eq!(stopped, ControlFlow::Break(499));
/// # assert_eq!(steps, 999);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
impl<A: Transition + Sync, B: Likelihood + Sync> Hmm<A, B> {
    /// Runs [`forward`](Self::forward) on each sequence, and visits the results in order, each
    /// with the index of its sequence, until the visitor breaks.
    pub fn forward_map_all<S, T>(
        &self,
        sequences: impl IntoIterator<Item = S>,
        visit: impl FnMut(usize, Result<FilteredSequence, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        lanes::visit_all(self, sequences.into_iter(), false, &forward(), visit)
    }

    /// Runs [`smooth`](Self::smooth) on each sequence, and visits the results in order, each
    /// with the index of its sequence, until the visitor breaks.
    pub fn smooth_map_all<S, T>(
        &self,
        sequences: impl IntoIterator<Item = S>,
        visit: impl FnMut(usize, Result<SmoothedSequence, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        lanes::visit_all(self, sequences.into_iter(), false, &smooth(), visit)
    }

    /// Runs [`log_likelihood`](Self::log_likelihood) on each sequence, and visits the results in
    /// order, each with the index of its sequence, until the visitor breaks.
    pub fn log_likelihood_map_all<S, T>(
        &self,
        sequences: impl IntoIterator<Item = S>,
        visit: impl FnMut(usize, Result<f64, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        lanes::visit_all(self, sequences.into_iter(), false, &log_likelihood(), visit)
    }

    /// Runs [`viterbi`](Self::viterbi) on each sequence, and visits the results in order, each
    /// with the index of its sequence, until the visitor breaks.
    pub fn viterbi_map_all<S, T>(
        &self,
        sequences: impl IntoIterator<Item = S>,
        visit: impl FnMut(usize, Result<ViterbiPath, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        lanes::visit_all(self, sequences.into_iter(), false, &viterbi(), visit)
    }

    /// Runs [`forward`](Self::forward) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn forward_all<S>(&self, sequences: &[S]) -> Vec<Result<FilteredSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        lanes::collect_all(self, sequences, &forward())
    }

    /// Runs [`smooth`](Self::smooth) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn smooth_all<S>(&self, sequences: &[S]) -> Vec<Result<SmoothedSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        lanes::collect_all(self, sequences, &smooth())
    }

    /// Runs [`log_likelihood`](Self::log_likelihood) on each sequence. The result at index i is
    /// that of sequence i.
    pub fn log_likelihood_all<S>(&self, sequences: &[S]) -> Vec<Result<f64, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        lanes::collect_all(self, sequences, &log_likelihood())
    }

    /// Runs [`viterbi`](Self::viterbi) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn viterbi_all<S>(&self, sequences: &[S]) -> Vec<Result<ViterbiPath, SequenceError>>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        lanes::collect_all(self, sequences, &viterbi())
    }
}

/// [`Hmm::forward`] in lanes: log-likelihoods of each step and of all steps, and the rows.
fn forward<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, (Vec<f64>, f64), FilteredSequence> {
    LaneRoutine {
        has_rows: true,
        single: Hmm::forward,
        group: |model, group, memory| {
            // Logarithms of an invalid lane are dropped with it: its sum is `None`.
            let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
            let forward = model.forward(group, memory, true, |lane, log| logs[lane].push(log));
            let mut sums = forward.log_likelihoods().into_iter();
            logs.map(|logs| sums.next().flatten().map(|sum| (logs, sum)))
        },
        result: |(logs, log), rows| FilteredSequence::new(Posteriors::from_shared(rows), logs, log),
    }
}

/// [`Hmm::smooth`] in lanes: log-likelihoods, and the rows.
fn smooth<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, f64, SmoothedSequence> {
    LaneRoutine {
        has_rows: true,
        single: Hmm::smooth,
        group: |model, group, memory| {
            // The log-likelihoods are read after the backward pass, which may find further lanes
            // out of range and clear them in `valid`.
            let mut forward = model.forward(group, memory, true, |_, _| ());
            model.backward(group, memory, &mut forward.valid, None);
            forward.log_likelihoods()
        },
        result: |log, rows| SmoothedSequence::new(Posteriors::from_shared(rows), log),
    }
}

/// [`Hmm::log_likelihood`] in lanes, which stores nothing for each step.
fn log_likelihood<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, f64, f64> {
    LaneRoutine {
        has_rows: false,
        single: Hmm::log_likelihood,
        group: |model, group, memory| {
            model.forward(group, memory, false, |_, _| ()).log_likelihoods()
        },
        result: |log, _| log,
    }
}

/// [`Hmm::viterbi`] in lanes: paths and their log-probabilities.
fn viterbi<A: TransitionEntries, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, (Vec<usize>, f64), ViterbiPath> {
    LaneRoutine {
        has_rows: false,
        single: Hmm::viterbi,
        group: |model, group, memory| model.viterbi(group, memory),
        result: |(states, log_probability), _| ViterbiPath { states, log_probability },
    }
}
