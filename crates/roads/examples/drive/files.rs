//! Files of answers: routes as CSV and GeoJSON, points as CSV.

use std::fs::File;
use std::io::{BufWriter, Error, Write};
use std::path::Path;

use serde_json::json;
use wayfix_roads::matching::{AnswerWriter, MatchedDrive, Matcher};

use super::roads::certainty::probabilities;
use super::roads::{cannot_write, line_between};

/// Lines of a drive for each file, without headers: made by the threads, so that only writing is in
/// order.
pub(crate) struct Lines([Vec<u8>; 3]);

impl Lines {
    pub(crate) fn of(
        name: &str,
        matcher: &Matcher,
        drive: &MatchedDrive,
        late: usize,
    ) -> Result<Self, csv::Error> {
        let mut route = Vec::new();
        AnswerWriter::routes(&mut route).write(name, matcher, drive)?;
        let mut points = Vec::new();
        AnswerWriter::points(&mut points, late).write(name, matcher, drive)?;
        let features = features(name, matcher, drive).into_bytes();
        Ok(Self([route, points, features]))
    }
}

/// GeoJSON features of the parts of a route, one per line, each ending with a comma.
fn features(name: &str, matcher: &Matcher, drive: &MatchedDrive) -> String {
    let network = matcher.network();
    let mut text = String::new();
    // Seven decimals of a degree are a centimetre, one of a metre is a decimetre.
    let rounded = |value: f64, unit: f64| (value * unit).round() / unit;
    for (seq, (stretch, p)) in drive.route().iter().zip(probabilities(drive)).enumerate() {
        let line = match stretch.edge {
            Some(edge) => line_between(network, edge, stretch.enter, stretch.exit),
            None => stretch.ends.to_vec(),
        };
        let pair =
            |p: &wayfix::map::Position| [rounded(p.longitude, 1e7), rounded(p.latitude, 1e7)];
        let line: Vec<[f64; 2]> = line.iter().map(pair).collect();
        let id = |node: usize| network.nodes()[node].id;
        let edge = stretch.edge.map(|edge| network.edges()[edge]);
        let feature = json!({
            "type": "Feature",
            "properties": {
                "trace": name,
                "seq": seq,
                "from": edge.map(|edge| id(edge.from)),
                "to": edge.map(|edge| id(edge.to)),
                "enter_m": rounded(stretch.enter, 10.0),
                "exit_m": rounded(stretch.exit, 10.0),
                "off_road": edge.is_none(),
                "probability": rounded(p, 1e4),
            },
            "geometry": { "type": "LineString", "coordinates": line },
        });
        text += &format!("{feature},\n");
    }
    text
}

/// Output files, in the order of the lines.
pub(crate) struct Output {
    files: [BufWriter<File>; 3],
    is_empty: bool,
}

impl Output {
    pub(crate) fn create(out: &Path) -> Result<Self, String> {
        let create = |name: &str| match File::create(out.join(name)) {
            Ok(file) => Ok(BufWriter::new(file)),
            Err(error) => Err(cannot_write(&out.join(name), error)),
        };
        let mut files = [create("route.csv")?, create("points.csv")?, create("route.geojson")?];
        let [route, points, features] = &mut files;
        let failed = |error| cannot_write(out, error);
        AnswerWriter::routes(route).with_header().map_err(|error| cannot_write(out, error))?;
        // The lag is of no matter to a header.
        AnswerWriter::points(points, 0).with_header().map_err(|error| cannot_write(out, error))?;
        features.write_all(b"{\"type\":\"FeatureCollection\",\"features\":[\n").map_err(failed)?;
        Ok(Self { files, is_empty: true })
    }

    pub(crate) fn write(&mut self, Lines(lines): &Lines) -> Result<(), Error> {
        for (file, lines) in self.files[..2].iter_mut().zip(lines) {
            file.write_all(lines)?;
        }
        // JSON has no comma after the last feature, so the comma is written before each drive but
        // the first.
        if let Some(features) = lines[2].strip_suffix(b",\n") {
            let features_file = &mut self.files[2];
            if !self.is_empty {
                features_file.write_all(b",\n")?;
            }
            features_file.write_all(features)?;
            self.is_empty = false;
        }
        Ok(())
    }

    pub(crate) fn finish(mut self) -> Result<(), Error> {
        self.files[2].write_all(b"\n]}\n")?;
        self.files.iter_mut().try_for_each(Write::flush)
    }
}
