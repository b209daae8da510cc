//! Exceptions: all are `wayfix.Error`, which is a `ValueError`.

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use wayfix::InferenceError;
use wayfix::error::SequenceError;

create_exception!(
    wayfix,
    Error,
    PyValueError,
    "An input that is not valid; the message says which, and what was expected."
);
create_exception!(
    wayfix,
    ImpossibleError,
    Error,
    "Observations that the model rules out; `step` counts from 1, `sequence` from 0."
);

/// Makes an exception of an error that is none of a step.
pub(crate) fn invalid(error: impl std::fmt::Display) -> PyErr {
    Error::new_err(error.to_string())
}

/// Makes an exception of an error of inference, with its step and its sequence.
pub(crate) fn inference(py: Python<'_>, sequence: usize, error: &InferenceError) -> PyErr {
    let impossible = match error {
        InferenceError::Impossible { step } | InferenceError::ImpossibleMove { step } => {
            Some(*step)
        }
        _ => None,
    };
    let Some(step) = impossible else { return invalid(error) };
    let exception = ImpossibleError::new_err(error.to_string());
    let value = exception.value(py);
    let noted = value.setattr("step", step).and_then(|()| value.setattr("sequence", sequence));
    noted.map_or_else(|error| error, |()| exception)
}

/// Makes an exception of the error of one of several sequences.
pub(crate) fn of_sequence(py: Python<'_>, error: &SequenceError) -> PyErr {
    inference(py, error.sequence, &error.source)
}
