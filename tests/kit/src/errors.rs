//! Texts of errors.

use std::error::Error;

/// The text of an error, and of its sources.
pub fn with_causes(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {error}");
        cause = error.source();
    }
    text
}

/// The text of the error of a result, with its sources.
#[track_caller]
pub fn text<T>(result: Result<T, impl Error + 'static>) -> String {
    with_causes(&result.err().expect("an error"))
}

/// Asserts that a result is an error with this text, including its sources.
#[track_caller]
pub fn says<T>(result: Result<T, impl Error + 'static>, expected: &str) {
    assert_eq!(text(result), expected);
}
