//! Drives from GPX files, one for each segment of a track.
//!
//! Elements are recognised by their depth and parents alone, whatever their prefix: a track is a
//! child of the root, a segment a child of a track, a point a child of a segment. Everything else
//! is skipped.

use std::io::Read;

use quick_xml::Reader;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesRef, BytesStart, Event};

use super::collect::{Collector, Problem, Trace, TraceReport};
use super::time::{TIMES, seconds_of};
use crate::NetworkError;
use crate::matching::TracePoint;
use wayfix::internal::{excerpt, shortened, text_of};
use wayfix::map::Position;

/// Largest number of characters of the parser's message, which quotes the text.
const LONGEST_PROBLEM: usize = 300;

pub(super) fn read(
    file: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let text = text_of(file, reader)?;
    let at = |(line, problem)| NetworkError::Line { file: file.to_owned(), line, problem };
    drives(&text).map_err(at)
}

fn drives(text: &str) -> Result<(Vec<Trace>, TraceReport), Problem> {
    let (mut reader, mut lines) = (Reader::from_str(text), Lines { text, byte: 0, line: 1 });
    let mut tracks = Tracks::default();
    loop {
        let event = reader.read_event().map_err(|error| {
            let problem = shortened(&error.to_string(), LONGEST_PROBLEM).into_owned();
            (lines.of(reader.error_position()), problem)
        })?;
        let line = lines.of(reader.buffer_position());
        match event {
            Event::Start(tag) => tracks.start(&tag, line)?,
            // `<a/>` is `<a></a>`: both handlers see it, so the stack stays balanced.
            Event::Empty(tag) => {
                tracks.start(&tag, line)?;
                tracks.end(line)?;
            }
            Event::End(_) => tracks.end(line)?,
            Event::Text(text) => tracks.field += &text.xml10_content(),
            Event::CData(text) => tracks.field += &text.xml10_content(),
            Event::GeneralRef(reference) => tracks.refer(&reference),
            Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => {}
            Event::Eof if tracks.open.is_empty() => return tracks.drives.finish(line),
            Event::Eof => {
                return Err((line, String::from("the file ends too early, expected </gpx>")));
            }
        }
    }
}

/// Line numbers of bytes, in one pass over the text.
struct Lines<'a> {
    text: &'a str,
    /// A byte, and its line, from 1.
    byte: usize,
    line: u64,
}

impl Lines<'_> {
    /// Line of a byte that is not before the last one asked for.
    fn of(&mut self, byte: u64) -> u64 {
        let byte = usize::try_from(byte).map_or(self.text.len(), |byte| byte.min(self.text.len()));
        let between = self.text.get(self.byte..byte).unwrap_or_default();
        self.line += between.matches('\n').count() as u64;
        self.byte = self.byte.max(byte);
        self.line
    }
}

/// An element, by its name without a prefix.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Element {
    Gpx,
    Track,
    Segment,
    Point,
    Name,
    Time,
    Speed,
    Course,
    Other,
}

/// State of reading a file.
#[derive(Default)]
struct Tracks {
    open: Vec<Element>,
    /// Number of tracks so far, and the name of the last one.
    count: usize,
    name: String,
    /// Points of each segment of the track, with their lines.
    segments: Vec<Vec<(TracePoint, u64)>>,
    point: Option<Point>,
    /// Text since the last tag.
    field: String,
    drives: Collector,
}

/// A point being read.
struct Point {
    line: u64,
    position: Position,
    time: Option<f64>,
    heading: Option<f64>,
    speed: Option<f64>,
}

impl Tracks {
    fn start(&mut self, tag: &BytesStart<'_>, line: u64) -> Result<(), Problem> {
        let name = tag.local_name().into_inner();
        let element = match name {
            "gpx" => Element::Gpx,
            "trk" => Element::Track,
            "trkseg" => Element::Segment,
            "trkpt" => Element::Point,
            "name" => Element::Name,
            "time" => Element::Time,
            "speed" => Element::Speed,
            "course" => Element::Course,
            _ => Element::Other,
        };
        match (&self.open[..], element) {
            ([], Element::Gpx) => {}
            ([], _) => {
                let problem = format!("the file starts with <{}>, expected <gpx>", excerpt(name));
                return Err((line, problem));
            }
            ([_], Element::Track) => {
                self.count += 1;
                self.name = format!("track {}", self.count);
            }
            ([_, Element::Track], Element::Segment) => self.segments.push(Vec::new()),
            ([_, Element::Track, Element::Segment], Element::Point) => {
                let position = position(tag).map_err(|problem| (line, problem))?;
                let [time, heading, speed] = [None; 3];
                self.point = Some(Point { line, position, time, heading, speed });
            }
            _ => {}
        }
        self.open.push(element);
        self.field.clear();
        Ok(())
    }

    fn end(&mut self, line: u64) -> Result<(), Problem> {
        use Element::{Course, Name, Speed, Time, Track};

        let text = self.field.trim();
        let number = |what: &str| {
            let number = text.parse::<f64>();
            number.map_err(|_| (line, format!("{what} is {:?}, expected a number", excerpt(text))))
        };
        match (&self.open[..], &mut self.point) {
            ([_, Track], _) => {
                // Drives are added at the end of the track, since its name may come after the
                // segments.
                for segment in self.segments.drain(..).filter(|points| !points.is_empty()) {
                    self.drives.start_numbered(&self.name);
                    segment.into_iter().for_each(|(point, line)| self.drives.add(point, line));
                }
            }
            ([_, Track, Name], _) if !text.is_empty() => text.clone_into(&mut self.name),
            ([_, _, _, Element::Point], Some(point)) => {
                let point =
                    (point.finished().map_err(|problem| (point.line, problem))?, point.line);
                self.segments.last_mut().into_iter().for_each(|points| points.push(point));
                self.point = None;
            }
            // Only the point's own time: extensions have times of other things.
            ([_, _, _, _, Time], Some(point)) => {
                let problem = || (line, format!("time is {:?}, expected {TIMES}", excerpt(text)));
                point.time = Some(seconds_of(text).ok_or_else(problem)?);
            }
            // Children of the point in GPX 1.0, and of its extensions in 1.1. Phones write -1 for
            // an unknown number.
            ([_, _, _, _, .., Speed], Some(point)) => {
                point.speed = Some(number("speed")?).filter(|speed| *speed != -1.0);
            }
            ([_, _, _, _, .., Course], Some(point)) => {
                point.heading = Some(number("course")?).filter(|course| *course != -1.0);
            }
            _ => {}
        }
        self.open.pop();
        self.field.clear();
        Ok(())
    }

    /// Adds the character of a reference, such as `&amp;`; an unknown reference stays as it is.
    fn refer(&mut self, reference: &BytesRef<'_>) {
        let name = reference.xml10_content();
        match (reference.resolve_char_ref(), resolve_predefined_entity(&name)) {
            (Ok(Some(character)), _) => self.field.push(character),
            (_, Some(text)) => self.field += text,
            _ => self.field += &format!("&{name};"),
        }
    }
}

impl Point {
    fn finished(&self) -> Result<TracePoint, String> {
        let &Self { position, time, heading, speed, .. } = self;
        let time = time.ok_or("the point has no time, expected one in each <trkpt>")?;
        let point = TracePoint { time, position, accuracy: None, heading, speed };
        point.numbers().map_err(|problem| problem.to_string())?;
        Ok(point)
    }
}

/// Position of a point from its attributes.
fn position(tag: &BytesStart<'_>) -> Result<Position, String> {
    let degrees = |name: &str| {
        let attribute = tag.try_get_attribute(name).map_err(|error| error.to_string())?;
        let Some(attribute) = attribute else {
            return Err(format!("the point has no {name}, expected degrees"));
        };
        let text = attribute.value.trim();
        text.parse().map_err(|_| format!("{name} is {:?}, expected a number", excerpt(text)))
    };
    Ok(Position { latitude: degrees("lat")?, longitude: degrees("lon")? })
}
