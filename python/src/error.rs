//! Exceptions: the library's errors as `wayfix.Error`, a `ValueError` with the attributes `step`
//! (from 1) and `sequence` (from 0). Memory that is not there is Python's own `MemoryError`.

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use wayfix::HmmError;
use wayfix::error::{SequenceError, TransitionError};
use wayfix_recognition::RecognitionError;
use wayfix_roads::matching::MatchError;

create_exception!(
    wayfix,
    Error,
    PyValueError,
    "Invalid input; the message says which, and what was expected. If the error is about one step, \
     `step` is the number of the step, from 1, and `sequence` that of its sequence, from 0."
);
create_exception!(
    wayfix,
    ImpossibleError,
    Error,
    "Observations that the model rules out: the log-likelihood is minus infinity."
);

/// Makes an exception of an error that is not about one step.
pub(crate) fn invalid(error: impl std::fmt::Display) -> PyErr {
    Error::new_err(words(&error.to_string()))
}

/// Raises MemoryError if this many bytes cannot be allocated, where the library would abort the
/// process. A system that overcommits memory also grants these.
pub(crate) fn reserve(bytes: usize, what: impl FnOnce() -> String) -> PyResult<()> {
    // Reserved and freed at once: a probe of the allocator, not a guarantee.
    let reserved = Vec::<u8>::new().try_reserve_exact(bytes);
    reserved.map_err(|_| PyMemoryError::new_err(format!("{} need up to {bytes} bytes", what())))
}

/// Makes an exception of an error of inference, with its step and its sequence.
pub(crate) fn inference(py: Python<'_>, sequence: usize, error: &HmmError) -> PyErr {
    noted(py, sequence, error, error.to_string())
}

/// Makes an exception of the error of one of several sequences.
pub(crate) fn of_sequence(py: Python<'_>, error: &SequenceError) -> PyErr {
    noted(py, error.sequence, &error.source, error.to_string())
}

/// Makes an exception of an error about one step of a sequence.
pub(crate) fn of_step(py: Python<'_>, sequence: usize, step: usize, message: String) -> PyErr {
    placed(py, invalid(message), sequence, Some(step))
}

/// Gives an exception its sequence, and the step that it is about.
pub(crate) fn placed(
    py: Python<'_>,
    exception: PyErr,
    sequence: usize,
    step: Option<usize>,
) -> PyErr {
    let value = exception.value(py);
    let set = value.setattr("step", step).and_then(|()| value.setattr("sequence", sequence));
    set.map_or_else(|error| error, |()| exception)
}

/// Makes an exception of an error of one of several sequences that were read one by one, so that
/// the error does not know its sequence yet.
pub(crate) fn of_several(py: Python<'_>, sequence: usize, error: &PyErr) -> PyErr {
    let value = error.value(py);
    // KeyboardInterrupt, MemoryError and whatever else Python raised keep their types.
    if !error.is_instance_of::<Error>(py) {
        return error.clone_ref(py);
    }
    // The base class loses nothing: only inference raises `ImpossibleError`, and this error comes
    // from reading.
    let step = value.getattr("step").and_then(|step| step.extract()).unwrap_or(None);
    placed(py, invalid(format!("sequence {sequence}: {value}")), sequence, step)
}

/// Makes an exception of an error in the moves: a column of the library's matrix is a row here.
pub(crate) fn of_moves(error: &TransitionError) -> PyErr {
    let row = |state: &usize| format!("row {state} of moves (those from state {state})");
    match error {
        TransitionError::ColumnSum { column, sum } => {
            invalid(format!("{} sums to {sum}, expected 1", row(column)))
        }
        // Rows and columns change places in the message, as they did in the matrix.
        TransitionError::RowsSumToOne { column, sum } => invalid(format!(
            "{} sums to {sum}, expected 1, but the columns sum to one: transpose, so that row i, \
             column j has the probability of a move from state i to state j",
            row(column)
        )),
        other => invalid(other),
    }
}

/// Makes an exception of an error of one of several drives.
pub(crate) fn of_drive(py: Python<'_>, error: &MatchError) -> PyErr {
    let (drive, cause) = match error {
        MatchError::Drive(at) => (at.number, &*at.cause),
        // A single drive or a vehicle, whose errors do not count drives.
        one => (0, one),
    };
    // Points count from 0 in the library, and steps from 1 here.
    let step = match cause {
        MatchError::Point { point, .. } | MatchError::Time { point, .. } => Some(point + 1),
        MatchError::Inference(error) => error.step(),
        _ => None,
    };
    placed(py, invalid(error), drive, step)
}

/// Makes an exception of an error of recognition, with the step and the labelled part.
pub(crate) fn recognition(py: Python<'_>, error: &RecognitionError) -> PyErr {
    let placed = |step| placed(py, invalid(error), 0, step);
    match error {
        RecognitionError::Descriptor(at) | RecognitionError::Query(at) => placed(Some(at.number)),
        RecognitionError::Inference(failed) => placed(failed.cause.step()),
        // The library counts steps of labels from 0, and this package from 1.
        RecognitionError::Label { part, step, place, references } => {
            let (step, last) = (step + 1, references.saturating_sub(1));
            let message = format!(
                "step {step} of labelled part {part} shows references up to {place}, expected a \
                 non-empty range within 0 to {last}"
            );
            of_step(py, *part, step, message)
        }
        // The cause knows its step, the wrapper its part; the message of the wrapper has both.
        RecognitionError::Part(at) => {
            let cause = recognition(py, &at.cause);
            let step = cause.value(py).getattr("step").and_then(|step| step.extract());
            self::placed(py, invalid(error), at.number, step.unwrap_or(None))
        }
        other => invalid(other),
    }
}

/// Replaces the words of Rust and serde in a message by Python's.
fn words(message: &str) -> String {
    // Replaced one after another, so that "invalid type: floating point `" loses its middle first.
    const WORDS: [(&str, &str); 14] = [
        ("Options::", "the option "),
        ("`with_missing`", "`missing=True`"),
        ("the sensor failed: ", ""),
        ("floating point ", ""),
        ("integer `", "`"),
        ("boolean `", "`"),
        ("invalid type: null", "invalid type: None"),
        ("invalid type: map", "invalid type: a dictionary"),
        ("invalid type: sequence", "invalid type: a list"),
        ("expected a sequence", "expected a list"),
        ("expected usize", "expected an integer from 0"),
        ("expected u64", "expected an integer from 0"),
        ("expected f64", "expected a number"),
        ("expected a boolean", "expected True or False"),
    ];
    let mut words = message.to_owned();
    for (rust, python) in WORDS {
        words = words.replace(rust, python);
    }
    // Serde names the Rust type after these words, and nothing of use follows.
    match words.split_once("expected struct ") {
        Some((before, _)) => format!("{before}expected a dictionary"),
        None => words,
    }
}

/// True if the error says that the model rules the observations out.
pub(crate) fn is_impossible(error: &HmmError) -> bool {
    matches!(error, HmmError::Impossible { .. } | HmmError::ImpossibleMove { .. })
}

fn noted(py: Python<'_>, sequence: usize, error: &HmmError, message: String) -> PyErr {
    let exception =
        if is_impossible(error) { ImpossibleError::new_err(message) } else { invalid(message) };
    placed(py, exception, sequence, error.step())
}

/// Gives the class the attributes `step` and `sequence`, for exceptions that set neither.
pub(crate) fn add_attributes(py: Python<'_>) -> PyResult<()> {
    let class = py.get_type::<Error>();
    class.setattr("step", py.None())?;
    class.setattr("sequence", py.None())
}
