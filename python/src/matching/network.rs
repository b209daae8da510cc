//! The class `RoadNetwork`: made from frames, files or GeoJSON, and read as columns.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use wayfix::map::Position;
use wayfix_roads::{Cleaning, ImportOptions, ImportReport, NetworkError, RoadNetwork};

use super::stored::Stored;
use crate::error::invalid;
use crate::typed::{Size, index};
use crate::watch::in_background;

/// Directed road network.
///
/// Can be copied and pickled.
///
/// Parameters
/// ----------
/// nodes : data frame or dict of arrays
///     Columns `node` (an integer), `lat`, `lon` in degrees.
/// edges : data frame or dict of arrays
///     Columns `from`, `to`, and optionally `class` (main, arterial, collector, street, or 3 to 0),
///     `length_m` (by default the straight distance), `speed_kmh`, and `oneway` (yes, no, -1, or a
///     truth value). Without `oneway`, edges lead in one direction; with it, those with no lead in
///     both.
/// service_roads, parking_aisles, tracks, private_roads : bool
///     Kinds of roads to import from files that tell them apart.
/// cleaning : list
///     Operations after the import: "largest_component", "dead_ends", "contraction",
///     ("merging", metres), ("within", (lat, lon), (lat, lon)).
///
/// Attributes
/// ----------
/// report : str
///     Counts of what was imported, skipped and replaced, and unknown columns.
///
/// Examples
/// --------
/// >>> from wayfix.matching import RoadNetwork
/// >>> nodes = {"node": [1, 2, 3], "lat": [-35.28, -35.28, -35.277], "lon": [149.13, 149.134, 149.134]}
/// >>> edges = {"from": [1, 2], "to": [2, 3], "oneway": ["no", "yes"]}
/// >>> network = RoadNetwork(nodes, edges)
/// >>> network
/// <RoadNetwork: 3 nodes, 3 edges>
/// >>> network.edges["length_m"].round().tolist()
/// [363.0, 363.0, 334.0]
#[pyclass(name = "RoadNetwork", module = "wayfix.matching", frozen)]
#[derive(Debug)]
pub(crate) struct PyRoadNetwork {
    pub(super) network: Arc<RoadNetwork>,
    #[pyo3(get)]
    report: String,
}

/// Operation after an import, as Python gives it: a name, or a tuple of a name and its arguments.
#[derive(Debug, FromPyObject)]
enum Operation {
    #[pyo3(transparent)]
    Named(String),
    #[pyo3(transparent)]
    Merging((String, f64)),
    #[pyo3(transparent)]
    Within((String, (f64, f64), (f64, f64))),
}

impl Operation {
    fn cleaning(self) -> PyResult<Cleaning> {
        let position = |(latitude, longitude)| Position { latitude, longitude };
        Ok(match self {
            Self::Named(name) if name == "largest_component" => Cleaning::LargestComponent,
            Self::Named(name) if name == "dead_ends" => Cleaning::DeadEnds,
            Self::Named(name) if name == "contraction" => Cleaning::Contraction,
            Self::Merging((name, metres)) if name == "merging" => Cleaning::Merging { metres },
            Self::Within((name, a, b)) if name == "within" => {
                Cleaning::Within([position(a), position(b)])
            }
            Self::Named(name) | Self::Merging((name, _)) | Self::Within((name, ..)) => {
                return Err(invalid(format!(
                    "cleaning has {name:?}, expected 'largest_component', 'dead_ends', \
                     'contraction', ('merging', metres) or ('within', (lat, lon), (lat, lon))"
                )));
            }
        })
    }
}

fn options(
    [service_roads, parking_aisles, tracks, private_roads]: [bool; 4],
    cleaning: Vec<Operation>,
) -> PyResult<ImportOptions> {
    let cleaning = cleaning.into_iter().map(Operation::cleaning).collect::<PyResult<_>>()?;
    Ok(ImportOptions::default()
        .with_service_roads(service_roads)
        .with_parking_aisles(parking_aisles)
        .with_tracks(tracks)
        .with_private_roads(private_roads)
        .with_cleaning(cleaning))
}

impl PyRoadNetwork {
    fn imported(
        py: Python<'_>,
        import: impl FnOnce() -> Result<(RoadNetwork, ImportReport), NetworkError> + Send + 'static,
    ) -> PyResult<Self> {
        // An import is a single call, which cannot look for signals on the way.
        let imported = in_background(py, move |_| import())?;
        let (network, report) = imported.map_err(invalid)?;
        Ok(Self { network: Arc::new(network), report: report.to_string() })
    }

    fn check_edge(&self, edge: usize) -> PyResult<usize> {
        let edges = self.network.edges().len();
        // Checked here, since the library panics for an edge that does not exist.
        if edge < edges {
            return Ok(edge);
        }
        Err(invalid(format!("there is no edge {edge}, expected a number below {edges}")))
    }

    fn column<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        of: impl Fn(&wayfix_roads::Edge) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        PyArray1::from_vec(py, self.network.edges().iter().map(of).collect())
    }
}

#[pymethods]
impl PyRoadNetwork {
    #[new]
    #[pyo3(signature = (nodes, edges, *, cleaning=vec![]))]
    fn new(
        py: Python<'_>,
        nodes: &Bound<'_, PyAny>,
        edges: &Bound<'_, PyAny>,
        cleaning: Vec<Operation>,
    ) -> PyResult<Self> {
        // Frames do not tell kinds of roads apart, so none is left out.
        let options = options([true; 4], cleaning)?;
        // The texts of two CSV files, so that one reader serves frames and files.
        let texts = py.import("wayfix._frames")?.call_method1("network_texts", (nodes, edges))?;
        let (nodes, edges): (String, String) = texts.extract()?;
        Self::imported(py, move || {
            let read = RoadNetwork::from_csv(nodes.as_bytes(), edges.as_bytes(), &options);
            read.map_err(in_frame)
        })
    }

    /// Reads a network from a path: a folder with `nodes.csv` and `edges.csv`, GeoJSON
    /// (`.geojson`, `.json`), or an OpenStreetMap extract (`.osm.pbf`).
    #[staticmethod]
    #[expect(clippy::fn_params_excessive_bools, reason = "each is a kind of road, by name")]
    #[pyo3(signature = (path, *, service_roads=true, parking_aisles=true, tracks=false,
                        private_roads=false, cleaning=vec![]))]
    fn from_path(
        py: Python<'_>,
        path: PathBuf,
        service_roads: bool,
        parking_aisles: bool,
        tracks: bool,
        private_roads: bool,
        cleaning: Vec<Operation>,
    ) -> PyResult<Self> {
        let kinds = [service_roads, parking_aisles, tracks, private_roads];
        let options = options(kinds, cleaning)?;
        Self::imported(py, move || RoadNetwork::from_path(path, &options))
    }

    /// Reads a network from GeoJSON: text, bytes, or an object with `__geo_interface__`, such as a
    /// GeoDataFrame in degrees. Lines are joined where they share a point.
    #[staticmethod]
    #[expect(clippy::fn_params_excessive_bools, reason = "each is a kind of road, by name")]
    #[pyo3(signature = (features, *, service_roads=true, parking_aisles=true, tracks=false,
                        private_roads=false, cleaning=vec![]))]
    fn from_geojson(
        py: Python<'_>,
        features: &Bound<'_, PyAny>,
        service_roads: bool,
        parking_aisles: bool,
        tracks: bool,
        private_roads: bool,
        cleaning: Vec<Operation>,
    ) -> PyResult<Self> {
        let kinds = [service_roads, parking_aisles, tracks, private_roads];
        let options = options(kinds, cleaning)?;
        // Text and bytes are read as they are; other objects are written as JSON by Python.
        let text: Vec<u8> = if let Ok(text) = features.extract::<String>() {
            text.into_bytes()
        } else if let Ok(bytes) = features.extract::<Vec<u8>>() {
            bytes
        } else if features.hasattr("__geo_interface__")? {
            let value = features.getattr("__geo_interface__")?;
            py.import("json")?.call_method1("dumps", (value,))?.extract::<String>()?.into_bytes()
        } else {
            return Err(invalid("expected GeoJSON as text, or an object with __geo_interface__"));
        };
        Self::imported(py, move || RoadNetwork::from_geojson(&text[..], &options))
    }

    /// Nodes: a dictionary with the arrays `node` (ids), `lat` and `lon`.
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let nodes = self.network.nodes();
        let columns = PyDict::new(py);
        let numbers = |of: fn(&Position) -> f64| -> Vec<f64> {
            nodes.iter().map(|node| of(&node.position)).collect()
        };
        let ids: Vec<u64> = nodes.iter().map(|node| node.id).collect();
        columns.set_item("node", ids.to_pyarray(py))?;
        columns.set_item("lat", numbers(|position| position.latitude).to_pyarray(py))?;
        columns.set_item("lon", numbers(|position| position.longitude).to_pyarray(py))?;
        Ok(columns)
    }

    /// Directed edges, in the order of their numbers: a dictionary with the arrays `from`, `to`
    /// (ids of nodes), `class`, `length_m`, `speed_kmh` (NaN if unknown), `roundabout`, and
    /// `reverse`, the number of the same road in the other direction, or -1.
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let network = &self.network;
        let id = |node: usize| network.nodes()[node].id;
        let columns = PyDict::new(py);
        columns.set_item("from", self.column(py, |edge| id(edge.from)))?;
        columns.set_item("to", self.column(py, |edge| id(edge.to)))?;
        let classes: Vec<String> =
            network.edges().iter().map(|edge| edge.class.to_string()).collect();
        // "collector", the longest class, has nine letters.
        columns.set_item("class", py.import("numpy")?.call_method1("array", (classes, "U9"))?)?;
        columns.set_item("length_m", self.column(py, |edge| edge.metres))?;
        // Metres per second to kilometres per hour.
        let speed = |edge: &wayfix_roads::Edge| edge.speed.map_or(f64::NAN, |speed| 3.6 * speed);
        columns.set_item("speed_kmh", self.column(py, speed))?;
        columns.set_item("roundabout", self.column(py, |edge| edge.roundabout))?;
        let reverse: Vec<i64> =
            (0..network.edges().len()).map(|edge| index(network.reverse(edge))).collect();
        columns.set_item("reverse", reverse.to_pyarray(py))?;
        Ok(columns)
    }

    /// Returns the number of the shortest edge from one node to another, given by id, or None.
    #[pyo3(signature = (start, end, /))]
    fn edge_between(&self, start: Size, end: Size) -> Option<usize> {
        let [start, end] = [start, end].map(|id| self.network.index_of_id(id.0 as u64));
        self.network.edge_between(start?, end?)
    }

    /// Returns the line of an edge, given by number: latitudes and longitudes, shape (points, 2).
    fn shape<'py>(&self, py: Python<'py>, edge: Size) -> PyResult<Bound<'py, PyArray2<f64>>> {
        line(py, self.network.shape(self.check_edge(edge.0)?))
    }

    /// Returns the network as GeoJSON, without the ids of nodes and forbidden turns.
    fn to_geojson(&self, py: Python<'_>) -> String {
        py.detach(|| self.network.to_geojson())
    }

    fn __copy__(&self) -> Self {
        Self { network: Arc::clone(&self.network), report: self.report.clone() }
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__()
    }

    /// Pickles nodes, edges and forbidden turns (as JSON), and the report.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>, String))> {
        let bytes = py.detach(|| serde_json::to_vec(&Stored::of(&self.network)));
        let bytes = PyBytes::new(py, &bytes.map_err(invalid)?);
        Ok((py.get_type::<Self>().getattr("_from_bytes")?, (bytes, self.report.clone())))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_bytes(py: Python<'_>, bytes: &[u8], report: String) -> PyResult<Self> {
        // Built by the library's own builder, which checks the network: a pickle may be of any
        // origin.
        let made = py.detach(|| {
            let stored = serde_json::from_slice::<Stored>(bytes).map_err(|e| e.to_string())?;
            stored.network()
        });
        let network = made.map_err(|error| invalid(format!("a stored network: {error}")))?;
        Ok(Self { network: Arc::new(network), report })
    }

    fn __repr__(&self) -> String {
        let (nodes, edges) = (self.network.nodes().len(), self.network.edges().len());
        format!("<RoadNetwork: {nodes} nodes, {edges} edges>")
    }
}

/// Makes an error name the row of a frame rather than the line of its text.
fn in_frame(error: NetworkError) -> NetworkError {
    match error {
        // Line 1 is the header, so row 0 is in line 2.
        NetworkError::Line { file, line: line @ 2.., problem } => {
            NetworkError::Read { file: format!("row {} of {file}", line - 2), reason: problem }
        }
        other => other,
    }
}

/// Returns positions as an array with a row of latitude and longitude for each.
pub(super) fn line<'py>(py: Python<'py>, line: &[Position]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let values = line.iter().flat_map(|point| [point.latitude, point.longitude]).collect();
    PyArray1::from_vec(py, values).reshape([line.len(), 2])
}
