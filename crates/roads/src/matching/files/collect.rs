//! Drives of a file, collected point by point.
//!
//! Readers of all formats feed it one point at a time. Times of the points it keeps strictly ascend
//! within a drive, as matching requires; points that are repeated or go back are skipped and
//! counted, and only a drive that mostly goes back is an error.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::fmt;

use crate::matching::TracePoint;
use wayfix::internal::excerpt;

/// Drive read from a file. [`Matcher::learn`](crate::matching::Matcher::learn) takes it as it is,
/// and [`Matcher::match_drive`](crate::matching::Matcher::match_drive) its `points`.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Name of the drive in the file.
    pub name: String,
    /// Points in the order of the file, each later than the one before.
    pub points: Vec<TracePoint>,
    /// Number of points left out because they have the same time as the last one taken.
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
    /// Number of points of all drives left out because they have the same time as the last one
    /// kept; each [`Trace`] has its own count.
    pub repeated: usize,
    /// Number of points that were left out, earlier than the last one taken.
    pub backwards: usize,
    /// Lines of the first ten points that were left out; empty for GeoJSON, where points have no
    /// lines.
    pub skipped_lines: Vec<u64>,
    /// Unknown columns, which were not read.
    pub ignored_columns: Vec<String>,
}

/// Prints the counts, and one line for each unknown column.
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
        ignored_columns.iter().try_for_each(|column| write!(f, "\nunknown column: {column}"))
    }
}

/// Largest number of lines of skipped points that are reported.
const MOST_LINES: usize = 10;

/// A problem and its place: a line, or a feature of GeoJSON.
pub(super) type Problem = (u64, String);

/// Drives that were read so far.
#[derive(Debug, Default)]
pub(super) struct Collector {
    pub(super) traces: Vec<Trace>,
    pub(super) report: TraceReport,
    /// Number of drives that asked for each name.
    names: HashMap<String, usize>,
    /// Place of the first point of the last drive that goes back in time.
    first_back: u64,
    /// Problem of the first drive that mostly goes back in time.
    descending: Option<Problem>,
}

impl Collector {
    /// Starts a drive, unless the name is taken.
    #[cfg(any(feature = "csv", feature = "geojson"))]
    pub(super) fn start(&mut self, name: &str) -> Result<(), String> {
        if self.names.insert(name.to_owned(), 1).is_some() {
            let name = excerpt(name);
            return Err(format!("points of drive {name:?} are apart, expected them together"));
        }
        self.push(name.to_owned());
        Ok(())
    }

    /// Starts a drive with a name, with a number appended if the name is taken.
    #[cfg(any(feature = "gpx", feature = "geojson"))]
    pub(super) fn start_numbered(&mut self, name: &str) {
        let mut number = self.names.get(name).map_or(1, |count| count + 1);
        let mut numbered = name.to_owned();
        // The numbered name may itself be the name of an earlier drive, such as "a (2)".
        while number > 1 {
            numbered = format!("{name} ({number})");
            if !self.names.contains_key(&numbered) {
                break;
            }
            number += 1;
        }
        self.names.insert(name.to_owned(), number);
        if number > 1 {
            self.names.insert(numbered.clone(), 1);
        }
        self.push(numbered);
    }

    fn push(&mut self, name: String) {
        self.end();
        self.traces.push(Trace { name, points: Vec::new(), repeated: 0, backwards: 0 });
    }

    /// Adds a point to the last drive if it is later than the one before.
    pub(super) fn add(&mut self, point: TracePoint, place: u64) {
        let Some(Trace { points, repeated, backwards, .. }) = self.traces.last_mut() else {
            return;
        };
        let report = &mut self.report;
        // Not `total_cmp`, which puts -0 before 0. Times are finite: the point was checked.
        match points.last().and_then(|last| point.time.partial_cmp(&last.time)) {
            Some(Ordering::Equal) => {
                (*repeated, report.repeated) = (*repeated + 1, report.repeated + 1);
            }
            Some(Ordering::Less) => {
                if *backwards == 0 {
                    self.first_back = place;
                }
                (*backwards, report.backwards) = (*backwards + 1, report.backwards + 1);
            }
            _ => {
                points.push(point);
                return;
            }
        }
        if report.skipped_lines.len() < MOST_LINES {
            report.skipped_lines.push(place);
        }
    }

    /// Checks the last drive once it is complete.
    fn end(&mut self) {
        if let Some(Trace { name, points, backwards, .. }) = self.traces.last()
            && *backwards > points.len()
            && self.descending.is_none()
        {
            let name = excerpt(name);
            let problem = format!(
                "{backwards} points of drive {name:?} from here on go back in time, expected ascending times"
            );
            self.descending = Some((self.first_back, problem));
        }
    }

    /// Returns the drives. `end` is where the file ends.
    pub(super) fn finish(mut self, end: u64) -> Result<(Vec<Trace>, TraceReport), Problem> {
        self.end();
        if let Some(problem) = self.descending {
            return Err(problem);
        }
        if self.traces.is_empty() {
            return Err((end, String::from("there are no points, expected at least one")));
        }
        Ok((self.traces, self.report))
    }
}
