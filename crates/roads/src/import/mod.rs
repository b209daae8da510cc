//! Road networks from files: two CSV files, GeoJSON, or OpenStreetMap extracts.

mod any;
#[cfg(feature = "csv")]
mod csv;
mod finish;
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

#[cfg(feature = "geojson")]
pub(crate) use geojson::parse_geojson;
pub use options::ImportOptions;
pub use report::{ImportNote, ImportReport};
#[cfg(feature = "geojson")]
pub(crate) use write::line_string;
