//! Rows of CSV files: a header, then fields by column, with the line of each in errors.

use std::io::{self, Read};
use std::str::FromStr;

use csv::{ByteRecord, Position, Reader, ReaderBuilder, StringRecord};

use super::{FileError, excerpt};

/// Treatment of bytes that are not UTF-8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Text {
    /// An error.
    Strict,
    /// Replaced, for files with columns that are not read.
    Lossy,
}

/// A row, and where its columns are. Spaces around fields are ignored.
#[derive(Debug)]
pub struct Row<'a> {
    /// First line of the row in the file, from 1.
    pub line: u64,
    /// Number of fields in the header.
    pub width: usize,
    record: &'a StringRecord,
    /// Place of each column in the row, if the file has it.
    columns: &'a [Option<usize>],
    /// Name of each column in errors.
    names: &'a [&'a str],
}

impl Row<'_> {
    /// Number of fields.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "a row has at least one field")]
    pub fn len(&self) -> usize {
        self.record.len()
    }

    /// Checks that there are as many fields as in the header, in the words of the `csv` crate.
    pub fn check_width(&self) -> Result<(), String> {
        let Self { line, width, .. } = *self;
        let (found, [record, byte]) = (self.len(), place_of(self.record.position()));
        if found == width {
            return Ok(());
        }
        Err(format!(
            "CSV error: record {record} (line: {line}, byte: {byte}): found record with {found} fields, but the previous record has {width} fields"
        ))
    }

    /// True if the file has a column.
    #[must_use]
    pub fn has(&self, column: usize) -> bool {
        self.columns[column].is_some()
    }

    /// Text of a column, empty if the file does not have it.
    #[must_use]
    pub fn text(&self, column: usize) -> &str {
        self.columns[column].and_then(|place| self.record.get(place)).unwrap_or_default().trim()
    }

    pub fn id(&self, column: usize) -> Result<u64, String> {
        self.parse(column, "a whole number from 0")
    }

    pub fn number(&self, column: usize) -> Result<f64, String> {
        self.parse(column, "a number")
    }

    fn parse<T: FromStr>(&self, column: usize, expected: &str) -> Result<T, String> {
        self.text(column).parse().map_err(|_| self.unexpected(column, expected))
    }

    /// Describes an unexpected field.
    #[must_use]
    pub fn unexpected(&self, column: usize, expected: &str) -> String {
        let found = excerpt(self.text(column));
        format!("{} is {found:?}, expected {expected}", self.names[column])
    }
}

/// Reads the rows of a file. `find` gets the header, which is empty for an empty file, and returns
/// the place of each column; `take` gets each row after it that is not empty. Problems that they
/// report are returned with file and line. Returns the number of the line after the last row.
pub fn each_row<C: AsRef<[Option<usize>]>>(
    (file, reader): (&str, impl Read),
    text: Text,
    names: &[&str],
    find: impl FnOnce(&StringRecord) -> Result<C, String>,
    mut take: impl FnMut(Row<'_>) -> Result<(), String>,
) -> Result<u64, FileError> {
    let at = |line, problem| FileError { file: file.to_owned(), line: Some(line), problem };
    let tail = Tail { reader, last: Vec::new(), end: 0 };
    // Flexible: rows of a wrong width reach `take`, which can report them by their line.
    let reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(tail);
    let mut rows = Rows { reader, line: 1, end: 0 };
    // Each record reuses the memory of the previous one.
    let mut read = |record: StringRecord| match rows.read(record.into_byte_record()) {
        Ok((more, bytes)) => {
            let record = text_of(bytes, text, rows.line).map_err(|text| at(rows.line, text))?;
            Ok((record, if more { rows.line } else { rows.end + 1 }, more))
        }
        Err(error) => Err(FileError::read(file.to_owned(), &error.into())),
    };
    let (mut record, line, _) = read(StringRecord::new())?;
    record.trim();
    let width = record.len();
    let columns = find(&record).map_err(|problem| at(line, problem))?;
    loop {
        let (next, line, more) = read(record)?;
        if !more {
            return Ok(line);
        }
        record = next;
        let row = Row { line, width, record: &record, columns: columns.as_ref(), names };
        take(row).map_err(|problem| at(line, problem))?;
    }
}

/// Names in a header that belong to none of the columns read.
pub fn unknown(header: &StringRecord, columns: &[Option<usize>]) -> impl Iterator<Item = String> {
    let unknown = header.iter().enumerate().filter(|(place, _)| !columns.contains(&Some(*place)));
    unknown.map(|(_, name)| excerpt(name).into_owned())
}

/// Rows of a file with their lines.
///
/// Lines are counted back from the end of a row, where the count of the `csv` crate is right. At
/// its start, the crate has counted neither the empty lines before it nor the line feed after a
/// carriage return that ended the previous row.
struct Rows<R> {
    reader: Reader<Tail<R>>,
    /// First line of the last row.
    line: u64,
    /// Its last line.
    end: u64,
}

impl<R: Read> Rows<R> {
    /// Reads a row into the memory of another. Returns false after the last row.
    #[expect(clippy::naive_bytecount, reason = "rows are short")]
    fn read(&mut self, mut record: ByteRecord) -> Result<(bool, ByteRecord), csv::Error> {
        let more = self.reader.read_byte_record(&mut record)?;
        if more {
            let end = self.reader.position();
            // After a line feed the crate already counts the next line; at the end of a file
            // without one it does not.
            let ended = self.reader.get_ref().byte_before(end.byte()) == Some(b'\n');
            // Line feeds within quoted fields.
            let breaks = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
            let last = end.line() - u64::from(ended);
            // At least one after the last row: a carriage return alone also ends a line, and an
            // open quote ends with the file.
            self.line = last.saturating_sub(breaks).max(self.end + 1);
            self.end = last.max(self.line);
        }
        Ok((more, record))
    }
}

/// Text of a row, or the problem in the words of the `csv` crate but with the right line.
fn text_of(bytes: ByteRecord, text: Text, line: u64) -> Result<StringRecord, String> {
    if text == Text::Lossy {
        return Ok(StringRecord::from_byte_record_lossy(bytes));
    }
    StringRecord::from_byte_record(bytes).map_err(|error| {
        let (field, valid) = (error.utf8_error().field(), error.utf8_error().valid_up_to());
        let bytes = error.into_byte_record();
        let [record, byte] = place_of(bytes.position());
        // The crate counts from the start of the trimmed field.
        let spaces = bytes[field].len() - bytes[field].trim_ascii_start().len();
        format!(
            "CSV parse error: record {record} (line {line}, field: {field}, byte: {byte}): invalid utf-8: invalid UTF-8 in field {field} near byte index {}",
            valid - spaces
        )
    })
}

/// Number and first byte of a record, as counted by the `csv` crate.
fn place_of(position: Option<&Position>) -> [u64; 2] {
    position.map_or([0; 2], |at| [at.record(), at.byte()])
}

/// A reader that keeps a copy of what it read last.
struct Tail<R> {
    reader: R,
    last: Vec<u8>,
    /// Number of bytes read.
    end: u64,
}

impl<R> Tail<R> {
    /// Byte before a place in the file, if it is in what was read last. The byte at the end of a
    /// record is, since more is read only for the next record.
    fn byte_before(&self, place: u64) -> Option<u8> {
        // Bytes between the place and the end of what was read.
        let after = usize::try_from(self.end - place).ok()?;
        self.last.len().checked_sub(after + 1).map(|at| self.last[at])
    }
}

impl<R: Read> Read for Tail<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.reader.read(buffer)?;
        if count > 0 {
            self.last.clear();
            self.last.extend_from_slice(&buffer[..count]);
            self.end += count as u64;
        }
        Ok(count)
    }
}
