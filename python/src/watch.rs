//! Ctrl-C during a computation without the global lock.
//!
//! Routines that read their input piece by piece look for signals as they read: a [`Watch`] looks
//! when an observation or a query is asked for. A handler that raises (that of Ctrl-C does) ends
//! the routine by unwinding. That is sound since nothing of a batch routine outlives it: models are
//! only read, and a result exists only once it is complete. [`computed`] does that.
//!
//! Routines that are given all of their input at once cannot look. [`in_background`] runs them on
//! another thread while this one looks: after Ctrl-C the caller continues at once, and the other
//! thread continues unseen, until it is done or notices that its watch is stopped.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use wayfix::Sequence;

use crate::error::invalid;

/// Number of observations between two looks at the clock.
const OFTEN: u32 = 64;
/// Time between two looks for signals, since each look waits for the global lock.
pub(crate) const PAUSE: Duration = Duration::from_millis(100);

/// Looks for signals from time to time. Counts are approximate if threads share it.
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
            next: AtomicU64::new(millis(PAUSE)),
            stopped: AtomicBool::new(false),
        }
    }

    /// Ends all threads that read sequences of this watch.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// True once nobody wants the result.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Returns rows that look for signals as they are read.
    pub(crate) fn over_rows<'a>(
        &'a self,
        rows: impl Iterator<Item = &'a [f32]>,
    ) -> Vec<WatchedRow<'a>> {
        rows.map(|row| WatchedRow { row, watch: self }).collect()
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
        // A load and a store, where `fetch_add` would lock the line at each observation: a count
        // that a race loses only delays the next look.
        let reads = self.reads.load(Ordering::Relaxed).wrapping_add(1);
        self.reads.store(reads, Ordering::Relaxed);
        if reads.is_multiple_of(OFTEN) {
            self.look();
        }
    }

    #[cold]
    fn look(&self) {
        // `resume_unwind` rather than `panic!`: the panic hook would print a message.
        if self.is_stopped() {
            resume_unwind(Box::new(()));
        }
        let now = millis(self.start.elapsed());
        // Attaching waits for the global lock, which another thread may hold for long; so it is
        // done ten times a second at most.
        if now >= self.next.load(Ordering::Relaxed) {
            self.next.store(now + millis(PAUSE), Ordering::Relaxed);
            let looked = Python::attach(|py| {
                py.check_signals()?;
                Ok::<_, PyErr>(())
            });
            if let Err(raised) = looked {
                unwind(raised);
            }
        }
    }
}

fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// Ends the computation, which then raises the exception.
pub(crate) fn unwind(exception: PyErr) -> ! {
    resume_unwind(Box::new(exception))
}

/// Query that looks for signals as it is read. It looks each time, not each 64th, since a query may
/// be compared with many references.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WatchedRow<'a> {
    row: &'a [f32],
    watch: &'a Watch,
}

impl AsRef<[f32]> for WatchedRow<'_> {
    fn as_ref(&self) -> &[f32] {
        self.watch.look();
        self.row
    }
}

/// Sequence that looks for signals as it is read.
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

/// Computes without the global lock. Raises the exception of a signal handler, and `Error` for a
/// panic, which is a defect.
pub(crate) fn computed<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce(&Watch) -> T + Send,
) -> PyResult<T> {
    let watch = Watch::new();
    py.detach(|| caught(|| compute(&watch))).map_err(defect)
}

/// Computes on another thread. Raises the exception of a signal handler at once, and stops the
/// watch of the other thread.
pub(crate) fn in_background<T: Send + 'static>(
    py: Python<'_>,
    compute: impl FnOnce(&Watch) -> T + Send + 'static,
) -> PyResult<T> {
    in_background_with(py, compute, || Ok(()))
}

/// Computes as `in_background` does, and reports from time to time; an error of the report ends the
/// wait, too.
pub(crate) fn in_background_with<T: Send + 'static>(
    py: Python<'_>,
    compute: impl FnOnce(&Watch) -> T + Send + 'static,
    report: impl Fn() -> PyResult<()>,
) -> PyResult<T> {
    let (sender, mut receiver) = channel();
    let watch = Arc::new(Watch::new());
    let own = Arc::clone(&watch);
    let work = move || {
        // After Ctrl-C the receiver is gone, and the result is dropped.
        let _ = sender.send(caught(|| compute(&own)));
    };
    // `thread::spawn` would panic if the system refuses another thread.
    Builder::new().spawn(work).map_err(invalid)?;
    loop {
        let next;
        // Without the lock only values that are `Send` may be used. A receiver is, but a shared
        // reference to it is not, so the receiver itself goes in and comes back.
        (next, receiver) = py.detach(move || (receiver.recv_timeout(PAUSE), receiver));
        match next {
            Ok(done) => return done.map_err(defect),
            Err(RecvTimeoutError::Timeout) => {
                let looked = py.check_signals().and_then(|()| report());
                looked.inspect_err(|_| watch.stop())?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(invalid("a defect of wayfix: a thread ended without a result"));
            }
        }
    }
}

/// Computes, and returns the payload if that unwinds.
pub(crate) fn caught<T>(compute: impl FnOnce() -> T) -> Result<T, Box<dyn Any + Send>> {
    // Unwind safe by the argument at the top: nothing that was being changed is seen again.
    catch_unwind(AssertUnwindSafe(compute))
}

/// Makes an exception of the payload of an unwinding.
pub(crate) fn defect(payload: Box<dyn Any + Send>) -> PyErr {
    match payload.downcast::<PyErr>() {
        // From `unwind`: not a panic at all.
        Ok(raised) => *raised,
        Err(other) => {
            let text = other.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| other.downcast_ref::<&str>().copied());
            invalid(format!("a defect of wayfix: {}", text.unwrap_or("it panicked")))
        }
    }
}
