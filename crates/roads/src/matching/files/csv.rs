//! Drives from CSV files.
//!
//! The points of a drive are on consecutive lines, so a file of any length is read line by line.

use std::io::Read;

use csv::StringRecord;

use super::collect::{Collector, Trace, TraceReport};
use super::time::{TIMES, seconds_of};
use crate::NetworkError;
use crate::matching::TracePoint;
use wayfix::internal::{Row, Text, each_row, excerpt, unknown};
use wayfix::map::Position;

const COLUMNS: [&str; 7] =
    ["trace", "time", "longitude", "latitude", "accuracy", "heading", "speed"];

pub(super) fn read(
    file: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let mut ignored_columns = Vec::new();
    let find = |header: &StringRecord| {
        let columns = COLUMNS.map(|name| header.iter().position(|found| found == name));
        if let Some(missing) = columns[..4].iter().position(Option::is_none) {
            let found = header.iter().collect::<Vec<_>>().join(",");
            return Err(format!(
                "the header {:?} has no column {}, expected trace,time,longitude,latitude and, if known, accuracy,heading,speed",
                excerpt(&found),
                COLUMNS[missing]
            ));
        }
        ignored_columns.extend(unknown(header, &columns));
        Ok(columns)
    };
    let mut drives = Collector::default();
    // A change of name starts a drive; `start` refuses a name that was used before.
    let end = each_row((file, reader), Text::Strict, &COLUMNS, find, |row| {
        let (point, trace) = (parse(&row)?, row.text(0));
        if drives.traces.last().is_none_or(|last| last.name != trace) {
            drives.start(trace)?;
        }
        drives.add(point, row.line);
        Ok(())
    })?;
    drives.report.ignored_columns = ignored_columns;
    let at = |(line, problem)| NetworkError::Line { file: file.to_owned(), line, problem };
    drives.finish(end).map_err(at)
}

fn parse(row: &Row<'_>) -> Result<TracePoint, String> {
    row.check_width()?;
    let optional = |column: usize| match row.text(column) {
        "" => Ok(None),
        _ => row.number(column).map(Some),
    };
    let position = Position { longitude: row.number(2)?, latitude: row.number(3)? };
    let point = TracePoint {
        time: seconds_of(row.text(1)).ok_or_else(|| row.unexpected(1, TIMES))?,
        position,
        accuracy: optional(4)?,
        heading: optional(5)?,
        speed: optional(6)?,
    };
    point.numbers().map_err(|problem| problem.to_string())?;
    Ok(point)
}
