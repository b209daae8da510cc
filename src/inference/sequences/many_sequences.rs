//! Routines for many sequences, in parallel with the feature `rayon`.

use std::convert::Infallible;
use std::ops::ControlFlow;

use super::forward::FilteredSequence;
use super::posteriors::Posteriors;
use super::smoother::SmoothedSequence;
use crate::error::SequenceError;
use crate::hmm::Hmm;
use crate::inference::decoding::viterbi::ViterbiPath;
use crate::inference::engines::lanes::{self, Room, Routine};
use crate::likelihood::Likelihood;
use crate::sequence::{self, Sequence};
use crate::transition::{Transition, TransitionEntries};

/// # Many sequences
///
/// Each method for one sequence has two counterparts for many, of any lengths:
///
/// | method | takes | for |
/// |---|---|---|
/// | with `_map_all` | an iterator of sequences | any number of them: it passes each result to a visitor, in order, and keeps none |
/// | with `_all` | a slice of sequences | results that are all wanted, and fit in memory |
///
/// Results are equal up to rounding to those for one sequence (paths and errors exactly). With the
/// feature `rayon`, sequences run in parallel, with the same results to the bit; source and visitor
/// are called on the thread of the caller.
///
/// With a [`SparseTransition`](crate::SparseTransition) or a
/// [`DenseTransition`](crate::DenseTransition) of more than eight states, groups of eight
/// sequences of nearly the same length run side by side, one in each lane of a vector, where a
/// step then takes less time: most so with dense matrices, and not with large sparse ones. A group
/// takes 128 n T bytes beside its results. `_all` finds groups among all sequences, `_map_all`
/// among 64 consecutive ones.
///
/// **Memory** of `_map_all`: sequences are taken in chunks of consecutive ones, at most 64, and
/// fewer if n T adds up to 262,144 (32,768 where they run one by one); for each thread, up to
/// four chunks are under way or wait to be visited. Posteriors of a chunk share a block of memory,
/// which serves again for a later chunk if the visitor has dropped its results by then; a result
/// that is kept keeps the block, and a clone has memory of its own.
///
/// **A sequence that fails** does not affect the others; its [`SequenceError`] names it, so that
/// the results can also be collected into one.
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
        self.forward_chunks(sequences.into_iter(), false, visit)
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
        self.smooth_chunks(sequences.into_iter(), false, visit)
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
        self.log_likelihood_chunks(sequences.into_iter(), false, visit)
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
        self.viterbi_chunks(sequences.into_iter(), false, visit)
    }

    /// Runs [`forward`](Self::forward) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn forward_all<S>(&self, sequences: &[S]) -> Vec<Result<FilteredSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        by_length(sequences, |ordered, collect| self.forward_chunks(ordered, true, collect))
    }

    /// Runs [`smooth`](Self::smooth) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn smooth_all<S>(&self, sequences: &[S]) -> Vec<Result<SmoothedSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        by_length(sequences, |ordered, collect| self.smooth_chunks(ordered, true, collect))
    }

    /// Runs [`log_likelihood`](Self::log_likelihood) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn log_likelihood_all<S>(&self, sequences: &[S]) -> Vec<Result<f64, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        by_length(sequences, |ordered, collect| self.log_likelihood_chunks(ordered, true, collect))
    }

    /// Runs [`viterbi`](Self::viterbi) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn viterbi_all<S>(&self, sequences: &[S]) -> Vec<Result<ViterbiPath, SequenceError>>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        by_length(sequences, |ordered, collect| self.viterbi_chunks(ordered, true, collect))
    }
}

/// Each routine for sequences in chunks.
impl<A: Transition + Sync, B: Likelihood + Sync> Hmm<A, B> {
    fn forward_chunks<S, T>(
        &self,
        sequences: impl Iterator<Item = S>,
        kept: bool,
        visit: impl FnMut(usize, Result<FilteredSequence, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        let routine = Routine {
            room: Room::Rows,
            kept,
            together: lanes::filter,
            finish: |(logs, log): (Vec<f64>, f64), rows| {
                FilteredSequence::new(Posteriors::from_part(self.states(), rows), logs, log)
            },
            single: |sequence: &S| self.forward(sequence),
        };
        lanes::each(self, sequences, &routine, visit)
    }

    fn smooth_chunks<S, T>(
        &self,
        sequences: impl Iterator<Item = S>,
        kept: bool,
        visit: impl FnMut(usize, Result<SmoothedSequence, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        let routine = Routine {
            room: Room::Rows,
            kept,
            together: lanes::smooth,
            finish: |log: f64, rows| {
                SmoothedSequence::new(Posteriors::from_part(self.states(), rows), log)
            },
            single: |sequence: &S| self.smooth(sequence),
        };
        lanes::each(self, sequences, &routine, visit)
    }

    fn log_likelihood_chunks<S, T>(
        &self,
        sequences: impl Iterator<Item = S>,
        kept: bool,
        visit: impl FnMut(usize, Result<f64, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        let routine = Routine {
            room: Room::Nothing,
            kept,
            together: lanes::log_likelihood,
            finish: |log, _| log,
            single: |sequence: &S| self.log_likelihood(sequence),
        };
        lanes::each(self, sequences, &routine, visit)
    }

    fn viterbi_chunks<S, T>(
        &self,
        sequences: impl Iterator<Item = S>,
        kept: bool,
        visit: impl FnMut(usize, Result<ViterbiPath, SequenceError>) -> ControlFlow<T>,
    ) -> ControlFlow<T>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Send + Sync,
    {
        let routine = Routine {
            room: Room::Nothing,
            kept,
            together: lanes::viterbi,
            finish: |path, _| path,
            single: |sequence: &S| self.viterbi(sequence),
        };
        lanes::each(self, sequences, &routine, visit)
    }
}

/// Visitor that collects results.
type Collect<'a, R> = &'a mut dyn FnMut(usize, Result<R, SequenceError>) -> ControlFlow<Infallible>;

/// Passes sequences on in the order of their lengths, so that groups are of nearly the same
/// length, and collects the results in the order of the sequences.
fn by_length<U, Y: ?Sized, S: Sequence<U, Y>, R>(
    sequences: &[S],
    chunks: impl FnOnce(std::vec::IntoIter<&S>, Collect<'_, R>) -> ControlFlow<Infallible>,
) -> Vec<Result<R, SequenceError>> {
    let steps: Vec<usize> = sequences.iter().map(Sequence::steps).collect();
    let order = sequence::by_length(&steps);
    let mut results: Vec<_> = order.iter().map(|_| None).collect();
    let ordered: Vec<_> = order.iter().map(|&sequence| &sequences[sequence]).collect();
    let ControlFlow::Continue(()) = chunks(ordered.into_iter(), &mut |index, result| {
        let sequence = order[index];
        results[sequence] = Some(result.map_err(|error| SequenceError { sequence, ..error }));
        ControlFlow::Continue(())
    });
    results.into_iter().flatten().collect()
}
