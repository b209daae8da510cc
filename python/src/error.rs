//! Exceptions: all are `wayfix.Error`, which is a `ValueError`.

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use wayfix::InferenceError;
use wayfix::error::SequenceError;

create_exception!(
    wayfix,
    Error,
    PyValueError,
    "An input that is not valid; the message says which, and what was expected. If it is about one \
     step, `step` is its number, from 1, and `sequence` that of its sequence, from 0."
);
create_exception!(
    wayfix,
    ImpossibleError,
    Error,
    "Observations that the model rules out: the log-likelihood is minus infinity."
);

/// Makes an exception of an error that is none of a step.
pub(crate) fn invalid(error: impl std::fmt::Display) -> PyErr {
    Error::new_err(error.to_string())
}

/// Raises MemoryError if there are not so many bytes, where the library would end the process; a
/// system that promises more memory than it has promises these, too.
pub(crate) fn reserve(bytes: usize, what: impl FnOnce() -> String) -> PyResult<()> {
    let reserved = Vec::<u8>::new().try_reserve_exact(bytes);
    reserved.map_err(|_| PyMemoryError::new_err(format!("{} need up to {bytes} bytes", what())))
}

/// Makes an exception of an error of inference, with its step and its sequence.
pub(crate) fn inference(py: Python<'_>, sequence: usize, error: &InferenceError) -> PyErr {
    noted(py, sequence, error, error.to_string())
}

/// Makes an exception of the error of one of several sequences.
pub(crate) fn of_sequence(py: Python<'_>, error: &SequenceError) -> PyErr {
    noted(py, error.sequence, &error.source, error.to_string())
}

fn noted(py: Python<'_>, sequence: usize, error: &InferenceError, message: String) -> PyErr {
    let exception = match error {
        InferenceError::Impossible { .. } | InferenceError::ImpossibleMove { .. } => {
            ImpossibleError::new_err(message)
        }
        _ => Error::new_err(message),
    };
    let value = exception.value(py);
    let set =
        value.setattr("step", error.step()).and_then(|()| value.setattr("sequence", sequence));
    set.map_or_else(|error| error, |()| exception)
}

/// Gives exceptions without a step or a sequence the attributes all the same.
pub(crate) fn add_attributes(py: Python<'_>) -> PyResult<()> {
    let class = py.get_type::<Error>();
    class.setattr("step", py.None())?;
    class.setattr("sequence", py.None())
}
