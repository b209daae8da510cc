//! Files as input: how they are opened, and how errors name what is wrong with them.

#[cfg(feature = "csv")]
mod rows;

#[cfg(all(feature = "csv", feature = "places"))]
pub(crate) use rows::{Row, unknown};
#[cfg(feature = "csv")]
pub(crate) use rows::{Text, each_row};

use std::borrow::Cow;
use std::fs::File;
use std::path::Path;

/// A file that cannot be read, or a line of it that is not valid. Modules make their own errors of
/// it.
#[derive(Debug)]
pub(crate) enum FileError {
    Read {
        file: String,
        reason: String,
    },
    #[cfg(feature = "csv")]
    Line {
        file: String,
        line: u64,
        problem: String,
    },
}

/// Opens a file. Returns its name for messages, too.
pub(crate) fn open(path: &Path) -> Result<(String, File), FileError> {
    let file = path.display().to_string();
    match File::open(path) {
        Ok(reader) => Ok((file, reader)),
        Err(error) => Err(FileError::Read { file, reason: error.to_string() }),
    }
}

/// Most characters of a field that an error message quotes.
const LONGEST: usize = 60;

/// Returns a field, cut to the length that error messages quote.
pub(crate) fn excerpt(field: &str) -> Cow<'_, str> {
    shortened(field, LONGEST)
}

/// Returns a text, cut to so many characters.
pub(crate) fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => Cow::Borrowed(text),
    }
}
