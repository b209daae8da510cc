//! Ctrl-C during computations that hold no lock.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread::Builder;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::error::invalid;

/// Time between two looks for signals.
const OFTEN: Duration = Duration::from_millis(100);

/// Looks for signals from time to time, without the global lock.
#[derive(Debug)]
pub(crate) struct Signals {
    last: Mutex<Instant>,
    raised: Mutex<Option<PyErr>>,
    stopped: AtomicBool,
}

impl Signals {
    pub(crate) fn new() -> Self {
        let (last, raised) = (Mutex::new(Instant::now()), Mutex::new(None));
        Self { last, raised, stopped: AtomicBool::new(false) }
    }

    /// True once a signal handler has raised.
    pub(crate) fn pending(&self) -> bool {
        if self.stopped.load(Ordering::Relaxed) {
            return true;
        }
        let Ok(mut last) = self.last.try_lock() else { return false };
        if last.elapsed() < OFTEN {
            return false;
        }
        *last = Instant::now();
        let looked = Python::attach(|py| {
            py.check_signals()?;
            Ok(())
        });
        let Err(error) = looked else { return false };
        if let Ok(mut raised) = self.raised.lock() {
            *raised = Some(error);
        }
        self.stopped.store(true, Ordering::Relaxed);
        true
    }

    /// Returns what a signal handler raised, or else the result.
    pub(crate) fn check<T>(self, result: PyResult<T>) -> PyResult<T> {
        match self.raised.into_inner() {
            Ok(Some(raised)) => Err(raised),
            _ => result,
        }
    }
}

/// Computes on another thread, for routines of the library that are long and cannot be stopped:
/// after Ctrl-C the caller goes on at once, and the thread ends with its result unread; `work` may
/// look at its argument, which is then true, to end early.
pub(crate) fn in_background<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, mut results) = channel();
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let send = move || {
        // Nobody waits for it after Ctrl-C.
        let _ = sender.send(work(&stop));
    };
    Builder::new().spawn(send).map_err(invalid)?;
    loop {
        let next;
        (next, results) = py.detach(move || (results.recv_timeout(OFTEN), results));
        match next {
            Ok(result) => return Ok(result),
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| stopped.store(true, Ordering::Relaxed))?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(invalid("an internal error ended the computation"));
            }
        }
    }
}
