//! Road networks from files: two CSV files, GeoJSON, or OpenStreetMap extracts, in the format that
//! the path suggests.

#[cfg(feature = "csv")]
mod csv;
#[cfg(feature = "geojson")]
mod geojson;
#[cfg(any(feature = "geojson", feature = "osm"))]
mod lines;
#[cfg(feature = "osm")]
mod osm;
mod report;
mod tags;

use std::path::Path;

use crate::{NetworkError, RoadNetwork};
#[cfg(feature = "geojson")]
pub(crate) use geojson::line_string;
#[cfg(feature = "geojson")]
pub(crate) use geojson::parse_geojson;
pub use report::{ImportNote, ImportOptions, ImportReport};

impl RoadNetwork {
    /// Reads a network from a path: a folder with `nodes.csv` and `edges.csv` or with
    /// `places.csv` and `roads.csv`, a GeoJSON file (`.geojson`, `.json`), or an OpenStreetMap
    /// extract (`.osm.pbf`, `.pbf`).
    ///
    /// ```no_run
    /// use wayfix_roads::{Cleaning, ImportOptions, RoadNetwork};
    ///
    /// let cleaning = vec![Cleaning::LargestComponent, Cleaning::Contraction];
    /// let options = ImportOptions::default().with_cleaning(cleaning);
    /// let (network, report) = RoadNetwork::from_path("city.osm.pbf", &options)?;
    /// println!("{report}");
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`NetworkError::Read`] for any other path and for a format whose feature (`csv`, `geojson`,
    /// `osm`) is not enabled; otherwise those of the function for the format.
    pub fn from_path(
        path: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), NetworkError> {
        let path = path.as_ref();
        let cannot = |reason: &str| {
            Err(NetworkError::Read { file: path.display().to_string(), reason: reason.to_owned() })
        };
        if path.is_dir() {
            let pairs = [["nodes.csv", "edges.csv"], ["places.csv", "roads.csv"]];
            let pairs = pairs.map(|pair| pair.map(|name| path.join(name)));
            return match pairs.iter().find(|pair| pair.iter().all(|file| file.is_file())) {
                #[cfg(feature = "csv")]
                Some([nodes, edges]) => Self::from_csv_files(nodes, edges, options),
                #[cfg(not(feature = "csv"))]
                Some([nodes, _]) => needs("csv", nodes),
                None => {
                    cannot("the folder needs nodes.csv and edges.csv, or places.csv and roads.csv")
                }
            };
        }
        match path.extension().and_then(|end| end.to_str()) {
            #[cfg(feature = "geojson")]
            Some("geojson" | "json") => Self::from_geojson_file(path, options),
            #[cfg(not(feature = "geojson"))]
            Some("geojson" | "json") => needs("geojson", path),
            #[cfg(feature = "osm")]
            Some("pbf") => Self::from_osm_file(path, options),
            #[cfg(not(feature = "osm"))]
            Some("pbf") => needs("osm", path),
            _ => {
                cannot("expected a folder with nodes.csv and edges.csv, a .geojson, or a .osm.pbf")
            }
        }
    }
}

/// Error for a format whose feature is not enabled.
#[cfg(not(all(feature = "csv", feature = "geojson", feature = "osm")))]
fn needs(feature: &str, path: &Path) -> Result<(RoadNetwork, ImportReport), NetworkError> {
    let reason = format!("this format needs the feature `{feature}`");
    Err(NetworkError::Read { file: path.display().to_string(), reason })
}
