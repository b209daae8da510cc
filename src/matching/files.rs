//! Drives from CSV files.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::fmt;
use std::io::Read;
use std::path::Path;

use csv::StringRecord;

use super::TracePoint;
use crate::files::{Row, Text, each_row, excerpt, open, unknown};
use crate::map::{MapError, Position};

/// A drive of a file: what [`Matcher::learn`](super::Matcher::learn) takes, and with its `points` what
/// [`Matcher::match_drive`](super::Matcher::match_drive) does.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Name of the drive in the file.
    pub name: String,
    /// Points in the order of the file, each later than the one before.
    pub points: Vec<TracePoint>,
    /// Number of points of the drive that were left out, with the time of the last one taken.
    pub repeated: usize,
    /// Number of points that were left out, earlier than the last one taken.
    pub backwards: usize,
}

impl AsRef<[TracePoint]> for Trace {
    fn as_ref(&self) -> &[TracePoint] {
        &self.points
    }
}

/// Report of a file of drives.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct TraceReport {
    /// Number of points of all drives that were left out, with the time of the last one taken; each
    /// [`Trace`] has its own.
    pub repeated: usize,
    /// Number of points that were left out, earlier than the last one taken.
    pub backwards: usize,
    /// Lines of the first ten points that were left out.
    pub skipped_lines: Vec<u64>,
    /// Columns that are not known, and were not read.
    pub ignored_columns: Vec<String>,
}

/// Most lines of skipped points that are kept.
const MOST_LINES: usize = 10;

/// Prints the counts, and a line for each column that is not known.
impl fmt::Display for TraceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { repeated, backwards, skipped_lines: lines, ignored_columns } = self;
        write!(
            f,
            "skipped {repeated} points of the same time and {backwards} that go back in time"
        )?;
        if !lines.is_empty() {
            let named: Vec<String> = lines.iter().map(u64::to_string).collect();
            let more = if lines.len() < repeated + backwards { ", …" } else { "" };
            let word = if lines.len() == 1 { "line" } else { "lines" };
            write!(f, " ({word} {}{more})", named.join(", "))?;
        }
        ignored_columns.iter().try_for_each(|column| write!(f, "\ncolumn not known: {column}"))
    }
}

const COLUMNS: [&str; 7] =
    ["trace", "time", "longitude", "latitude", "accuracy", "heading", "speed"];

/// Reads drives from a CSV file with the header
/// `trace,time,longitude,latitude[,accuracy,heading,speed]`, in any order of the columns: the name
/// of the drive, seconds, degrees, and, if known, metres, degrees clockwise from north (from −180
/// to 360) and metres per second. Lines of a drive follow each other. Points that are not later
/// than the last one taken are skipped, and counted for each drive and in all; the report names
/// the lines of the first ten, and columns that are not known.
///
/// # Errors
///
/// [`MapError::Read`] if the file cannot be opened or read, and [`MapError::Line`] with file and line for
/// a missing column, a value that cannot be parsed or is out of range, a drive whose lines are
/// apart or mostly go back in time, or a file without points.
pub fn read_traces(path: impl AsRef<Path>) -> Result<(Vec<Trace>, TraceReport), MapError> {
    let (name, file) = open(path.as_ref())?;
    read_traces_from(&name, file)
}

/// Reads drives as [`read_traces`] does; errors call the reader by a name.
///
/// ```
/// use wayfix::matching::read_traces_from;
///
/// let text = "trace,time,longitude,latitude,acuracy\nA,0,149.13,-35.28,5\nA,0,149.13,-35.28,5\n";
/// let (traces, report) = read_traces_from("drive", text.as_bytes())?;
/// assert_eq!((traces.len(), traces[0].points.len()), (1, 1));
/// assert_eq!(
///     report.to_string(),
///     "skipped 1 points of the same time and 0 that go back in time (line 3)\n\
///      column not known: acuracy"
/// );
///
/// let text = "trace,time,longitude,latitude\nA,0,149.13,-35.28\nA,1,149.13,-95\n";
/// let error = read_traces_from("drive", text.as_bytes()).unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "drive, line 3: the point has latitude -95, expected a latitude from -90 to 90 degrees"
/// );
/// # Ok::<(), wayfix::map::MapError>(())
/// ```
///
/// # Errors
///
/// As [`read_traces`].
pub fn read_traces_from(
    name: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, TraceReport), MapError> {
    let (mut traces, mut names): (Vec<Trace>, _) = (Vec::new(), HashSet::new());
    let (mut ignored_columns, mut skipped_lines) = (Vec::new(), Vec::new());
    let (mut all_repeated, mut all_backwards) = (0, 0);
    // Line of the first point of the last drive that goes back.
    let mut first_back = 0;
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
    let in_order = |trace: Option<&Trace>, line: u64| match trace {
        Some(trace) if trace.backwards > trace.points.len() => {
            let (drive, back) = (excerpt(&trace.name), trace.backwards);
            let problem = format!(
                "{back} points of drive {drive:?} from here on go back in time, expected ascending times"
            );
            Err(MapError::Line { file: name.to_owned(), line, problem })
        }
        _ => Ok(()),
    };
    let mut descending = Ok(());
    let end = each_row((name, reader), Text::Strict, &COLUMNS, find, |row| {
        let (point, trace) = (parse(&row)?, row.text(0));
        if traces.last().is_none_or(|last| last.name != trace) {
            if !names.insert(trace.to_owned()) {
                let trace = excerpt(trace);
                return Err(format!("lines of drive {trace:?} are apart, expected them together"));
            }
            if descending.is_ok() {
                descending = in_order(traces.last(), first_back);
            }
            let (name, points) = (trace.to_owned(), Vec::new());
            traces.push(Trace { name, points, repeated: 0, backwards: 0 });
        }
        let Some(Trace { points, repeated, backwards, .. }) = traces.last_mut() else {
            return Ok(());
        };
        // Not the total order, in which -0 is before 0.
        match points.last().and_then(|last| point.time.partial_cmp(&last.time)) {
            Some(Ordering::Equal) => {
                (*repeated, all_repeated) = (*repeated + 1, all_repeated + 1);
            }
            Some(Ordering::Less) => {
                if *backwards == 0 {
                    first_back = row.line;
                }
                (*backwards, all_backwards) = (*backwards + 1, all_backwards + 1);
            }
            _ => {
                points.push(point);
                return Ok(());
            }
        }
        if skipped_lines.len() < MOST_LINES {
            skipped_lines.push(row.line);
        }
        Ok(())
    })?;
    descending?;
    in_order(traces.last(), first_back)?;
    if traces.is_empty() {
        let problem = String::from("there are no points, expected at least one");
        return Err(MapError::Line { file: name.to_owned(), line: end, problem });
    }
    let (repeated, backwards) = (all_repeated, all_backwards);
    Ok((traces, TraceReport { repeated, backwards, skipped_lines, ignored_columns }))
}

fn parse(row: &Row<'_>) -> Result<TracePoint, String> {
    row.check_width()?;
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
    point.numbers().map_err(|problem| problem.to_string())?;
    Ok(point)
}
