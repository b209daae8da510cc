//! Files as input: how they are opened, and how errors name what is wrong with them.

#[cfg(feature = "csv")]
mod rows;

#[cfg(feature = "csv")]
pub use rows::{Row, Text, each_row, unknown};

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A file that cannot be read, or a line of it that is not valid. Modules make their own errors of
/// it.
#[derive(Debug)]
pub enum FileError {
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
pub fn open(path: &Path) -> Result<(String, File), FileError> {
    let file = path.display().to_string();
    match File::open(path) {
        Ok(reader) => Ok((file, reader)),
        Err(error) => Err(FileError::Read { file, reason: error.to_string() }),
    }
}

/// Reads all of a file that must be UTF-8, without the mark of its encoding.
pub fn text_of(file: &str, mut reader: impl Read) -> Result<String, FileError> {
    let mut text = String::new();
    if let Err(error) = reader.read_to_string(&mut text) {
        return Err(FileError::Read { file: file.to_owned(), reason: error.to_string() });
    }
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    Ok(text)
}

/// Most characters of a field that an error message quotes.
const LONGEST: usize = 60;

/// Returns a field, cut to the length that error messages quote.
pub fn excerpt(field: &str) -> Cow<'_, str> {
    shortened(field, LONGEST)
}

/// Returns a text, cut to so many characters.
pub fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => Cow::Borrowed(text),
    }
}
