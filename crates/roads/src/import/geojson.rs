//! Networks from GeoJSON and as GeoJSON.
//!
//! GeoJSON has no node ids, so lines meet where they share coordinates, rounded to the seventh
//! decimal of a degree (a centimetre).

use std::collections::HashMap;
use std::fmt::Write;
use std::io::Read;
use std::path::Path;

use geojson::{Error, Feature, GeoJson, GeometryValue, JsonObject, JsonValue};

use super::lines::Lines;
use super::report::{ImportNote, ImportOptions, ImportReport, finish, position_problem};
use super::tags::{RoadTags, class_of, directions, road_of, speed_of};
use crate::network::LONGEST_ROAD;
use crate::{NetworkBuilder, NetworkError, RoadNetwork};
use wayfix::internal::{excerpt, open, shortened, text_of};
use wayfix::map::Position;

/// Largest number of characters of the parser's message, which quotes the text.
const LONGEST_PROBLEM: usize = 300;

impl RoadNetwork {
    /// Reads a network from a GeoJSON file of lines (`LineString`, `MultiLineString`), alone, in
    /// geometry collections, or in features.
    ///
    /// Lines are joined and split where they share a point, to the seventh decimal of a degree;
    /// nodes are numbered from 0 in the order of appearance. Properties of a feature, all optional:
    /// `class` (main, arterial, collector, street, or 3 to 0), or else `highway` and the other tags
    /// of [`from_osm_file`](Self::from_osm_file); `oneway` (yes, no, -1, or a boolean; two-way by
    /// default), `length_m`, `speed_kmh` or `maxspeed`, `junction` (roundabout). A line without
    /// class and highway is a street. O(bytes + edges log).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Line`] with the line where the text is not GeoJSON;
    /// [`NetworkError::Feature`] with the feature for a point not on Earth (with a hint if latitude
    /// and longitude seem swapped) or an invalid property; [`NetworkError::Read`] if the file can't
    /// be read; [`NetworkError::Map`] if no road is left; and those of [`cleaned`](Self::cleaned).
    pub fn from_geojson_file(
        path: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        let (file, reader) = open(path.as_ref())?;
        read(&file, reader, options)
    }

    /// Reads a network from a reader, as [`from_geojson_file`](Self::from_geojson_file) does from a
    /// file; errors call it "features".
    ///
    /// ```
    /// use wayfix_roads::{ImportOptions, RoadNetwork};
    ///
    /// let text = r#"{"type": "FeatureCollection", "features": [
    ///   {"type": "Feature", "properties": {"highway": "primary", "maxspeed": 60}, "geometry":
    ///     {"type": "LineString", "coordinates": [[149.12, -35.28], [149.13, -35.28], [149.14, -35.28]]}},
    ///   {"type": "Feature", "properties": {"class": "street", "oneway": "yes"}, "geometry":
    ///     {"type": "LineString", "coordinates": [[149.13, -35.28], [149.13, -35.27]]}}
    /// ]}"#;
    /// let (network, report) = RoadNetwork::from_geojson(text.as_bytes(), &ImportOptions::default())?;
    /// assert_eq!(report.to_string(), "read 4 nodes, 5 edges");
    /// assert_eq!(network.edges()[0].speed, Some(60.0 / 3.6));
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`from_geojson_file`](Self::from_geojson_file).
    pub fn from_geojson(
        reader: impl Read,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        read("features", reader, options)
    }
}

fn read(
    file: &str,
    reader: impl Read,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let parsed = parse_geojson(file, reader)?;
    let mut roads = Roads {
        lines: Lines { numbered: true, ..Lines::default() },
        keys: HashMap::new(),
        report: ImportReport::default(),
    };
    let none = JsonObject::new();
    let at = |feature, problem| NetworkError::Feature { file: file.to_owned(), feature, problem };
    let mut take = |number: usize, feature: &Feature| {
        let Some(geometry) = &feature.geometry else {
            roads.report.note(ImportNote::OtherGeometry);
            return Ok(());
        };
        let properties = feature.properties.as_ref().unwrap_or(&none);
        let taken = roads.take(&geometry.value, properties, options);
        taken.map_err(|problem| at(number, problem))
    };
    match &parsed {
        GeoJson::Geometry(geometry) => {
            roads.take(&geometry.value, &none, options).map_err(|problem| at(1, problem))?;
        }
        GeoJson::Feature(feature) => take(1, feature)?,
        GeoJson::FeatureCollection(collection) => {
            for (feature, number) in collection.features.iter().zip(1..) {
                take(number, feature)?;
            }
        }
    }
    let Roads { lines, mut report, .. } = roads;
    let mut builder = NetworkBuilder::new();
    lines.split(&mut builder, &mut report)?;
    finish(builder, report, options)
}

/// Parses a file; errors name the line where it is not GeoJSON.
pub(crate) fn parse_geojson(file: &str, reader: impl Read) -> Result<GeoJson, NetworkError> {
    let at = |line, problem| NetworkError::Line { file: file.to_owned(), line, problem };
    text_of(file, reader)?.parse().map_err(|error: Error| match &error {
        Error::MalformedGeoJson(json) => {
            let problem = shortened(&json.to_string(), LONGEST_PROBLEM).into_owned();
            at(json.line().max(1) as u64, problem)
        }
        _ => at(1, shortened(&error.to_string(), LONGEST_PROBLEM).into_owned()),
    })
}

/// Lines read from a file.
struct Roads {
    lines: Lines,
    /// Number of each point, by its rounded coordinates.
    keys: HashMap<[i64; 2], u64>,
    report: ImportReport,
}

impl Roads {
    fn take(
        &mut self,
        value: &GeometryValue,
        properties: &JsonObject,
        options: &ImportOptions,
    ) -> Result<(), String> {
        match value {
            GeometryValue::GeometryCollection { geometries } => geometries
                .iter()
                .try_for_each(|geometry| self.take(&geometry.value, properties, options)),
            GeometryValue::LineString { coordinates } => {
                self.take_line(coordinates, properties, options)
            }
            GeometryValue::MultiLineString { coordinates } => {
                coordinates.iter().try_for_each(|line| self.take_line(line, properties, options))
            }
            _ => {
                self.report.note(ImportNote::OtherGeometry);
                Ok(())
            }
        }
    }

    fn take_line(
        &mut self,
        line: &[geojson::Position],
        properties: &JsonObject,
        options: &ImportOptions,
    ) -> Result<(), String> {
        let words: HashMap<&str, String> =
            properties.iter().filter_map(|(key, value)| Some((&**key, word(value)?))).collect();
        let tag = |name: &str| words.get(name).map(String::as_str);
        let tags = match road(tag, options, &mut self.report)? {
            Ok(tags) => tags,
            Err(note) => {
                self.report.note(note);
                return Ok(());
            }
        };
        let metres = match tag("length_m") {
            None => None,
            Some(text) => match text.parse::<f64>() {
                // As in CSV files, 0 comes from rounding and means unknown.
                Ok(0.0) => {
                    self.report.note(ImportNote::ZeroLength);
                    None
                }
                Ok(metres) if metres > 0.0 && metres <= LONGEST_ROAD => Some(metres),
                _ => {
                    let text = excerpt(text);
                    return Err(format!("length_m is {text:?}, expected metres from 0 to 1e12"));
                }
            },
        };
        let points = line.iter().map(|point| self.point(point.as_slice()));
        let points = points.collect::<Result<Vec<u64>, String>>()?;
        if !self.lines.add(points, tags, metres) {
            self.report.note(ImportNote::NoLine);
        }
        Ok(())
    }

    /// Number of a point, by its rounded coordinates.
    fn point(&mut self, point: &[f64]) -> Result<u64, String> {
        let [longitude, latitude, ..] = *point else {
            return Err(format!("{} coordinates, expected longitude and latitude", point.len()));
        };
        let position = Position { latitude, longitude };
        if let Some(problem) = position_problem(position) {
            return Err(problem);
        }
        // Points are numbered in the order of first use, so the next number is the count of keys.
        let next = self.keys.len() as u64;
        // RFC 7946 has lines cut at the antimeridian: both sides of the cut are one point.
        let east = if longitude == -180.0 { 180.0 } else { longitude };
        let rounded = [latitude, east].map(|degrees| (degrees * 1e7).round() as i64);
        let key = *self.keys.entry(rounded).or_insert(next);
        // A point keeps the first of the positions that round to it.
        self.lines.points.entry(key).or_default().position.get_or_insert(position);
        Ok(key)
    }
}

/// Road with these properties, or the reason why it is skipped. The outer error is an invalid
/// property.
fn road<'a>(
    tag: impl Fn(&str) -> Option<&'a str> + Copy,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Result<RoadTags, ImportNote>, String> {
    // Without `class`, the tags are OpenStreetMap's, but `speed_kmh` still takes precedence.
    if let (None, Some(_)) = (tag("class"), tag("highway")) {
        let own_speed = tag("speed_kmh").and_then(speed_of);
        let road = road_of(tag, options, report);
        if road.is_ok() && tag("speed_kmh").is_some() && own_speed.is_none() {
            report.note(ImportNote::UnknownSpeed);
        }
        return Ok(road.map(|road| RoadTags { speed: own_speed.or(road.speed), ..road }));
    }
    let class = class_of(&excerpt(tag("class").unwrap_or_default()))?;
    let oneway = tag("oneway").unwrap_or_default();
    let [forward, backward] = directions(oneway)
        .ok_or_else(|| format!("oneway is {:?}, expected yes, no or -1", excerpt(oneway)))?;
    let given = tag("speed_kmh").or(tag("maxspeed"));
    let speed = given.and_then(speed_of);
    if given.is_some() && speed.is_none() {
        report.note(ImportNote::UnknownSpeed);
    }
    let roundabout = matches!(tag("junction"), Some("roundabout" | "circular"));
    Ok(Ok(RoadTags { class, forward, backward, speed, roundabout }))
}

/// Value of a property as a string; `None` for null, lists and objects.
fn word(value: &JsonValue) -> Option<String> {
    match value {
        JsonValue::String(text) => Some(text.clone()),
        JsonValue::Number(number) => Some(number.to_string()),
        JsonValue::Bool(truth) => Some(truth.to_string()),
        _ => None,
    }
}

/// GeoJSON geometry of the line through positions.
pub(crate) fn line_string(points: impl IntoIterator<Item = Position>) -> String {
    let pair = |point: Position| format!("[{},{}]", point.longitude, point.latitude);
    let pairs: Vec<String> = points.into_iter().map(pair).collect();
    format!(r#"{{"type":"LineString","coordinates":[{}]}}"#, pairs.join(","))
}

impl RoadNetwork {
    /// Returns the network as GeoJSON text: a collection with one line per edge, or per two
    /// directions that share a line, with its `class`, `oneway`, `length_m`, and, if known,
    /// `speed_kmh` and `junction`.
    ///
    /// [`from_geojson`](Self::from_geojson) reads back all edges with their lengths, split where
    /// others meet them. The text has no node ids and no forbidden turns, and nodes at the same
    /// place are read as one.
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{Position, RoadClass};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// builder.node(1, Position { latitude: 0.0, longitude: 0.5 })?;
    /// builder.node(2, Position { latitude: 0.0, longitude: 0.75 })?;
    /// builder.both_ways(1, 2, RoadClass::Main)?;
    /// let text = builder.build()?.to_geojson();
    /// assert!(text.contains(r#""oneway":"no""#));
    /// assert!(text.contains(r#"{"type":"LineString","coordinates":[[0.5,0],[0.75,0]]}"#));
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    #[must_use]
    pub fn to_geojson(&self) -> String {
        let mut text = String::from(r#"{"type":"FeatureCollection","features":["#);
        let mut separator = "\n";
        for (e, edge) in self.edges().iter().enumerate() {
            let back = self.reverse(e).filter(|&back| self.is_same_road(e, back));
            if back.is_some_and(|back| back < e) {
                continue;
            }
            let oneway = if back.is_some() { "no" } else { "yes" };
            text += separator;
            separator = ",\n";
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                r#"{{"type":"Feature","properties":{{"class":"{}","oneway":"{oneway}","length_m":{}"#,
                edge.class, edge.metres
            );
            if let Some(speed) = edge.speed {
                let _ = write!(text, r#","speed_kmh":{}"#, speed * 3.6);
            }
            if edge.roundabout {
                text += r#","junction":"roundabout""#;
            }
            let line = line_string(self.shape(e).iter().copied());
            let _ = write!(text, r#"}},"geometry":{line}}}"#);
        }
        text + "\n]}\n"
    }

    /// True if two edges are the directions of one road, with the same line and the same numbers.
    fn is_same_road(&self, edge: usize, back: usize) -> bool {
        let [a, b] = [edge, back].map(|e| self.edges()[e]);
        (a.class, a.metres, a.speed, a.roundabout) == (b.class, b.metres, b.speed, b.roundabout)
            && self.shape(edge).iter().eq(self.shape(back).iter().rev())
    }
}
