//! Ground truth from CSV files.

use std::ops::RangeInclusive;

use super::{Lines, Matrix, quoted};
use crate::vpr::counted;

/// Right places of each query; `None` if it is off the map.
type Truth = Vec<Option<RangeInclusive<usize>>>;

/// Reads the right references of each query, from lines of query, first and last in any order.
/// The latter two are empty or -1 if the place is not on the map. Also checks that the named
/// matrix has one line per query.
pub(super) fn truth(name: &str, text: &[u8], of: &str, matrix: &Matrix) -> Result<Truth, String> {
    let expected = "lines of query,first,last";
    let mut lines = Lines::new(name, text, expected)?;
    if lines.records[0].1 == ["query", "first", "last"][..] {
        lines.records.remove(0);
    }
    let given = lines.records.len();
    let (references, queries) = (matrix.columns, matrix.values.len() / matrix.columns);
    if given == 0 {
        return Err(format!("{name} is empty, expected {expected}"));
    }
    if let Some(line) = lines.records.iter().find(|line| line.1.len() != 3) {
        let transposed = if given == 3 { ": is the table transposed?" } else { "" };
        let found = counted(line.1.len(), "column");
        let what = format!(": {found}, expected 3: query, first, last{transposed}");
        return Err(lines.wrong(line, &what));
    }
    if given != queries {
        let matrix_is = |what: &str| {
            format!(
                "{of} has {queries} × {references} numbers, for {given} queries of {name}: {what}"
            )
        };
        if let Some(line) = matrix.counts {
            let header = format!("line {line} of it looks like a header line, delete it");
            return Err(matrix_is(&header));
        }
        let last = lines.records.iter().filter_map(|(_, record)| record[2].parse::<usize>().ok());
        let expected = "expected a line for each query";
        if given == references && last.max().is_none_or(|last| last < queries) {
            let both = format!("{expected} and a column for each reference, transpose it");
            return Err(matrix_is(&both));
        }
        if given > queries {
            return Err(matrix_is(expected));
        }
    }
    let mut truth = vec![None; queries];
    let mut seen: Vec<Option<u64>> = vec![None; queries];
    for at in &lines.records {
        let (line, record) = at;
        let field = |column: usize, below: usize, also: &str| {
            let number = record[column].parse::<usize>().ok().filter(|number| *number < below);
            number.ok_or_else(|| {
                let (found, last) = (quoted(&record[column]), below - 1);
                let expected = format!("expected a whole number from 0 to {last}{also}");
                lines.wrong(at, &format!(", column {}: {found}, {expected}", column + 1))
            })
        };
        let query = field(0, queries, "")?;
        if let Some(before) = seen[query].replace(*line) {
            let what = format!(": query {query} again, it is on line {before}");
            return Err(lines.wrong(at, &what));
        }
        let nowhere = |column: usize| matches!(&record[column], "" | "-1");
        let places = |expected: &str| {
            let (first, last) = (quoted(&record[1]), quoted(&record[2]));
            lines.wrong(at, &format!(": first is {first} and last is {last}, expected {expected}"))
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
        Some(query) => {
            Err(format!("{name}: query {query} is missing, expected 0 to {}", queries - 1))
        }
        None => Ok(truth),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads the truth of a matrix with ten columns.
    fn truth_of(queries: usize, counts: Option<u64>, text: &str) -> Result<Truth, String> {
        let matrix = Matrix { columns: 10, values: vec![0.0; 10 * queries], counts };
        super::truth("FILE", text.as_bytes(), "MATRIX", &matrix)
    }

    fn truth(text: &str) -> Result<Truth, String> {
        truth_of(3, None, text)
    }

    #[test]
    fn truths() {
        let expected = Ok(vec![Some(0..=2), None, Some(9..=9)]);
        assert_eq!(truth("0,0,2\n1,,\n2,9,9\n"), expected);
        assert_eq!(truth("query,first,last\n2,9,9\n1,-1,-1\n0,0,2"), expected);
    }

    #[test]
    fn truths_that_are_wrong() {
        let error = |text: &str| truth(text).unwrap_err();
        assert_eq!(error(""), "FILE is empty, expected lines of query,first,last");
        assert_eq!(error("query,first,last\n"), error(""));
        assert_eq!(
            error("image,from,to\n0,0,2\n"),
            "FILE, line 1, column 1: \"image\", expected a whole number from 0 to 2"
        );
        assert_eq!(
            error("0,0,2\n1,2\n"),
            "FILE, line 2: 2 columns, expected 3: query, first, last"
        );
        assert_eq!(
            error("0,0,2\n3,0,2\n"),
            "FILE, line 2, column 1: \"3\", expected a whole number from 0 to 2"
        );
        assert_eq!(
            error("0,0,2\n1,0,10\n"),
            "FILE, line 2, column 3: \"10\", expected a whole number from 0 to 9, or both empty or \
             -1 for a place that is not on the map"
        );
        assert!(error("0,0.5,2\n").starts_with("FILE, line 1, column 2: \"0.5\""));
        assert_eq!(
            error("0,3,2\n"),
            "FILE, line 1: first is \"3\" and last is \"2\", expected the first not to be above the last"
        );
        for half in ["0,,2\n", "0,3,-1\n"] {
            assert!(error(half).ends_with("expected both or none to be empty or -1"));
        }
        assert_eq!(error("0,0,2\n1,0,2\n0,0,2\n"), "FILE, line 3: query 0 again, it is on line 1");
        assert_eq!(error("0,0,2\n2,0,2\n"), "FILE: query 1 is missing, expected 0 to 2");
    }

    #[test]
    fn other_separators_are_named() {
        for text in ["query;first;last\n0;0;2\n", "0\t0\t2\n1\t1\t2\n2\t2\t2\n", "0 0 2\n"] {
            let error = truth(text).unwrap_err();
            assert!(error.starts_with("FILE, line 1 is separated by "), "{error}");
        }
    }

    #[test]
    fn headers_and_transposed_files_are_named() {
        let lines = |n: usize| (0..n).map(|i| format!("{i},0,1\n")).collect::<Vec<_>>().concat();
        assert_eq!(
            truth_of(4, Some(1), &lines(3)).unwrap_err(),
            "MATRIX has 4 × 10 numbers, for 3 queries of FILE: line 1 of it looks like a header \
             line, delete it"
        );
        // With as many lines as queries, the first line may be data.
        assert!(truth_of(4, Some(1), &lines(4)).is_ok());
        assert_eq!(
            truth_of(4, None, &lines(10)).unwrap_err(),
            "MATRIX has 4 × 10 numbers, for 10 queries of FILE: expected a line for each query and \
             a column for each reference, transpose it"
        );
        // Transposed, the matrix would have too few references for these places.
        let error = truth_of(4, None, "9,4,4\n".repeat(10).as_str()).unwrap_err();
        assert!(error.ends_with("FILE: expected a line for each query"), "{error}");
        let error = truth("0,1,2,3\n0,1,2,3\n1,1,2,3\n").unwrap_err();
        assert!(error.ends_with("query, first, last: is the table transposed?"), "{error}");
    }
}
