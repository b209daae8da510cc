//! Input files: opening them, reading their text, and quoting it in errors.

#[cfg(feature = "csv")]
mod rows;

#[cfg(feature = "csv")]
pub use rows::{Row, Text, each_row, unknown};

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A file that cannot be read, or an invalid line of it. Modules convert it to errors of their own.
#[derive(Debug)]
pub struct FileError {
    pub file: String,
    /// The invalid line, from 1, or `None` if the file cannot be read.
    pub line: Option<u64>,
    pub problem: String,
}

impl FileError {
    fn read(file: String, error: &std::io::Error) -> Self {
        Self { file, line: None, problem: error.to_string() }
    }
}

/// Opens a file. Returns it with its name for messages.
pub fn open(path: &Path) -> Result<(String, File), FileError> {
    let file = path.display().to_string();
    match File::open(path) {
        Ok(reader) => Ok((file, reader)),
        Err(error) => Err(FileError::read(file, &error)),
    }
}

/// Reads a whole file, which must be UTF-8, and drops its byte order mark.
pub fn text_of(file: &str, mut reader: impl Read) -> Result<String, FileError> {
    let mut text = String::new();
    if let Err(error) = reader.read_to_string(&mut text) {
        return Err(FileError::read(file.to_owned(), &error));
    }
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    Ok(text)
}

/// Largest number of characters of a field that an error message quotes.
const LONGEST: usize = 60;

/// Returns a field, shortened to the length that error messages quote.
#[must_use]
pub fn excerpt(field: &str) -> Cow<'_, str> {
    shortened(field, LONGEST)
}

/// Returns a text, shortened to at most `most` characters and an ellipsis.
#[must_use]
pub fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        // Indices of characters, so the cut is on a boundary.
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => Cow::Borrowed(text),
    }
}
