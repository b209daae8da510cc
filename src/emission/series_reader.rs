//! Reader of series of numbers from CSV files.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use csv::{ByteRecord, ErrorKind, ReaderBuilder};

use super::{EmissionError, Series};

/// Most characters of a field that an error message quotes.
const FIELD: usize = 60;
/// Most characters of a header that an error message quotes.
const HEADER: usize = 600;

/// A reader of [`Series`] from CSV files that may write missing values as a text (feature `csv`).
///
/// ```
/// use wayfix::emission::SeriesReader;
///
/// let text = "hour,temperature,wind\n0,NA,3.5\n1,7.25,\n";
/// let reader = SeriesReader::new(&["temperature", "wind"]).with_missing(&["NA", "null"]);
/// let series = reader.read(text.as_bytes())?;
/// assert!(series.values()[0].is_nan() && series.values()[3].is_nan());
/// assert_eq!(series.values()[1..3], [3.5, 7.25]);
/// # Ok::<(), wayfix::emission::EmissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SeriesReader {
    columns: Vec<String>,
    missing: Vec<String>,
}

impl SeriesReader {
    /// Creates a reader of the named columns, in the order of the names, in which only an empty
    /// field is a missing value.
    #[must_use]
    pub fn new(columns: &[&str]) -> Self {
        let columns = columns.iter().map(|name| (*name).to_owned()).collect();
        Self { columns, missing: Vec::new() }
    }

    /// Takes a field with one of these texts as a missing value, like an empty field. Case counts,
    /// spaces around a field do not.
    ///
    /// In a file with a single column this is the way to write a missing value, since empty lines
    /// are skipped; or it is an empty text in quotes.
    #[must_use]
    pub fn with_missing(self, texts: &[&str]) -> Self {
        let missing = texts.iter().map(|text| text.trim().to_owned()).collect();
        Self { missing, ..self }
    }

    /// Reads a file with a header. O(file).
    ///
    /// # Errors
    ///
    /// As [`Series::from_csv_file`].
    pub fn read_file(&self, path: impl AsRef<Path>) -> Result<Series, EmissionError> {
        let file = path.as_ref().display().to_string();
        match File::open(path) {
            Ok(open) => self.rows(&file, open),
            Err(error) => Err(EmissionError::Read { file, reason: error.to_string() }),
        }
    }

    /// Reads from a reader, as [`read_file`](Self::read_file); errors call it "the input".
    ///
    /// # Errors
    ///
    /// As [`Series::from_csv_file`].
    pub fn read(&self, input: impl Read) -> Result<Series, EmissionError> {
        self.rows("the input", input)
    }

    fn rows(&self, file: &str, input: impl Read) -> Result<Series, EmissionError> {
        let at = |line: u64, problem: String| EmissionError::Line {
            file: file.to_owned(),
            line,
            problem,
        };
        let failed = |error: csv::Error| match error.kind() {
            ErrorKind::Io(error) => {
                EmissionError::Read { file: file.to_owned(), reason: error.to_string() }
            }
            _ => at(error.position().map_or(1, csv::Position::line), error.to_string()),
        };
        if self.columns.is_empty() {
            return Err(at(1, "no column is asked for".to_owned()));
        }
        // Each line ends with a line feed, by which the reader counts them.
        let lines = WithoutReturns(input).chain(&b"\n"[..]);
        let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(lines);
        let (mut header, mut record) = (ByteRecord::new(), ByteRecord::new());
        reader.read_byte_record(&mut header).map_err(failed)?;
        if header.is_empty() {
            return Err(at(1, "there is nothing, expected a header".to_owned()));
        }
        let line = line_of(&header, reader.position().line());
        let places = self.places(&header).map_err(|problem| at(line, problem))?;
        let mut values = Vec::new();
        while reader.read_byte_record(&mut record).map_err(failed)? {
            let line = || line_of(&record, reader.position().line());
            if record.len() != header.len() {
                let (found, expected) = (fields(record.len()), header.len());
                return Err(at(line(), format!("has {found}, the header has {expected}")));
            }
            for (&place, name) in places.iter().zip(&self.columns) {
                let value = self.number(&record[place]).ok_or_else(|| {
                    let (found, expected) = (excerpt(&record[place], FIELD), self.expected());
                    at(line(), format!("{name} is {found:?}, expected {expected}"))
                })?;
                values.push(value);
            }
        }
        Ok(Series { values, components: self.columns.len() })
    }

    /// Place of each column in a line.
    fn places(&self, header: &ByteRecord) -> Result<Vec<usize>, String> {
        let place = |name: &String| {
            let is_it = |known: &[u8]| known.trim_ascii() == name.trim().as_bytes();
            let mut found = header.iter().enumerate().filter(|(_, known)| is_it(known));
            let Some((place, _)) = found.next() else {
                let known: Vec<_> = header.iter().map(|known| excerpt(known, FIELD)).collect();
                let known = known.join(", ");
                let known = excerpt(known.as_bytes(), HEADER).into_owned();
                return Err(format!("there is no column {name}, the header is {known:?}"));
            };
            match found.next() {
                Some(_) => Err(format!("there is more than one column {name}")),
                None => Ok(place),
            }
        };
        self.columns.iter().map(place).collect()
    }

    /// A finite number, or NaN if it is missing.
    fn number(&self, field: &[u8]) -> Option<f64> {
        let text = str::from_utf8(field).ok()?.trim();
        if text.is_empty() || self.missing.iter().any(|missing| missing == text) {
            return Some(f64::NAN);
        }
        text.parse().ok().filter(|value: &f64| value.is_finite())
    }

    /// Valid fields, in words.
    fn expected(&self) -> String {
        match &*self.missing {
            [] => "a finite number or nothing".to_owned(),
            [text] => format!("a finite number, nothing or {text:?}"),
            texts => format!("a finite number, nothing or one of {texts:?}"),
        }
    }
}

/// First line of a record after which the reader is at the start of the given line.
fn line_of(record: &ByteRecord, next: u64) -> u64 {
    let breaks = |field: &[u8]| field.split(|byte| *byte == b'\n').count() - 1;
    let breaks: usize = record.iter().map(breaks).sum();
    next.saturating_sub(1 + breaks as u64).max(1)
}

/// "1 field" or "3 fields".
fn fields(count: usize) -> String {
    if count == 1 { "1 field".to_owned() } else { format!("{count} fields") }
}

/// Text of a field, cut to so many characters.
fn excerpt(field: &[u8], most: usize) -> Cow<'_, str> {
    let text = String::from_utf8_lossy(field.trim_ascii());
    match text.char_indices().nth(most) {
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => text,
    }
}

/// A reader without carriage returns, which end lines together with line feeds.
struct WithoutReturns<R>(R);

impl<R: Read> Read for WithoutReturns<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let found = self.0.read(buffer)?;
            let mut kept = 0;
            for at in 0..found {
                if buffer[at] != b'\r' {
                    buffer[kept] = buffer[at];
                    kept += 1;
                }
            }
            if kept > 0 || found == 0 {
                return Ok(kept);
            }
        }
    }
}
