//! Networks from whatever a path leads to.

use std::path::Path;

use super::{ImportOptions, ImportReport};
use crate::map::{MapError, RoadNetwork};

impl RoadNetwork {
    /// Reads a network from a path: a folder with `nodes.csv` and `edges.csv` or with
    /// `places.csv` and `roads.csv`, a GeoJSON file (`.geojson`, `.json`), or an OpenStreetMap
    /// extract (`.osm.pbf`, `.pbf`).
    ///
    /// ```no_run
    /// use wayfix::map::{Cleaning, ImportOptions, RoadNetwork};
    ///
    /// let cleaning = Cleaning { largest_component: true, contract: true, ..Cleaning::default() };
    /// let options = ImportOptions { cleaning, ..ImportOptions::default() };
    /// let (network, report) = RoadNetwork::from_path("city.osm.pbf", &options)?;
    /// println!("{report}");
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MapError::Read`] for another path, or a format whose feature (`csv`, `geojson`, `osm`) is
    /// not enabled; otherwise as the function for the format.
    pub fn from_path(
        path: impl AsRef<Path>,
        options: &ImportOptions,
    ) -> Result<(Self, ImportReport), MapError> {
        let path = path.as_ref();
        let cannot =
            |reason: String| Err(MapError::Read { file: path.display().to_string(), reason });
        if path.is_dir() {
            let pairs = [["nodes.csv", "edges.csv"], ["places.csv", "roads.csv"]];
            let pairs = pairs.map(|pair| pair.map(|name| path.join(name)));
            return match pairs.iter().find(|pair| pair.iter().all(|file| file.is_file())) {
                Some([nodes, edges]) => csv(nodes, edges, options),
                None => cannot(String::from(
                    "the folder needs nodes.csv and edges.csv, or places.csv and roads.csv",
                )),
            };
        }
        match path.extension().and_then(|end| end.to_str()) {
            Some("geojson" | "json") => geojson(path, options),
            Some("pbf") => osm(path, options),
            _ => cannot(String::from(
                "expected a folder with nodes.csv and edges.csv, a .geojson, or a .osm.pbf",
            )),
        }
    }
}

type Read = Result<(RoadNetwork, ImportReport), MapError>;

#[cfg(feature = "csv")]
fn csv(nodes: &Path, edges: &Path, options: &ImportOptions) -> Read {
    RoadNetwork::from_csv_files(nodes, edges, options)
}

#[cfg(not(feature = "csv"))]
fn csv(nodes: &Path, _: &Path, _: &ImportOptions) -> Read {
    needs("csv", nodes)
}

#[cfg(feature = "geojson")]
fn geojson(path: &Path, options: &ImportOptions) -> Read {
    RoadNetwork::from_geojson_file(path, options)
}

#[cfg(not(feature = "geojson"))]
fn geojson(path: &Path, _: &ImportOptions) -> Read {
    needs("geojson", path)
}

#[cfg(feature = "osm")]
fn osm(path: &Path, options: &ImportOptions) -> Read {
    RoadNetwork::from_osm_file(path, options)
}

#[cfg(not(feature = "osm"))]
fn osm(path: &Path, _: &ImportOptions) -> Read {
    needs("osm", path)
}

/// Error for a format that was left out.
#[cfg(not(all(feature = "csv", feature = "geojson", feature = "osm")))]
fn needs(feature: &str, path: &Path) -> Read {
    let reason = format!("this format needs the feature `{feature}`");
    Err(MapError::Read { file: path.display().to_string(), reason })
}
