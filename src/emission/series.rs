//! Series of numbers from CSV files.

use std::error::Error;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use csv::{ErrorKind, ReaderBuilder, StringRecord, Trim};

use super::Rows;

/// Numbers from some columns of a CSV file, a row for each observation (feature `csv`).
///
/// ```
/// use wayfix::emission::Series;
///
/// let text = "day,return,volume\n1,0.5,10\n2,,12\n";
/// let series = Series::from_csv(text.as_bytes(), &["return", "volume"])?;
/// let rows: Vec<&[f64]> = series.rows().iter().collect();
/// assert_eq!(rows[0], [0.5, 10.0]);
/// assert!(rows[1][0].is_nan()); // missing
///
/// let error = Series::from_csv("a\nx\n".as_bytes(), &["a"]).unwrap_err();
/// assert_eq!(error.to_string(), "the input, line 2: a is \"x\", expected a number, or nothing");
/// # Ok::<(), wayfix::emission::SeriesError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    values: Vec<f64>,
    components: usize,
}

/// A file that is no series.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SeriesError {
    /// A file cannot be opened or read.
    Read {
        /// Name of the file.
        file: String,
        /// Cause, in words.
        reason: String,
    },
    /// A line is not valid.
    Line {
        /// Name of the file.
        file: String,
        /// The line, from 1.
        line: u64,
        /// Defect, in words.
        problem: String,
    },
}

impl fmt::Display for SeriesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { file, reason } => write!(f, "{file} cannot be read: {reason}"),
            Self::Line { file, line, problem } => write!(f, "{file}, line {line}: {problem}"),
        }
    }
}

impl Error for SeriesError {}

impl Series {
    /// Reads the named columns of a CSV file with a header, in the order of the names. An empty
    /// field is a missing component, NaN, which a family takes if it was told so. O(file).
    ///
    /// # Errors
    ///
    /// [`SeriesError`] with the line if a column is missing, a field is not a number, or a line
    /// has another number of fields; or if the file cannot be read.
    pub fn from_csv_file(path: impl AsRef<Path>, columns: &[&str]) -> Result<Self, SeriesError> {
        let name = path.as_ref().display().to_string();
        let open = File::open(path.as_ref());
        let file = open
            .map_err(|error| SeriesError::Read { file: name.clone(), reason: error.to_string() })?;
        read(&name, file, columns)
    }

    /// Reads from a reader, as [`from_csv_file`](Self::from_csv_file); errors call it "the input".
    ///
    /// # Errors
    ///
    /// As [`from_csv_file`](Self::from_csv_file).
    pub fn from_csv(input: impl Read, columns: &[&str]) -> Result<Self, SeriesError> {
        read("the input", input, columns)
    }

    /// The numbers as a sequence.
    #[must_use]
    pub fn rows(&self) -> Rows<'_> {
        Rows::known(&self.values, self.components)
    }

    /// The numbers, row after row.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

fn read(file: &str, input: impl Read, columns: &[&str]) -> Result<Series, SeriesError> {
    let at =
        |line: u64, problem: String| SeriesError::Line { file: file.to_owned(), line, problem };
    let failed = |line: u64, error: &csv::Error| match error.kind() {
        ErrorKind::Io(error) => {
            SeriesError::Read { file: file.to_owned(), reason: error.to_string() }
        }
        _ => at(error.position().map_or(line, csv::Position::line), error.to_string()),
    };
    if columns.is_empty() {
        return Err(at(1, "no column is asked for".to_owned()));
    }
    let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(input);
    let header = reader.headers().map_err(|error| failed(1, &error))?.clone();
    let place = |name: &&str| {
        let found = header.iter().position(|known| known == *name);
        found.ok_or_else(|| at(1, format!("there is no column {name}")))
    };
    let places = columns.iter().map(place).collect::<Result<Vec<usize>, _>>()?;
    let (mut values, mut record) = (Vec::new(), StringRecord::new());
    while reader.read_record(&mut record).map_err(|error| failed(0, &error))? {
        let line = record.position().map_or(0, csv::Position::line);
        for (&place, name) in places.iter().zip(columns) {
            let text = record.get(place).unwrap_or_default();
            let number = if text.is_empty() { Ok(f64::NAN) } else { text.parse::<f64>() };
            values.push(number.map_err(|_| {
                at(line, format!("{name} is {text:?}, expected a number, or nothing"))
            })?);
        }
    }
    Ok(Series { values, components: columns.len() })
}
