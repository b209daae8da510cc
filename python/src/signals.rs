//! Ctrl-C during computations that hold no lock.

use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
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

/// What another thread has to say.
enum Message<T, E> {
    /// An event, and where to answer if that should be the end.
    Event(E, Sender<bool>),
    Done(T),
}

/// Computes on another thread, for routines of the library that are long and cannot be stopped:
/// after Ctrl-C the caller goes on at once, and the thread ends with its result unread; `work` may
/// look at its argument, which is then true, to end early.
pub(crate) fn in_background<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send + 'static,
) -> PyResult<T> {
    in_background_with(py, |stopped, _| work(stopped), |event: Infallible| match event {})
}

/// Computes on another thread as `in_background`, and answers the events that `work` passes to its
/// second argument, on this one: true asks for the end.
pub(crate) fn in_background_with<T: Send + 'static, E: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool, &dyn Fn(E) -> bool) -> T + Send + 'static,
    mut answer: impl FnMut(E) -> PyResult<bool>,
) -> PyResult<T> {
    let (sender, mut messages) = channel();
    let stopped = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&stopped);
    let send = move || {
        let tell = |event| {
            let (reply, replies) = channel();
            // Nobody listens after Ctrl-C.
            sender.send(Message::Event(event, reply)).is_err() || replies.recv().unwrap_or(true)
        };
        let done = work(&stop, &tell);
        let _ = sender.send(Message::Done(done));
    };
    Builder::new().spawn(send).map_err(invalid)?;
    loop {
        let next;
        (next, messages) = py.detach(move || (messages.recv_timeout(OFTEN), messages));
        match next {
            Ok(Message::Done(result)) => return Ok(result),
            Ok(Message::Event(event, reply)) => {
                py.check_signals()?;
                // A thread that waits for the reply is there to read it.
                let _ = reply.send(answer(event)?);
            }
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| stopped.store(true, Ordering::Relaxed))?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(invalid("an internal error ended the computation"));
            }
        }
    }
}
