//! Drives from CSV files.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::TracePoint;
use crate::map::{Line, MapError, Position, csv_error, excerpt};

/// A drive of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Name of the drive in the file.
    pub name: String,
    /// Points in the order of the file, each later than the one before.
    pub points: Vec<TracePoint>,
    /// Points of the drive that were left out.
    pub skipped: SkippedPoints,
}

/// Points of a drive, or of all drives of a file, that were left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SkippedPoints {
    /// Points with the time of the last one taken.
    pub repeated: usize,
    /// Points that are earlier than the last one taken.
    pub backwards: usize,
}

impl fmt::Display for SkippedPoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { repeated, backwards } = self;
        write!(f, "skipped {repeated} points of the same time and {backwards} that go back in time")
    }
}

const COLUMNS: [&str; 7] =
    ["trace", "time", "longitude", "latitude", "accuracy", "heading", "speed"];

/// Reads drives from a CSV file with the header
/// `trace,time,longitude,latitude[,accuracy,heading,speed]`, in any order of the columns: the name
/// of the drive, seconds, degrees, and, if known, metres, degrees and metres per second. Lines of
/// a drive follow each other. Points that are not later than the last one taken are skipped, and
/// counted for each drive and in all.
///
/// # Errors
///
/// [`MapError::Read`] if the file cannot be opened or read, and [`MapError::Line`] with file and line for
/// a missing column, a value that cannot be parsed or is out of range, or a drive whose lines are
/// apart.
pub fn read_traces(path: impl AsRef<Path>) -> Result<(Vec<Trace>, SkippedPoints), MapError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let file = File::open(path)
        .map_err(|error| MapError::Read { file: name.clone(), reason: error.to_string() })?;
    read_traces_from(&name, file)
}

/// Reads drives as [`read_traces`] does; errors call the reader by a name.
///
/// ```
/// use wayfix::matching::read_traces_from;
///
/// let text = "trace,time,longitude,latitude\nA,0,149.13,-35.28\nA,1,149.13,-95\n";
/// let error = read_traces_from("drive", text.as_bytes()).unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "drive, line 3: the point has latitude -95, expected a position on Earth, or in the plane"
/// );
/// ```
///
/// # Errors
///
/// As [`read_traces`].
pub fn read_traces_from(
    name: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, SkippedPoints), MapError> {
    let at = |line, problem| MapError::Line { file: name.to_owned(), line, problem };
    let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(reader);
    let failed = |error: csv::Error| csv_error(name, 1, &error);
    let header = reader.headers().map_err(failed)?.clone();
    let columns = COLUMNS.map(|name| header.iter().position(|found| found == name));
    if let Some(missing) = columns[..4].iter().position(Option::is_none) {
        let found: Vec<&str> = header.iter().collect();
        let problem = format!(
            "the header {:?} has no column {}, expected trace,time,longitude,latitude and, if known, accuracy,heading,speed",
            excerpt(&found.join(",")),
            COLUMNS[missing]
        );
        return Err(at(1, problem));
    }
    let mut traces: Vec<Trace> = Vec::new();
    let mut names = HashSet::new();
    let mut total = SkippedPoints::default();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(failed)? {
        let line = record.position().map_or(0, csv::Position::line);
        let row = Line { record: &record, places: &columns, names: &COLUMNS };
        let point = parse(&row).map_err(|problem| at(line, problem))?;
        let trace = row.text(0);
        if traces.last().is_none_or(|last| last.name != trace) {
            if !names.insert(trace.to_owned()) {
                let problem = format!(
                    "lines of drive {:?} are apart, expected them together",
                    excerpt(trace)
                );
                return Err(at(line, problem));
            }
            let (name, points) = (trace.to_owned(), Vec::new());
            traces.push(Trace { name, points, skipped: SkippedPoints::default() });
        }
        let Some(Trace { points, skipped, .. }) = traces.last_mut() else { continue };
        // Not the total order, in which -0 is before 0.
        match points.last().and_then(|last| point.time.partial_cmp(&last.time)) {
            Some(Ordering::Equal) => {
                (skipped.repeated, total.repeated) = (skipped.repeated + 1, total.repeated + 1);
            }
            Some(Ordering::Less) => {
                (skipped.backwards, total.backwards) = (skipped.backwards + 1, total.backwards + 1);
            }
            _ => points.push(point),
        }
    }
    Ok((traces, total))
}

fn parse(row: &Line<'_>) -> Result<TracePoint, String> {
    let optional = |column: usize| match row.text(column) {
        "" => Ok(None),
        _ => row.number(column).map(Some),
    };
    let position = Position { longitude: row.number(2)?, latitude: row.number(3)? };
    let point = TracePoint {
        time: row.number(1)?,
        position,
        accuracy: optional(4)?,
        heading: optional(5)?,
        speed: optional(6)?,
    };
    let swapped = position.latitude.abs() > 90.0
        && position.latitude.abs() <= 180.0
        && position.longitude.abs() <= 90.0;
    point.check().map_err(|error| {
        let hint = if swapped { " (are longitude and latitude swapped?)" } else { "" };
        format!("{error}{hint}")
    })?;
    Ok(point)
}
