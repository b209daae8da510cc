//! Series of numbers from CSV files.

use std::io::Read;
use std::path::Path;

use super::{EmissionError, Rows, SeriesReader};

/// Numbers from some columns of a CSV file, a row for each observation (feature `csv`). A
/// [`SeriesReader`] reads files that write missing values as a text, such as `NA`.
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
/// let expected = "the input, line 2: a is \"x\", expected a finite number or nothing";
/// assert_eq!(error.to_string(), expected);
/// # Ok::<(), wayfix::emission::EmissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    pub(super) values: Vec<f64>,
    pub(super) components: usize,
}

impl Series {
    /// Reads the named columns of a CSV file with a header, in the order of the names. An empty
    /// field is a missing component, NaN, which a family takes if it was told so. Empty lines are
    /// skipped. O(file).
    ///
    /// # Errors
    ///
    /// [`EmissionError`] with the line if a column is missing or there twice, a field is not a finite
    /// number, or a line has another number of fields than the header; or if the file cannot be
    /// read.
    pub fn from_csv_file(path: impl AsRef<Path>, columns: &[&str]) -> Result<Self, EmissionError> {
        SeriesReader::new(columns).read_file(path)
    }

    /// Reads from a reader, as [`from_csv_file`](Self::from_csv_file); errors call it "the input".
    ///
    /// # Errors
    ///
    /// As [`from_csv_file`](Self::from_csv_file).
    pub fn from_csv(input: impl Read, columns: &[&str]) -> Result<Self, EmissionError> {
        SeriesReader::new(columns).read(input)
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
