//! Many sequences on several threads, with their results in order.
//!
//! The threads work without the global lock. The thread that called waits for them and looks for
//! signals meanwhile, since Python handles these on its main thread only.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use pyo3::prelude::*;
use wayfix::error::SequenceError;
use wayfix::{Hmm, Likelihood, Sequence, Transition};

use crate::error::of_sequence;
use crate::watch::{PAUSE, Watch, Watched, caught, computed, defect};

/// Most sequences of a chunk: enough to find groups of nearly the same length among them, and few
/// enough to report progress often.
const SEQUENCES: usize = 256;
/// Numbers, one for each state at each step, that fill a chunk: 32 MB. Any eight sequences that are
/// short enough for the library to run them side by side have no more, so that no group is cut.
const NUMBERS: usize = 1 << 22;

/// Runs a routine on the sequences, a chunk at a time, and passes each result on, in order, up to
/// the first error. Besides what is kept of them, there are only the results of one chunk.
pub(crate) fn in_chunks<A: Transition, B: Likelihood, S, R>(
    hmm: &Hmm<A, B>,
    watch: &Watch,
    sequences: Vec<S>,
    run: impl Fn(&[Watched<'_, S>]) -> Vec<Result<R, SequenceError>>,
    mut take: impl FnMut(R),
) -> Result<(), SequenceError>
where
    S: Sequence<A::Control, B::Observation>,
{
    let numbers = |sequence: &S| hmm.states().saturating_mul(sequence.steps());
    let sizes: Vec<usize> = sequences.iter().map(numbers).collect();
    let sequences = watch.over_all(sequences);
    let mut start = 0;
    while start < sequences.len() {
        let end = start + chunk(&sizes[start..]);
        for result in run(&sequences[start..end]) {
            // The routine counts from the start of the chunk.
            take(result.map_err(|error| of_part(start, error))?);
        }
        start = end;
    }
    Ok(())
}

/// Returns the number of sequences of the next chunk, given how many numbers each has.
fn chunk(sizes: &[usize]) -> usize {
    let (mut count, mut numbers) = (0, 0_usize);
    while count < sizes.len().min(SEQUENCES) && numbers < NUMBERS {
        numbers = numbers.saturating_add(sizes[count]);
        count += 1;
    }
    count
}

/// Returns the error of a sequence of a part, counted from the first sequence of all.
fn of_part(start: usize, error: SequenceError) -> SequenceError {
    SequenceError { sequence: start + error.sequence, ..error }
}

/// Average number of parts for each thread, so that threads with short sequences take more parts.
const PARTS: usize = 8;

/// Threads and progress that the user asked for.
pub(crate) struct Way<'a, 'py> {
    pub(crate) jobs: usize,
    /// Called with the number of sequences done and the number of all.
    pub(crate) progress: Option<&'a Bound<'py, PyAny>>,
}

/// Returns the result of each sequence, in order, or raises the first error.
pub(crate) fn results<A, B, S, R: Send>(
    py: Python<'_>,
    way: &Way<'_, '_>,
    hmm: &Hmm<A, B>,
    sequences: Vec<S>,
    run: impl Fn(&[Watched<'_, S>]) -> Vec<Result<R, SequenceError>> + Sync,
) -> PyResult<Vec<R>>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Send,
{
    let (all, done) = (sequences.len(), AtomicUsize::new(0));
    let part = |sequences: Vec<S>, watch: &Watch| -> Result<Vec<R>, SequenceError> {
        let mut kept = Vec::with_capacity(sequences.len());
        in_chunks(hmm, watch, sequences, &run, |result| {
            done.fetch_add(1, Ordering::Relaxed);
            kept.push(result);
        })?;
        Ok(kept)
    };
    // One thread without progress needs no other thread: the sequences themselves look for signals.
    if way.jobs <= 1 && way.progress.is_none() {
        let found = computed(py, |watch| part(sequences, watch))?;
        return found.map_err(|error| of_sequence(py, &error));
    }
    let report = || {
        way.progress
            .map_or(Ok(()), |call| call.call1((done.load(Ordering::Relaxed), all)).map(|_| ()))
    };
    let parts = on_threads(py, way.jobs, sequences, &part, report)?;
    let mut kept = Vec::with_capacity(all);
    for found in parts {
        match found {
            Ok(found) => kept.extend(found),
            Err(error) => {
                // Parts are contiguous and come in order, and all earlier ones were kept whole, so
                // `kept` has as many results as there are sequences before this part.
                return Err(of_sequence(py, &of_part(kept.len(), error)));
            }
        }
    }
    Ok(kept)
}

/// Works on contiguous parts of the sequences and returns the result of each part, in order. The
/// calling thread meanwhile looks for signals and reports.
fn on_threads<S: Send, T: Send>(
    py: Python<'_>,
    jobs: usize,
    sequences: Vec<S>,
    work: &(impl Fn(Vec<S>, &Watch) -> T + Sync),
    report: impl Fn() -> PyResult<()>,
) -> PyResult<Vec<T>> {
    let size = sequences.len().div_ceil(jobs * PARTS).max(1);
    let mut rest = sequences.into_iter();
    let parts = std::iter::from_fn(|| Some(rest.by_ref().take(size).collect::<Vec<S>>()));
    let parts: Vec<Vec<S>> = parts.take_while(|part| !part.is_empty()).collect();
    let mut found: Vec<Option<T>> = parts.iter().map(|_| None).collect();
    let queue = Mutex::new(parts.into_iter().enumerate());
    let watch = Watch::new();
    // The scope joins all threads before it returns, also after an error: `watch.stop()` makes
    // those that still work unwind at their next look.
    std::thread::scope(|scope| {
        let (sender, mut receiver) = mpsc::channel();
        for _ in 0..jobs.min(found.len()) {
            let (sender, queue, watch) = (sender.clone(), &queue, &watch);
            scope.spawn(move || {
                let next = || queue.lock().ok()?.next();
                while let Some((number, part)) = next() {
                    let made = caught(|| work(part, watch));
                    // The receiver is gone after an error or a signal.
                    if sender.send((number, made)).is_err() {
                        return;
                    }
                }
            });
        }
        // Only the threads keep senders now, so a wait ends once all threads have ended.
        drop(sender);
        let mut missing = found.len();
        while missing > 0 {
            let waiting = &mut receiver;
            match py.detach(move || waiting.recv_timeout(PAUSE)) {
                Ok((number, Ok(made))) => {
                    found[number] = Some(made);
                    missing -= 1;
                    continue;
                }
                Ok((_, Err(payload))) => {
                    watch.stop();
                    return Err(defect(payload));
                }
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                // Not reached while a part is missing: `caught` makes each thread send a message
                // for every part it takes, and taking one cannot poison the queue.
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
            if let Err(raised) = py.check_signals().and_then(|()| report()) {
                watch.stop();
                return Err(raised);
            }
        }
        report()
    })?;
    Ok(found.into_iter().flatten().collect())
}
