//! Drives from CSV files, and answers to CSV files.

use std::fmt;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim, Writer};

use super::{MatchedDrive, Matcher, RoadAnswer, TracePoint};
use crate::map::{MapError, Position};

/// A drive of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Name of the drive in the file.
    pub name: String,
    /// Points in the order of the file, each later than the one before.
    pub points: Vec<TracePoint>,
}

/// Lines of a file of drives that were left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SkippedPoints {
    /// Points with the time of the point before.
    pub repeated: usize,
    /// Points that are earlier than the one before.
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
/// a drive follow each other. Points that are not later than the one before are skipped and
/// counted.
///
/// # Errors
///
/// [`MapError::Read`] if the file cannot be opened, and [`MapError::Line`] with file and line for
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
    let failed =
        |error: csv::Error| at(error.position().map_or(1, csv::Position::line), error.to_string());
    let header = reader.headers().map_err(failed)?.clone();
    let columns = COLUMNS.map(|name| header.iter().position(|found| found == name));
    if let Some(missing) = columns[..4].iter().position(Option::is_none) {
        let found: Vec<&str> = header.iter().collect();
        let problem = format!(
            "the header {:?} has no column {}, expected trace,time,longitude,latitude and, if known, accuracy,heading,speed",
            found.join(","),
            COLUMNS[missing]
        );
        return Err(at(1, problem));
    }
    let mut traces: Vec<Trace> = Vec::new();
    let mut names = std::collections::HashSet::new();
    let mut skipped = SkippedPoints::default();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(failed)? {
        let line = record.position().map_or(0, csv::Position::line);
        let point = parse(&record, &columns).map_err(|problem| at(line, problem))?;
        let trace = columns[0].and_then(|column| record.get(column)).unwrap_or_default();
        if traces.last().is_none_or(|last| last.name != trace) {
            if !names.insert(trace.to_owned()) {
                let problem = format!("lines of drive {trace:?} are apart, expected them together");
                return Err(at(line, problem));
            }
            traces.push(Trace { name: trace.to_owned(), points: Vec::new() });
        }
        let Some(points) = traces.last_mut().map(|trace| &mut trace.points) else { continue };
        match points.last().map(|last| point.time.total_cmp(&last.time)) {
            Some(std::cmp::Ordering::Equal) => skipped.repeated += 1,
            Some(std::cmp::Ordering::Less) => skipped.backwards += 1,
            _ => points.push(point),
        }
    }
    Ok((traces, skipped))
}

fn parse(record: &StringRecord, columns: &[Option<usize>; 7]) -> Result<TracePoint, String> {
    let optional = |column: usize| {
        let text = columns[column].and_then(|at| record.get(at)).unwrap_or_default();
        let number = || text.parse::<f64>().map_err(|_| number_expected(column, text));
        if text.is_empty() { Ok(None) } else { number().map(Some) }
    };
    let number = |column: usize| optional(column)?.ok_or_else(|| number_expected(column, ""));
    let position = Position { longitude: number(2)?, latitude: number(3)? };
    let point = TracePoint {
        time: number(1)?,
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

fn number_expected(column: usize, found: &str) -> String {
    let found: String = found.chars().take(60).collect();
    format!("{} is {found:?}, expected a number", COLUMNS[column])
}

/// Writer of routes: `trace,seq,from,to,enter_m,exit_m,off_road`, a line for each edge or stretch
/// off the road, with nodes as in the input.
#[derive(Debug)]
pub struct RouteWriter<W: Write> {
    writer: Writer<W>,
}

impl<W: Write> RouteWriter<W> {
    /// Writes the header.
    ///
    /// # Errors
    ///
    /// An error of the writer, as for all methods here.
    pub fn new(writer: W) -> Result<Self, csv::Error> {
        let mut writer = Writer::from_writer(writer);
        writer.write_record(["trace", "seq", "from", "to", "enter_m", "exit_m", "off_road"])?;
        Ok(Self { writer })
    }

    /// Writes the route of a drive. A stretch off the road is from the node where the road was
    /// left to the one where it is reached again; empty, where there is none.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn write(
        &mut self,
        trace: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
    ) -> Result<(), csv::Error> {
        let id = |node: usize| matcher.network().nodes()[node].id.to_string();
        let edges = matcher.network().edges();
        for (seq, stretch) in drive.route().iter().enumerate() {
            let nodes = if let Some(edge) = stretch.edge {
                [id(edges[edge].from), id(edges[edge].to)]
            } else {
                let before = seq.checked_sub(1).and_then(|seq| drive.route()[seq].edge);
                let after = drive.route().get(seq + 1).and_then(|next| next.edge);
                let end = |node: Option<usize>| node.map_or(String::new(), id);
                [end(before.map(|edge| edges[edge].to)), end(after.map(|edge| edges[edge].from))]
            };
            let metres = [stretch.enter, stretch.exit].map(|metres| format!("{metres:.1}"));
            let off_road = if stretch.edge.is_some() { "0" } else { "1" };
            let [from, to] = nodes;
            let [enter, exit] = metres;
            self.writer.write_record([
                trace,
                &seq.to_string(),
                &from,
                &to,
                &enter,
                &exit,
                off_road,
            ])?;
        }
        Ok(())
    }
}

/// Writer of answers for points:
/// `trace,point,time,estimator,from,to,metres_along,probability,entropy,log_likelihood,off_road`.
#[derive(Debug)]
pub struct PointWriter<W: Write> {
    writer: Writer<W>,
}

impl<W: Write> PointWriter<W> {
    /// Writes the header.
    ///
    /// # Errors
    ///
    /// An error of the writer, as for all methods here.
    pub fn new(writer: W) -> Result<Self, csv::Error> {
        let mut writer = Writer::from_writer(writer);
        writer.write_record([
            "trace",
            "point",
            "time",
            "estimator",
            "from",
            "to",
            "metres_along",
            "probability",
            "entropy",
            "log_likelihood",
            "off_road",
        ])?;
        Ok(Self { writer })
    }

    /// Writes the live answers of a drive, those `lag` points late, and the smoothed ones. Off the
    /// road, both nodes are empty.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn write(
        &mut self,
        trace: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
        lag: usize,
    ) -> Result<(), csv::Error> {
        for point in 0..drive.points().len() {
            let answers = [
                ("live", drive.live(point)),
                ("late", drive.late(point, lag)),
                ("smoothed", drive.smoothed(point)),
            ];
            for (estimator, answer) in answers {
                let log = drive.log_normalizer(point);
                let time = drive.points()[point].time;
                self.line([trace, estimator], (point, time), matcher, &answer, log)?;
            }
        }
        Ok(())
    }

    fn line(
        &mut self,
        [trace, estimator]: [&str; 2],
        (point, time): (usize, f64),
        matcher: &Matcher,
        answer: &RoadAnswer,
        log_likelihood: f64,
    ) -> Result<(), csv::Error> {
        let network = matcher.network();
        let id = |node: usize| network.nodes()[node].id.to_string();
        let edge = answer.edge.map(|edge| &network.edges()[edge]);
        self.writer.write_record([
            trace,
            &point.to_string(),
            &time.to_string(),
            estimator,
            &edge.map_or(String::new(), |edge| id(edge.from)),
            &edge.map_or(String::new(), |edge| id(edge.to)),
            &format!("{:.1}", answer.metres_along),
            &format!("{:.6}", answer.probability),
            &format!("{:.6}", answer.entropy),
            &format!("{log_likelihood:.6}"),
            &format!("{:.6}", answer.off_road),
        ])
    }
}
