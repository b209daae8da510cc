//! Series of numbers from CSV files.

use std::io::Read;
use std::path::Path;

use csv::StringRecord;

use super::{EmissionError, Rows};
use wayfix::internal::{FileError, Text, each_row, excerpt, open, shortened};

/// Longest part of a header that an error message quotes, in characters.
const HEADER: usize = 600;

/// Numbers from named columns of a CSV file, one row for each observation (feature `csv`).
///
/// ```
/// use wayfix_learn::Series;
///
/// let text = "day,return,volume\n1,0.5,10\n2,NA,12\n";
/// let series = Series::from_csv(text.as_bytes(), &["return", "volume"], &["NA"])?;
/// let rows: Vec<&[f64]> = series.rows().iter().collect();
/// assert_eq!(rows[0], [0.5, 10.0]);
/// assert!(rows[1][0].is_nan()); // missing
///
/// let error = Series::from_csv("a\nx\n".as_bytes(), &["a"], &[]).unwrap_err();
/// let expected = "the input, line 2: a is \"x\", expected a finite number or nothing";
/// assert_eq!(error.to_string(), expected);
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    values: Vec<f64>,
    components: usize,
}

impl Series {
    /// Reads the named columns of a CSV file with a header, in the order of the names. A field that
    /// is empty or one of the `missing` texts, such as `NA`, is a missing component, NaN, which
    /// families accept if they allow missing components. Case matters, spaces around fields do not.
    /// Empty lines are skipped, so in a file with a single column write a missing value as such a
    /// text, or as an empty field in quotes. O(file).
    ///
    /// # Errors
    ///
    /// [`EmissionError`] with the line if a column is missing or occurs twice, a field is not a
    /// finite number, or a line does not have as many fields as the header; or if the file cannot
    /// be read.
    pub fn from_csv_file(
        path: impl AsRef<Path>,
        columns: &[&str],
        missing: &[&str],
    ) -> Result<Self, EmissionError> {
        let (file, reader) = open(path.as_ref())?;
        Self::read(&file, reader, columns, missing)
    }

    /// Reads from a reader, like [`from_csv_file`](Self::from_csv_file); errors call it "the
    /// input".
    ///
    /// # Errors
    ///
    /// As for [`from_csv_file`](Self::from_csv_file).
    pub fn from_csv(
        input: impl Read,
        columns: &[&str],
        missing: &[&str],
    ) -> Result<Self, EmissionError> {
        Self::read("the input", input, columns, missing)
    }

    fn read(
        file: &str,
        input: impl Read,
        columns: &[&str],
        missing: &[&str],
    ) -> Result<Self, EmissionError> {
        if columns.is_empty() {
            let (file, problem) = (file.to_owned(), "no columns were asked for".to_owned());
            return Err(EmissionError::Line { file, line: 1, problem });
        }
        let missing: Vec<&str> = missing.iter().map(|text| text.trim()).collect();
        let expected = match &missing[..] {
            [] => "a finite number or nothing".to_owned(),
            [text] => format!("a finite number, nothing or {text:?}"),
            texts => format!("a finite number, nothing or one of {texts:?}"),
        };
        let number = |text: &str| {
            if text.is_empty() || missing.contains(&text) {
                return Some(f64::NAN);
            }
            // "NaN" and "inf" parse as numbers, but a missing value must be declared.
            text.parse().ok().filter(|value: &f64| value.is_finite())
        };
        let mut values = Vec::new();
        let find = |header: &StringRecord| places(header, columns);
        each_row((file, input), Text::Lossy, columns, find, |row| {
            if row.len() != row.width {
                let ending = if row.len() == 1 { "" } else { "s" };
                let (found, expected) = (row.len(), row.width);
                return Err(format!("has {found} field{ending}, the header has {expected}"));
            }
            for column in 0..columns.len() {
                let value = number(row.text(column));
                values.push(value.ok_or_else(|| row.unexpected(column, &expected))?);
            }
            Ok(())
        })?;
        Ok(Self { values, components: columns.len() })
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

/// Position of each column in a line, found by its name in the header.
fn places(header: &StringRecord, columns: &[&str]) -> Result<Vec<Option<usize>>, String> {
    if header.is_empty() {
        return Err("the header is missing".to_owned());
    }
    let place = |name: &&str| {
        let mut found = header.iter().enumerate().filter(|(_, known)| *known == name.trim());
        match (found.next(), found.next()) {
            (Some((place, _)), None) => Ok(Some(place)),
            (Some(_), Some(_)) => Err(format!("there is more than one column {name}")),
            (None, _) => {
                let known = header.iter().map(excerpt).collect::<Vec<_>>().join(", ");
                let known = shortened(&known, HEADER);
                Err(format!("there is no column {name}, the header is {known:?}"))
            }
        }
    };
    columns.iter().map(place).collect()
}

impl From<FileError> for EmissionError {
    fn from(FileError { file, line, problem }: FileError) -> Self {
        match line {
            None => Self::Read { file, reason: problem },
            Some(line) => Self::Line { file, line, problem },
        }
    }
}
