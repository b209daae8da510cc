//! Similarity matrices and ground truth from CSV files. Errors count lines and columns from 1, as
//! editors do.

use std::fs;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::vpr::counted;
use crate::vpr::recording::Recording;
use crate::vpr::style::shortened;

#[path = "truth.rs"]
mod truth;

/// Values of a matrix row by row, with its number of columns.
struct Matrix {
    columns: usize,
    values: Vec<f32>,
    /// Values of the first line, if they count up from 0 or 1.
    counts: Option<u64>,
}

/// Reads similarities, or distances, of queries to references, and the right references.
pub(crate) fn read(similarity: &Path, truth: &Path, distances: bool) -> Result<Recording, String> {
    let read = |file: &Path| {
        let name = file.display().to_string();
        let text = fs::read(file).map_err(|error| format!("cannot read {name}: {error}"))?;
        Ok::<_, String>((name, text))
    };
    let (of, text) = read(similarity)?;
    let mut matrix = matrix(&of, &text, distances)?;
    let (name, text) = read(truth)?;
    let truth = truth::truth(&name, &text, &of, &matrix)?;
    if !distances {
        matrix.values.iter_mut().for_each(|value| *value = -*value);
    }
    Ok(Recording {
        name: crate::vpr::file_name(similarity),
        references: matrix.columns,
        distances: matrix.values,
        truth,
        ..Recording::default()
    })
}

/// Lines of a file that are not blank, with their numbers; at least one.
struct Lines {
    name: String,
    records: Vec<(u64, StringRecord)>,
}

impl Lines {
    fn new(name: &str, text: &[u8], expected: &str) -> Result<Self, String> {
        if let Err(error) = std::str::from_utf8(text) {
            let line = text[..error.valid_up_to()].split(|byte| *byte == b'\n').count();
            return Err(format!("{name} is not text (line {line} is not UTF-8), expected CSV"));
        }
        let mut reader = ReaderBuilder::new();
        let reader = reader.has_headers(false).flexible(true).trim(Trim::All);
        let mut records = Vec::new();
        for record in reader.from_reader(text).records() {
            let record = record.map_err(|error| format!("cannot read {name}: {error}"))?;
            // The reader counts the blank lines before a record as part of it.
            let line = record.position().map_or(1, |at| {
                let before = text[at.byte() as usize..].iter();
                let blank = before.take_while(|byte| b"\r\n".contains(byte));
                at.line() + blank.filter(|byte| **byte == b'\n').count() as u64
            });
            records.push((line, record));
        }
        if records.is_empty() {
            return Err(format!("{name} is empty, expected {expected}"));
        }
        Ok(Self { name: name.to_owned(), records })
    }

    /// Error message for a line, which names its separator if that is not a comma.
    fn wrong(&self, (line, record): &(u64, StringRecord), what: &str) -> String {
        let has = |found: char| record.iter().any(|cell| cell.contains(found));
        let words = record.iter().flat_map(str::split_whitespace).count();
        let found = match () {
            () if has(';') => "semicolons",
            () if has('\t') => "tabs",
            () if record.len() == 1 && words > 1 => "spaces",
            () => return format!("{}, line {line}{what}", self.name),
        };
        format!("{}, line {line} is separated by {found}, expected commas", self.name)
    }
}

/// Parses a number of a matrix; distances may also be infinite.
fn number(text: &str, distances: bool) -> Option<f32> {
    let value = text.parse::<f32>().ok()?;
    // Finite numbers that are too large also parse as infinite.
    let infinite =
        distances && value == f32::INFINITY && !text.contains(|c: char| c.is_ascii_digit());
    (value.is_finite() || infinite).then_some(value)
}

/// Quotes a cell for an error message.
fn quoted(cell: &str) -> String {
    format!("{:?}", shortened(cell, 40))
}

/// True if the cells are 0, 1, 2, … or 1, 2, 3, …
fn counts<'a>(mut cells: impl Iterator<Item = &'a str>) -> bool {
    let first = cells.next().and_then(|cell| cell.parse::<f64>().ok());
    let Some(first) = first.filter(|first| *first == 0.0 || *first == 1.0) else { return false };
    let mut rest = (1..).zip(cells).peekable();
    rest.peek().is_some() && rest.all(|(n, cell)| cell.parse() == Ok(first + f64::from(n)))
}

/// Parses a matrix of numbers without a header.
fn matrix(name: &str, text: &[u8], distances: bool) -> Result<Matrix, String> {
    let lines =
        Lines::new(name, text, "a line for each query image, a column for each reference image")?;
    let first = &lines.records[0];
    let columns = first.1.len();
    let named = first.1.iter().all(|cell| cell.parse::<f32>().is_err());
    // Many programs write a table with row and column numbers.
    let numbered = first.1[0].parse::<f32>().is_err() && counts(first.1.iter().skip(1));
    if lines.records.len() > 1 && (named || numbered) {
        let too = if numbered { ", and the first column, if it numbers the lines" } else { "" };
        let what = format!(" looks like a header line, expected numbers alone: delete it{too}");
        return Err(lines.wrong(first, &what));
    }
    let mut values = Vec::with_capacity(lines.records.len() * columns);
    for line in &lines.records {
        for (column, cell) in (1..).zip(&line.1) {
            values.push(number(cell, distances).ok_or_else(|| {
                let also = if distances { " or inf" } else { "" };
                let found = quoted(cell);
                let expected = format!("expected a number within ±3.4e38{also}");
                lines.wrong(line, &format!(", column {column}: {found}, {expected}"))
            })?);
        }
        if line.1.len() != columns {
            let found = counted(line.1.len(), "column");
            let what = format!(": {found}, expected {columns} as in line {}", first.0);
            return Err(lines.wrong(line, &what));
        }
    }
    Ok(Matrix { columns, values, counts: counts(first.1.iter()).then_some(first.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<(usize, Vec<f32>), String> {
        matrix("FILE", text.as_bytes(), false).map(|m| (m.columns, m.values))
    }

    #[test]
    fn matrices() {
        let expected = (3, vec![0.5, -1.0, 20.0, 3.0, 4.0, 5.0]);
        assert_eq!(parsed("0.5,-1,2e1\n3,4,5\n"), Ok(expected.clone()));
        assert_eq!(parsed("\u{feff} 0.5 , -1,2e1\r\n\r\n3,4, 5"), Ok(expected));
    }

    #[test]
    fn matrices_that_are_wrong() {
        let error = |text: &str| parsed(text).unwrap_err();
        assert_eq!(
            error("1,2\n\n3,four\n"),
            "FILE, line 3, column 2: \"four\", expected a number within ±3.4e38"
        );
        for wrong in ["nan", "inf", "-inf", "1e39", ""] {
            assert_eq!(
                error(&format!("1,2,3\n1,{wrong},3\n")),
                format!("FILE, line 2, column 2: {wrong:?}, expected a number within ±3.4e38")
            );
        }
        assert_eq!(error("1,2\n3,4\n5\n"), "FILE, line 3: 1 column, expected 2 as in line 1");
        let empty = "FILE is empty, expected a line for each query image, a column for each \
                     reference image";
        assert_eq!(error(""), empty);
        assert_eq!(error("\n\n"), empty);
        let bytes = matrix("FILE", b"1,2\n\xff,3\n", false);
        assert_eq!(bytes.err().unwrap(), "FILE is not text (line 2 is not UTF-8), expected CSV");
        let long = error(&"9".repeat(50));
        assert!(long.contains(&format!("\"{}…\"", "9".repeat(39))), "{long}");
        let missing = read(Path::new("no such file.csv"), Path::new("any"), false).unwrap_err();
        assert!(missing.starts_with("cannot read no such file.csv: "), "{missing}");
    }

    #[test]
    fn distances_may_be_infinite() {
        let read = |text: &str| matrix("FILE", text.as_bytes(), true).map(|m| m.values);
        assert_eq!(read("1,inf\n").unwrap(), [1.0, f32::INFINITY]);
        for wrong in ["-inf", "1e39", "nan"] {
            assert_eq!(
                read(wrong).unwrap_err(),
                format!(
                    "FILE, line 1, column 1: {wrong:?}, expected a number within ±3.4e38 or inf"
                )
            );
        }
    }

    #[test]
    fn other_separators_are_named() {
        let error = |text: &str, found: &str| {
            let expected = format!("FILE, line 1 is separated by {found}, expected commas");
            assert_eq!(parsed(text).unwrap_err(), expected);
        };
        error("0.1;0.2\n0.3;0.4\n", "semicolons");
        error("0,1;0,2\n0,3;0,4\n", "semicolons");
        error("a;b\n0.3;0.4\n", "semicolons");
        error("0.1\t0.2\n0.3\t0.4\n", "tabs");
        error("0.1 0.2\n0.3 0.4\n", "spaces");
        assert!(parsed("1,2\n3;4\n").unwrap_err().contains("line 2 is separated by semi"));
    }

    #[test]
    fn headers_and_transposed_files_are_named() {
        let header = "FILE, line 1 looks like a header line, expected numbers alone: delete it";
        assert_eq!(parsed("a,b\n1,2\n").unwrap_err(), header);
        let numbered = format!("{header}, and the first column, if it numbers the lines");
        assert_eq!(parsed(",0,1,2\n0,5,6,7\n").unwrap_err(), numbered);
        assert_eq!(parsed("image,1,2\n0,5,6\n").unwrap_err(), numbered);

        let counts = |text| matrix("FILE", text, false).unwrap().counts;
        assert_eq!((counts(b"0,1,2\n4,5,6\n"), counts(b"1,2\n4,5\n")), (Some(1), Some(1)));
        assert_eq!((counts(b"0,1,3\n4,5,6\n"), counts(b"1\n4\n")), (None, None));
    }
}
