//! Fields of CSV files.

use std::str::FromStr;

use csv::{ErrorKind, StringRecord};

use super::MapError;
use super::excerpt::excerpt;

/// A line of a file, and where its columns are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line<'a> {
    pub(crate) record: &'a StringRecord,
    /// Place of each column in the line, if the file has it.
    pub(crate) places: &'a [Option<usize>],
    /// Name of each column.
    pub(crate) names: &'a [&'static str],
}

impl Line<'_> {
    /// Text of a column, empty if the file does not have it.
    pub(crate) fn text(&self, column: usize) -> &str {
        self.places[column].and_then(|place| self.record.get(place)).unwrap_or_default()
    }

    pub(crate) fn id(&self, column: usize) -> Result<u64, String> {
        self.parse(column, "a whole number from 0")
    }

    pub(crate) fn number(&self, column: usize) -> Result<f64, String> {
        self.parse(column, "a number")
    }

    fn parse<T: FromStr>(&self, column: usize, expected: &str) -> Result<T, String> {
        let (name, found) = (self.names[column], self.text(column));
        found.parse().map_err(|_| format!("{name} is {:?}, expected {expected}", excerpt(found)))
    }
}

/// Error of a CSV reader, at its line or else at the given one, or of what it reads from.
pub(crate) fn csv_error(file: &str, line: u64, error: &csv::Error) -> MapError {
    let file = file.to_owned();
    if let ErrorKind::Io(error) = error.kind() {
        return MapError::Read { file, reason: error.to_string() };
    }
    let line = error.position().map_or(line, csv::Position::line);
    MapError::Line { file, line, problem: error.to_string() }
}
