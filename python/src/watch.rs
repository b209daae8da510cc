//! Ctrl-C while something is computed.
//!
//! Every routine of the library asks its sequence for each observation, so that a sequence can look
//! for signals. A handler that raises (that of Ctrl-C does) ends the routine by unwinding, which the
//! library's results and models do not notice: nothing of a batch routine outlives it.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::Instant;

use pyo3::prelude::*;
use wayfix::Sequence;

use crate::error::invalid;

/// Number of observations between two looks at the clock.
const OFTEN: u32 = 64;
/// Milliseconds between two looks for signals, each of which waits for the global lock.
const PAUSE: u64 = 100;

/// Looks for signals, now and then. Counts are approximate if threads share it.
#[derive(Debug)]
pub(crate) struct Watch {
    start: Instant,
    reads: AtomicU32,
    next: AtomicU64,
    stopped: AtomicBool,
}

impl Watch {
    pub(crate) fn new() -> Self {
        Self {
            start: Instant::now(),
            reads: AtomicU32::new(0),
            next: AtomicU64::new(PAUSE),
            stopped: AtomicBool::new(false),
        }
    }

    /// Ends all threads that read sequences of this watch.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Returns a sequence that looks for signals as it is read.
    pub(crate) fn over<S>(&self, sequence: S) -> Watched<'_, S> {
        Watched { sequence, watch: self }
    }

    /// Returns sequences that look for signals as they are read.
    pub(crate) fn over_all<S>(&self, sequences: Vec<S>) -> Vec<Watched<'_, S>> {
        sequences.into_iter().map(|sequence| self.over(sequence)).collect()
    }

    #[inline]
    fn read(&self) {
        let reads = self.reads.load(Ordering::Relaxed).wrapping_add(1);
        self.reads.store(reads, Ordering::Relaxed);
        if reads.is_multiple_of(OFTEN) {
            self.look();
        }
    }

    #[cold]
    fn look(&self) {
        if self.stopped.load(Ordering::Relaxed) {
            resume_unwind(Box::new(()));
        }
        let now = u64::try_from(self.start.elapsed().as_millis()).unwrap_or(u64::MAX);
        if now >= self.next.load(Ordering::Relaxed) {
            self.next.store(now + PAUSE, Ordering::Relaxed);
            let looked = Python::attach(|py| {
                py.check_signals()?;
                Ok::<_, PyErr>(())
            });
            if let Err(raised) = looked {
                resume_unwind(Box::new(raised));
            }
        }
    }
}

/// A sequence that looks for signals as it is read.
#[derive(Debug)]
pub(crate) struct Watched<'w, S> {
    sequence: S,
    watch: &'w Watch,
}

impl<U, Y: ?Sized, S: Sequence<U, Y>> Sequence<U, Y> for Watched<'_, S> {
    fn steps(&self) -> usize {
        self.sequence.steps()
    }

    fn control(&self, step: usize) -> &U {
        self.sequence.control(step)
    }

    #[inline]
    fn observation(&self, step: usize) -> &Y {
        self.watch.read();
        self.sequence.observation(step)
    }
}

/// Computes without the global lock. Raises what a signal handler raised, and `Error` for a
/// panic, which is a defect.
pub(crate) fn computed<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce(&Watch) -> T + Send,
) -> PyResult<T> {
    let watch = Watch::new();
    py.detach(|| caught(|| compute(&watch))).map_err(defect)
}

/// Computes; returns the payload if that unwinds.
pub(crate) fn caught<T>(compute: impl FnOnce() -> T) -> Result<T, Box<dyn Any + Send>> {
    catch_unwind(AssertUnwindSafe(compute))
}

/// Makes an exception of the payload of what unwound.
pub(crate) fn defect(payload: Box<dyn Any + Send>) -> PyErr {
    match payload.downcast::<PyErr>() {
        Ok(raised) => *raised,
        Err(other) => {
            let text = other.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| other.downcast_ref::<&str>().copied());
            invalid(format!("a defect of wayfix: {}", text.unwrap_or("it panicked")))
        }
    }
}
