//! Results of many sequences, one after another, with a look for signals between them.

use std::ops::ControlFlow;

use pyo3::prelude::*;
use wayfix::error::SequenceError;

use crate::error::of_sequence;

/// Cause for which the results end early.
pub(crate) enum Stopped {
    Failed(SequenceError),
    /// A signal handler raised.
    Raised(PyErr),
}

/// Number of sequences between two looks for signals.
const OFTEN: usize = 64;

/// Returns a visitor that keeps what is made of each result, until there is an error.
pub(crate) fn collect<R, T>(
    results: &mut Vec<T>,
    mut make: impl FnMut(R) -> T,
) -> impl FnMut(usize, Result<R, SequenceError>) -> ControlFlow<Stopped> {
    move |index, result| {
        if index % OFTEN == OFTEN - 1
            && let Err(raised) = signals()
        {
            return ControlFlow::Break(Stopped::Raised(raised));
        }
        match result {
            Ok(result) => {
                results.push(make(result));
                ControlFlow::Continue(())
            }
            Err(error) => ControlFlow::Break(Stopped::Failed(error)),
        }
    }
}

fn signals() -> PyResult<()> {
    Python::attach(|py| {
        py.check_signals()?;
        Ok(())
    })
}

/// Raises what the results ended with.
pub(crate) fn check(py: Python<'_>, stopped: ControlFlow<Stopped>) -> PyResult<()> {
    match stopped {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(Stopped::Raised(raised)) => Err(raised),
        ControlFlow::Break(Stopped::Failed(error)) => Err(of_sequence(py, &error)),
    }
}
