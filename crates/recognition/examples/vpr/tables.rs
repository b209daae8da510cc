//! Matrices and ground truth from files. Errors count lines and columns from 1, as editors do.

use std::path::Path;

use npyz::NpyFile;

use crate::vpr::Array;
use crate::vpr::recording::Label;

/// Reads a matrix from a `.npy` or CSV file: its number of columns, and the values row by row.
/// Infinite values may be allowed.
pub(crate) fn matrix(file: &Path, infinite: bool) -> Result<(usize, Vec<f32>), String> {
    let name = file.display();
    let values = match Array::open(file, "(rows, columns)")? {
        Some(Array { shape: [_, columns], npy }) => numbers(npy).map(|values| (columns, values)),
        None => csv(&read(file)?),
    };
    let (columns, values) = values.map_err(|error| format!("{name}: {error}"))?;
    let valid = |x: f32| x.is_finite() || (infinite && x == f32::INFINITY);
    let Some(at) = values.iter().position(|x| !valid(*x)) else { return Ok((columns, values)) };
    let (line, column, found) = (at / columns + 1, at % columns + 1, values[at]);
    let also = if infinite { " or inf" } else { "" };
    Err(format!("{name}, line {line}, column {column}: {found}, expected a finite number{also}"))
}

fn numbers<R: std::io::Read>(npy: NpyFile<R>) -> Result<Vec<f32>, String> {
    let found = npy.dtype().descr();
    let all: Result<_, _> = match npy.try_data::<f32>().map_err(NpyFile::try_data::<f64>) {
        Ok(data) => data.collect(),
        Err(Ok(data)) => data.map(|value| value.map(|x| x as f32)).collect(),
        Err(Err(npy)) => match npy.data::<u8>() {
            Ok(data) => data.map(|value| value.map(f32::from)).collect(),
            Err(_) => return Err(format!("{found}, expected float32, float64 or uint8")),
        },
    };
    all.map_err(|error| error.to_string())
}

fn read(file: &Path) -> Result<String, String> {
    let text = std::fs::read_to_string(file);
    text.map_err(|error| format!("cannot read {}: {error}", file.display()))
}

/// Cells of the lines that are not blank, with the numbers of the lines.
fn lines(text: &str) -> impl Iterator<Item = (usize, Vec<&str>)> {
    let lines = (1..).zip(text.trim_start_matches('\u{feff}').lines());
    let lines = lines.filter(|(_, line)| !line.trim().is_empty());
    lines.map(|(number, line)| (number, line.split(',').map(str::trim).collect()))
}

/// Parses lines of numbers without a header.
fn csv(text: &str) -> Result<(usize, Vec<f32>), String> {
    let columns = lines(text).next().ok_or("empty, expected a line for each image")?.1.len();
    let mut values = Vec::new();
    for (line, cells) in lines(text) {
        if cells.len() != columns {
            return Err(format!("line {line} has {} columns, expected {columns}", cells.len()));
        }
        for (column, cell) in (1..).zip(cells) {
            let wrong = |_| format!("line {line}, column {column}: {cell:?}, expected a number");
            values.push(cell.parse().map_err(wrong)?);
        }
    }
    Ok((columns, values))
}

/// Reads lines of query, first and last; the latter two are empty or -1 if the query is not on the
/// map.
pub(crate) fn truth(file: &Path, queries: usize, references: usize) -> Result<Vec<Label>, String> {
    let truth = parse(&read(file)?, queries, references);
    truth.map_err(|error| format!("{}: {error}", file.display()))
}

fn parse(text: &str, queries: usize, references: usize) -> Result<Vec<Label>, String> {
    let mut truth: Vec<Option<Label>> = vec![None; queries];
    for (line, cells) in lines(text).filter(|line| line.1 != ["query", "first", "last"]) {
        let &[query, first, last] = &cells[..] else {
            let found = cells.len();
            return Err(format!("line {line} has {found} columns, expected query, first, last"));
        };
        let number = |column: usize, cell: &str, below: usize| {
            let number = cell.parse::<usize>().ok().filter(|number| *number < below);
            let expected = format!("expected a number from 0 to {}", below - 1);
            number.ok_or_else(|| format!("line {line}, column {column}: {cell:?}, {expected}"))
        };
        let nowhere = [first, last].iter().all(|cell| matches!(*cell, "" | "-1"));
        let end = if nowhere { 0 } else { number(3, last, references)? };
        // `first` may be at most `last`: the range must not be empty.
        let label = if nowhere { None } else { Some(number(2, first, end + 1)?..=end) };
        let query = number(1, query, queries)?;
        if truth[query].replace(label).is_some() {
            return Err(format!("line {line}: query {query} again, expected each once"));
        }
    }
    let missing = |query: usize| {
        format!("no line for query {query}, expected {queries}: is the matrix transposed?")
    };
    (0..).zip(truth).map(|(query, label)| label.ok_or_else(|| missing(query))).collect()
}

#[cfg(test)]
mod tests {
    use npyz::{AutoSerialize, Order, WriterBuilder};

    use super::*;

    #[test]
    fn csv_files() {
        let text = "\u{feff}0.5, -1,2e1\r\n\r\n3,4, inf";
        assert_eq!(csv(text), Ok((3, vec![0.5, -1.0, 20.0, 3.0, 4.0, f32::INFINITY])));
        let error = |text: &str| csv(text).unwrap_err();
        assert_eq!(error("1,2\n\n3,four\n"), "line 3, column 2: \"four\", expected a number");
        assert_eq!(error("1,2\n3\n"), "line 2 has 1 columns, expected 2");
        assert_eq!(error("\n"), "empty, expected a line for each image");
    }

    fn npy<T: AutoSerialize>(values: [T; 4], order: Order) -> Result<(usize, Vec<f32>), String> {
        let file = std::env::temp_dir().join(format!("wayfix-{}.npy", std::process::id()));
        let options = npyz::WriteOptions::new().default_dtype().shape(&[2, 2]).order(order);
        let mut writer = options.writer(std::fs::File::create(&file).unwrap()).begin_nd().unwrap();
        writer.extend(values).and_then(|()| writer.finish()).unwrap();
        matrix(&file, false).map_err(|error| error.replace(&*file.to_string_lossy(), "FILE"))
    }

    #[test]
    fn npy_files() {
        let read =
            [npy([1.0_f32, 2.0, 3.0, 4.0], Order::C), npy([1.0_f64, 2.0, 3.0, 4.0], Order::C)];
        assert_eq!(read, [npy([1_u8, 2, 3, 4], Order::C), Ok((2, vec![1.0, 2.0, 3.0, 4.0]))]);
        let error = npy([1.0, 2.0, f64::INFINITY, 4.0], Order::C).unwrap_err();
        assert_eq!(error, "FILE, line 2, column 1: inf, expected a finite number");
        let error = npy([1, 2, 3, 4_i64], Order::C).unwrap_err();
        assert_eq!(error, "FILE: '<i8', expected float32, float64 or uint8");
        assert!(npy([1_u8; 4], Order::Fortran).unwrap_err().contains("expected (rows, columns)"));
    }

    #[test]
    fn truths() {
        let truth = parse("query,first,last\n2,9,9\n1,-1,\n0,0,2", 3, 10);
        assert_eq!(truth, Ok(vec![Some(0..=2), None, Some(9..=9)]));
        for (text, error) in [
            ("0,0,2\n1,2", "line 2 has 2 columns, expected query, first, last"),
            ("3,0,2", "line 1, column 1: \"3\", expected a number from 0 to 2"),
            ("0,0,10", "line 1, column 3: \"10\", expected a number from 0 to 9"),
            ("0,3,2", "line 1, column 2: \"3\", expected a number from 0 to 2"),
            ("0,,\n0,,", "line 2: query 0 again, expected each once"),
            ("2,,\n0,,", "no line for query 1, expected 3: is the matrix transposed?"),
        ] {
            assert_eq!(parse(text, 3, 10).unwrap_err(), error);
        }
        let error = super::truth(Path::new("no such file"), 3, 10).unwrap_err();
        assert!(error.starts_with("cannot read no such file: "), "{error}");
    }
}
