//! Reads a similarity matrix and its ground truth from CSV files.

use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use csv::{ReaderBuilder, StringRecord, Trim};
use thiserror::Error;

use crate::vpr::style::shortened;

/// Why files hold no matrix or no truth. Lines and columns count from 1, as in
/// an editor.
#[derive(Debug, Error)]
pub(crate) enum SimilarityError {
    #[error("cannot read {}: {source}", file.display())]
    File { file: PathBuf, source: csv::Error },
    #[error("{} is not text (line {line} is not UTF-8), expected CSV", file.display())]
    Text { file: PathBuf, line: usize },
    #[error("{} is empty, expected {expected}", file.display())]
    Empty { file: PathBuf, expected: &'static str },
    #[error("{}, line {line}, column {column}: {found:?}, expected {expected}", file.display())]
    Field { file: PathBuf, line: u64, column: usize, found: String, expected: String },
    #[error("{}, line {line}: {found} columns, expected {expected}", file.display())]
    Columns { file: PathBuf, line: u64, found: usize, expected: String },
    #[error("{}, line {line}: first is {first} and last is {last}, expected {expected}", file.display())]
    Places { file: PathBuf, line: u64, first: String, last: String, expected: &'static str },
    #[error("{}, line {line}: query {query} again, it is on line {before}", file.display())]
    Twice { file: PathBuf, line: u64, query: usize, before: u64 },
    #[error("{}: query {query} is missing, expected 0 to {}", file.display(), queries - 1)]
    Missing { file: PathBuf, query: usize, queries: usize },
}

/// The columns of a matrix, and its values row by row.
pub(crate) struct Matrix {
    pub(crate) columns: usize,
    pub(crate) values: Vec<f32>,
}

/// Non-blank lines, with their numbers.
fn records(file: &Path) -> Result<Vec<(u64, StringRecord)>, SimilarityError> {
    let failed = |source| SimilarityError::File { file: file.to_owned(), source };
    let text = fs::read(file).map_err(|error| failed(error.into()))?;
    if let Err(error) = std::str::from_utf8(&text) {
        let line = text[..error.valid_up_to()].split(|byte| *byte == b'\n').count();
        return Err(SimilarityError::Text { file: file.to_owned(), line });
    }
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .from_reader(&text[..]);
    let mut records = Vec::new();
    for record in reader.records() {
        let record = record.map_err(failed)?;
        // The reader counts the blank lines before a record as part of it.
        let line = record.position().map_or(1, |at| {
            let before = text[at.byte() as usize..].iter();
            let blank = before.take_while(|byte| b"\r\n".contains(byte));
            at.line() + blank.filter(|byte| **byte == b'\n').count() as u64
        });
        records.push((line, record));
    }
    Ok(records)
}

/// A number of a matrix; distances may also be infinite.
fn number(text: &str, distances: bool) -> Option<f32> {
    let value = text.parse::<f32>().ok()?;
    // Finite numbers that are too large are infinite, too, once they are read.
    let infinite =
        distances && value == f32::INFINITY && !text.contains(|c: char| c.is_ascii_digit());
    (value.is_finite() || infinite).then_some(value)
}

/// A cell, as errors quote it.
fn quoted(cell: &str) -> String {
    shortened(cell, 40)
}

/// Reads a matrix of numbers without a header.
pub(crate) fn read_matrix(file: &Path, distances: bool) -> Result<Matrix, SimilarityError> {
    let records = records(file)?;
    let Some((first, record)) = records.first() else {
        let expected = "a line for each query image, a column for each reference image";
        return Err(SimilarityError::Empty { file: file.to_owned(), expected });
    };
    let columns = record.len();
    let mut values = Vec::with_capacity(records.len() * columns);
    for (line, record) in &records {
        if record.len() != columns {
            return Err(SimilarityError::Columns {
                file: file.to_owned(),
                line: *line,
                found: record.len(),
                expected: format!("{columns} as in line {first}"),
            });
        }
        for (column, found) in (1..).zip(record) {
            values.push(number(found, distances).ok_or_else(|| SimilarityError::Field {
                file: file.to_owned(),
                line: *line,
                column,
                found: quoted(found),
                expected: format!(
                    "a number within ±3.4e38{}",
                    if distances { " or inf" } else { "" }
                ),
            })?);
        }
    }
    Ok(Matrix { columns, values })
}

/// Reads which references are right for each query: lines of query, first and
/// last, in any order, the latter two empty or -1 where the place is not on
/// the map.
pub(crate) fn read_truth(
    file: &Path,
    queries: usize,
    references: usize,
) -> Result<Vec<Option<RangeInclusive<usize>>>, SimilarityError> {
    let mut records = records(file)?;
    let header = StringRecord::from(vec!["query", "first", "last"]);
    if records.first().is_some_and(|(_, record)| *record == header) {
        records.remove(0);
    }
    if records.is_empty() {
        let expected = "lines of query,first,last";
        return Err(SimilarityError::Empty { file: file.to_owned(), expected });
    }
    let mut truth = vec![None; queries];
    let mut seen: Vec<Option<u64>> = vec![None; queries];
    for (line, record) in records {
        let file = file.to_owned();
        if record.len() != 3 {
            let expected = String::from("3: query, first, last");
            return Err(SimilarityError::Columns { file, line, found: record.len(), expected });
        }
        let field = |column: usize, below: usize, also: &str| {
            let number = record[column].parse::<usize>().ok().filter(|number| *number < below);
            number.ok_or_else(|| SimilarityError::Field {
                file: file.clone(),
                line,
                column: column + 1,
                found: quoted(&record[column]),
                expected: format!("a whole number from 0 to {}{also}", below - 1),
            })
        };
        let query = field(0, queries, "")?;
        if let Some(before) = seen[query].replace(line) {
            return Err(SimilarityError::Twice { file, line, query, before });
        }
        let nowhere = |column: usize| matches!(&record[column], "" | "-1");
        let places = |expected| {
            let (first, last) = (quoted(&record[1]), quoted(&record[2]));
            SimilarityError::Places { file: file.clone(), line, first, last, expected }
        };
        if nowhere(1) != nowhere(2) {
            return Err(places("both or none to be empty or -1"));
        }
        if !nowhere(1) {
            let also = ", or both empty or -1 for a place that is not on the map";
            let (first, last) = (field(1, references, also)?, field(2, references, also)?);
            if first > last {
                return Err(places("the first not to be above the last"));
            }
            truth[query] = Some(first..=last);
        }
    }
    match seen.iter().position(Option::is_none) {
        Some(query) => Err(SimilarityError::Missing { file: file.to_owned(), query, queries }),
        None => Ok(truth),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_file<T>(
        name: &str,
        text: &[u8],
        read: impl Fn(&Path) -> Result<T, SimilarityError>,
    ) -> Result<T, String> {
        let name = format!("wayfix_similarity_{}_{name}.csv", std::process::id());
        let file = std::env::temp_dir().join(name);
        fs::write(&file, text).unwrap();
        let result = read(&file);
        fs::remove_file(&file).unwrap();
        result.map_err(|error| error.to_string().replace(&file.display().to_string(), "FILE"))
    }

    fn matrix(name: &str, text: &str) -> Result<(usize, Vec<f32>), String> {
        let name = format!("matrix_{name}");
        with_file(&name, text.as_bytes(), |file| read_matrix(file, false))
            .map(|m| (m.columns, m.values))
    }

    fn truth(name: &str, text: &str) -> Result<Vec<Option<RangeInclusive<usize>>>, String> {
        with_file(&format!("truth_{name}"), text.as_bytes(), |file| read_truth(file, 3, 10))
    }

    #[test]
    fn matrices() {
        let expected = (3, vec![0.5, -1.0, 20.0, 3.0, 4.0, 5.0]);
        assert_eq!(matrix("plain", "0.5,-1,2e1\n3,4,5\n"), Ok(expected.clone()));
        assert_eq!(matrix("spaces", "\u{feff} 0.5 , -1,2e1\r\n\r\n3,4, 5"), Ok(expected));
    }

    #[test]
    fn matrices_that_are_wrong() {
        let error = |name: &str, text: &str| matrix(name, text).unwrap_err();
        assert_eq!(
            error("word", "1,2\n\n3,four\n"),
            "FILE, line 3, column 2: \"four\", expected a number within ±3.4e38"
        );
        for wrong in ["nan", "inf", "-inf", "1e39", ""] {
            assert_eq!(
                error("value", &format!("1,2,3\n1,{wrong},3\n")),
                format!("FILE, line 2, column 2: {wrong:?}, expected a number within ±3.4e38")
            );
        }
        assert_eq!(
            error("ragged", "1,2\n3,4\n5\n"),
            "FILE, line 3: 1 columns, expected 2 as in line 1"
        );
        let empty = "FILE is empty, expected a line for each query image, a column for each \
                     reference image";
        assert_eq!(error("empty", ""), empty);
        assert_eq!(error("blank", "\n\n"), empty);
        let bytes = with_file("bytes", b"1,2\n\xff,3\n", |file| read_matrix(file, false));
        assert_eq!(bytes.err().unwrap(), "FILE is not text (line 2 is not UTF-8), expected CSV");
        let long = error("long", &"9".repeat(50));
        assert!(long.contains(&format!("\"{}…\"", "9".repeat(39))), "{long}");
        let missing = read_matrix(Path::new("no such file.csv"), false).err().unwrap().to_string();
        assert!(missing.starts_with("cannot read no such file.csv: "), "{missing}");
    }

    #[test]
    fn distances_may_be_infinite() {
        let read = |name, text: &str| {
            with_file(name, text.as_bytes(), |file| read_matrix(file, true)).map(|m| m.values)
        };
        assert_eq!(read("infinite", "1,inf\n").unwrap(), [1.0, f32::INFINITY]);
        for wrong in ["-inf", "1e39", "nan"] {
            assert_eq!(
                read("no_distance", wrong).unwrap_err(),
                format!(
                    "FILE, line 1, column 1: {wrong:?}, expected a number within ±3.4e38 or inf"
                )
            );
        }
    }

    #[test]
    fn truths() {
        let expected = Ok(vec![Some(0..=2), None, Some(9..=9)]);
        assert_eq!(truth("plain", "0,0,2\n1,,\n2,9,9\n"), expected);
        assert_eq!(truth("with_header", "query,first,last\n2,9,9\n1,-1,-1\n0,0,2"), expected);
    }

    #[test]
    fn truths_that_are_wrong() {
        let error = |name: &str, text: &str| truth(name, text).unwrap_err();
        assert_eq!(error("empty", ""), "FILE is empty, expected lines of query,first,last");
        assert_eq!(error("only_header", "query,first,last\n"), error("empty", ""));
        assert_eq!(
            error("header", "image,from,to\n0,0,2\n"),
            "FILE, line 1, column 1: \"image\", expected a whole number from 0 to 2"
        );
        assert_eq!(
            error("columns", "0,0,2\n1,2\n"),
            "FILE, line 2: 2 columns, expected 3: query, first, last"
        );
        assert_eq!(
            error("query", "0,0,2\n3,0,2\n"),
            "FILE, line 2, column 1: \"3\", expected a whole number from 0 to 2"
        );
        assert_eq!(
            error("reference", "0,0,2\n1,0,10\n"),
            "FILE, line 2, column 3: \"10\", expected a whole number from 0 to 9, or both empty or \
             -1 for a place that is not on the map"
        );
        assert!(error("fraction", "0,0.5,2\n").starts_with("FILE, line 1, column 2: \"0.5\""));
        assert_eq!(
            error("order", "0,3,2\n"),
            "FILE, line 1: first is 3 and last is 2, expected the first not to be above the last"
        );
        for half in ["0,,2\n", "0,3,-1\n"] {
            assert!(error("half", half).ends_with("expected both or none to be empty or -1"));
        }
        assert_eq!(
            error("twice", "0,0,2\n1,0,2\n0,0,2\n"),
            "FILE, line 3: query 0 again, it is on line 1"
        );
        assert_eq!(error("missing", "0,0,2\n2,0,2\n"), "FILE: query 1 is missing, expected 0 to 2");
    }
}
