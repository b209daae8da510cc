//! Many sequences on several threads, with their results in order.
//!
//! The threads work without the global lock. The thread that called waits for them and looks for
//! signals meanwhile, since Python handles these on its main thread only.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use pyo3::prelude::*;
use wayfix::error::SequenceError;

use crate::error::of_sequence;
use crate::watch::{PAUSE, Watch, Watched, caught, computed, defect};

/// Takes the result of a sequence by its number.
pub(crate) type Visit<'v, R> =
    dyn FnMut(usize, Result<R, SequenceError>) -> ControlFlow<SequenceError> + 'v;

/// Returns a visitor that keeps a part of each result and stops at the first error.
pub(crate) fn collect<R, T>(
    results: &mut Vec<T>,
    mut make: impl FnMut(R) -> T,
) -> impl FnMut(usize, Result<R, SequenceError>) -> ControlFlow<SequenceError> {
    move |_, result| match result {
        Ok(result) => {
            results.push(make(result));
            ControlFlow::Continue(())
        }
        Err(error) => ControlFlow::Break(error),
    }
}

/// Raises the error that ended the visits, if one did.
pub(crate) fn check(py: Python<'_>, ended: ControlFlow<SequenceError>) -> PyResult<()> {
    match ended {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(error) => Err(of_sequence(py, &error)),
    }
}

/// Average number of parts for each thread, so that threads with short sequences take more parts.
const PARTS: usize = 8;

/// Threads and progress that the user asked for.
pub(crate) struct Way<'a, 'py> {
    pub(crate) jobs: usize,
    /// Called with the number of sequences done and the number of all.
    pub(crate) progress: Option<&'a Bound<'py, PyAny>>,
}

/// Returns a part of the result of each sequence, in order, or raises the first error.
pub(crate) fn results<S: Send, R, T: Send>(
    py: Python<'_>,
    way: &Way<'_, '_>,
    sequences: Vec<S>,
    run: impl Fn(Vec<Watched<'_, S>>, &mut Visit<'_, R>) -> ControlFlow<SequenceError> + Sync,
    make: impl Fn(R) -> T + Sync,
) -> PyResult<Vec<T>> {
    let (all, done) = (sequences.len(), AtomicUsize::new(0));
    let part = |sequences: Vec<S>, watch: &Watch| -> Result<Vec<T>, SequenceError> {
        let mut kept = Vec::with_capacity(sequences.len());
        let count = |result| {
            done.fetch_add(1, Ordering::Relaxed);
            make(result)
        };
        let ended = run(watch.over_all(sequences), &mut collect(&mut kept, count));
        ended.break_value().map_or(Ok(kept), Err)
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
                // Parts are contiguous and come in order, and those before were kept whole, so
                // `kept` has as many results as there are sequences before this part.
                let sequence = kept.len() + error.sequence;
                return Err(of_sequence(py, &SequenceError { sequence, ..error }));
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
        // Only the threads keep senders now, so that a wait ends if all threads have.
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
