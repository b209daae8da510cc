//! Road networks from files: two CSV files, GeoJSON, OpenStreetMap extracts.

mod any;
#[cfg(feature = "csv")]
mod csv;
#[cfg(feature = "geojson")]
mod geojson;
#[cfg(any(feature = "geojson", feature = "osm"))]
mod lines;
mod options;
#[cfg(feature = "osm")]
mod osm;
mod report;
#[cfg(any(feature = "geojson", feature = "osm"))]
mod tags;
mod words;
#[cfg(feature = "geojson")]
mod write;

pub use options::ImportOptions;
pub use report::{ImportNote, ImportReport};
#[cfg(all(feature = "geojson", feature = "matching"))]
pub(crate) use write::line_string;

use std::fs::File;
use std::path::Path;

use super::{MapError, NetworkBuilder, Position, RoadNetwork};

/// Shortest length in metres that an edge gets instead of 0.
const LEAST_METRES: f64 = 0.1;

/// Opens a file. Returns its name for messages, too.
fn open(path: &Path) -> Result<(String, File), MapError> {
    let file = path.display().to_string();
    match File::open(path) {
        Ok(reader) => Ok((file, reader)),
        Err(error) => Err(MapError::Read { file, reason: error.to_string() }),
    }
}

/// Builds and cleans a network, and completes the report.
fn finish(
    builder: NetworkBuilder,
    mut report: ImportReport,
    options: &ImportOptions,
) -> Result<(RoadNetwork, ImportReport), MapError> {
    let network = builder.build()?;
    report.nodes = network.nodes().len();
    report.edges = network.edges().len();
    report.forbidden_turns = network.forbidden_turns().len();
    let (network, cleaning) = network.cleaned(&options.cleaning)?;
    report.cleaning = cleaning;
    Ok((network, report))
}

/// Problem of a position, or nothing for one on Earth.
fn position_problem(position: Position) -> Option<String> {
    let Position { latitude, longitude } = position;
    if latitude.abs() <= 90.0 && longitude.abs() <= 180.0 {
        return None;
    }
    if latitude.abs() > 90.0 && latitude.abs() <= 180.0 && longitude.abs() <= 90.0 {
        return Some(format!(
            "latitude {latitude} and longitude {longitude} seem to be swapped, expected degrees from -90 to 90 for the latitude"
        ));
    }
    let (name, value, limit) = if latitude.abs() <= 90.0 {
        ("longitude", longitude, 180)
    } else {
        ("latitude", latitude, 90)
    };
    Some(format!("{name} is {value}, expected degrees from -{limit} to {limit}"))
}
