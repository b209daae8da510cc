//! Drives from GeoJSON: lines with a list of times, or points with a time each.

use std::io::Read;

use geojson::{Feature, GeoJson, GeometryValue, JsonObject, JsonValue};

use super::collect::{Collector, Trace, TraceReport};
use super::time::{TIMES, seconds_of};
use crate::matching::TracePoint;
use crate::{NetworkError, parse_geojson};
use wayfix::internal::excerpt;
use wayfix::map::Position;

/// Properties of a line with the times of its points.
const LINE_TIMES: [&str; 2] = ["coordTimes", "times"];
/// Properties of a point with its time, and of any feature with the name of its drive.
const POINT_TIME: [&str; 2] = ["time", "timestamp"];
const NAMES: [&str; 2] = ["trace", "name"];

pub(super) fn read(
    file: &str,
    reader: impl Read,
) -> Result<(Vec<Trace>, TraceReport), NetworkError> {
    let mut drives = Collector::default();
    let at = |(number, problem)| NetworkError::Feature {
        file: file.to_owned(),
        feature: number as usize,
        problem,
    };
    let mut take = |feature: &Feature, number: u64| {
        let taken = Drives { drives: &mut drives, number }.take(feature);
        taken.map_err(|problem| at((number, problem)))
    };
    let count = match parse_geojson(file, reader)? {
        GeoJson::FeatureCollection(collection) => {
            for (feature, number) in collection.features.iter().zip(1..) {
                take(feature, number)?;
            }
            collection.features.len().max(1) as u64
        }
        GeoJson::Feature(feature) => {
            take(&feature, 1)?;
            1
        }
        GeoJson::Geometry(_) => {
            let problem = "a geometry without properties, expected features with times";
            return Err(at((1, problem.to_owned())));
        }
    };
    // Places here are numbers of features, so there are no lines to report.
    drives.report.skipped_lines = Vec::new();
    drives.finish(count).map_err(at)
}

/// Drives, and the number of the feature that is being read.
struct Drives<'a> {
    drives: &'a mut Collector,
    number: u64,
}

impl Drives<'_> {
    fn take(&mut self, feature: &Feature) -> Result<(), String> {
        let none = JsonObject::new();
        let properties = feature.properties.as_ref().unwrap_or(&none);
        let name = NAMES.iter().find_map(|key| word(properties.get(*key)?));
        match feature.geometry.as_ref().map(|geometry| &geometry.value) {
            Some(GeometryValue::LineString { coordinates }) => {
                let times = line_times(properties)?;
                self.line(&self.name(name), coordinates, times)
            }
            Some(GeometryValue::MultiLineString { coordinates }) => {
                let (name, times) = (self.name(name), line_times(properties)?);
                check_count(times.len(), coordinates.len(), "lines")?;
                coordinates.iter().zip(times).zip(1..).try_for_each(|((line, times), number)| {
                    let times = times.as_array().ok_or("expected a list of times for each line");
                    let line = times.map_err(String::from).and_then(|t| self.line(&name, line, t));
                    line.map_err(|problem| format!("line {number}: {problem}"))
                })
            }
            Some(GeometryValue::Point { coordinates }) => {
                let time = POINT_TIME.iter().find_map(|key| properties.get(*key));
                let time = time.ok_or("the point has no time, expected a property time")?;
                let number = |keys: &[&str]| keys.iter().find_map(|key| properties.get(*key));
                let mut point = point(coordinates.as_slice(), time)?;
                point.accuracy = optional("accuracy", number(&["accuracy"]))?;
                point.heading = optional("heading", number(&["heading", "course"]))?;
                point.speed = optional("speed", number(&["speed"]))?;
                point.numbers().map_err(|problem| problem.to_string())?;
                // Without a name, the points of the file are one drive.
                let name = word(properties.get("trace").unwrap_or(&JsonValue::Null));
                let name = name.unwrap_or_else(|| String::from("1"));
                if self.drives.traces.last().is_none_or(|last| last.name != name) {
                    self.drives.start(&name)?;
                }
                self.drives.add(point, self.number);
                Ok(())
            }
            Some(other) => {
                let kind = other.type_name();
                Err(format!("the geometry is a {kind}, expected a LineString or a Point"))
            }
            None => Err(String::from("there is no geometry, expected a LineString or a Point")),
        }
    }

    /// Name of a drive: that of its line, or the number of its feature.
    fn name(&self, name: Option<String>) -> String {
        name.unwrap_or_else(|| self.number.to_string())
    }

    /// Adds the points of a line as a drive.
    fn line(
        &mut self,
        name: &str,
        line: &[geojson::Position],
        times: &[JsonValue],
    ) -> Result<(), String> {
        check_count(times.len(), line.len(), "points")?;
        if line.is_empty() {
            return Ok(());
        }
        self.drives.start_numbered(name);
        for ((coordinates, time), number) in line.iter().zip(times).zip(1..) {
            let point = point(coordinates.as_slice(), time);
            let at = |problem| format!("point {number}: {problem}");
            self.drives.add(point.map_err(at)?, self.number);
        }
        Ok(())
    }
}

/// Times of the points of a line, or of each of several lines.
fn line_times(properties: &JsonObject) -> Result<&[JsonValue], String> {
    let nested = || properties.get("coordinateProperties").and_then(JsonValue::as_object);
    let found = [Some(properties), nested()].into_iter().flatten();
    let mut found = found.flat_map(|o| LINE_TIMES.iter().filter_map(|key| o.get(*key)));
    match found.next() {
        Some(JsonValue::Array(times)) => Ok(times),
        Some(_) => Err(String::from("the times are not a list, expected one for each point")),
        None => Err(String::from("the line has no times, expected a property coordTimes or times")),
    }
}

fn check_count(times: usize, expected: usize, what: &str) -> Result<(), String> {
    if times == expected {
        return Ok(());
    }
    Err(format!("{times} times for {expected} {what}, expected one for each"))
}

/// Point with a position and a time.
fn point(coordinates: &[f64], time: &JsonValue) -> Result<TracePoint, String> {
    let [longitude, latitude, ..] = *coordinates else {
        let count = coordinates.len();
        return Err(format!("{count} coordinates, expected longitude and latitude"));
    };
    let found = word(time).unwrap_or_else(|| time.to_string());
    let seconds = seconds_of(found.trim());
    let time = seconds.ok_or_else(|| format!("time is {:?}, expected {TIMES}", excerpt(&found)))?;
    let point = TracePoint::new(time, Position { latitude, longitude });
    point.numbers().map_err(|problem| problem.to_string())?;
    Ok(point)
}

/// Number in a property that may be missing.
fn optional(what: &str, value: Option<&JsonValue>) -> Result<Option<f64>, String> {
    let Some(value) = value.filter(|value| !value.is_null()) else { return Ok(None) };
    let found = word(value).unwrap_or_else(|| value.to_string());
    let number = found.trim().parse();
    number.map(Some).map_err(|_| format!("{what} is {:?}, expected a number", excerpt(&found)))
}

/// Value of a property as a string; `None` for null, booleans, lists and objects.
fn word(value: &JsonValue) -> Option<String> {
    match value {
        JsonValue::String(text) => Some(text.clone()),
        JsonValue::Number(number) => Some(number.to_string()),
        _ => None,
    }
}
