//! The class `Matcher`: roads and a model, which match one drive, many, or a live vehicle.
//!
//! Whole drives are matched on another thread (`in_background`), since the library takes all of
//! their points at once and cannot look for Ctrl-C in between.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use numpy::ToPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix_roads::matching::{MatchModel, Matcher, TracePoint};

use super::points::{Columns, moment, point};
use super::trips::{Drives, Estimator};
use super::{PyLearnedMatchModel, PyMatchedDrive, PyRoadNetwork, PyVehicle};
use crate::error::{invalid, of_drive};
use crate::options::{replaced, to_python};
use crate::typed::{Size, threads};
use crate::watch::{Watch, in_background, in_background_with};

/// Matcher of vehicles' positions to the roads of a network.
///
/// Can be copied and pickled, with its network.
///
/// Points are a data frame (pandas, polars, pyarrow, anything with `__arrow_c_stream__`) or a
/// dictionary of arrays, with the columns `time` (seconds, or dates), `lat` and `lon` (degrees),
/// and optionally `accuracy` (standard deviation in each direction, in metres; phones often report
/// the radius that holds 68%, which is 1.5 times as much), `heading` (degrees clockwise from north)
/// and `speed` (metres per second), with NaN for unknown values.
///
/// Parameters
/// ----------
/// network : RoadNetwork
///     The roads.
/// **model
///     Parameters of the model by name; the attribute `model` lists them all. The most important
///     one is `noise`, the standard deviation of a position in each direction in metres (4): learn
///     it if your receivers differ.
///
/// Examples
/// --------
/// Two streets 55 m apart, joined at both ends, and four points on the southern one:
///
/// >>> import numpy as np
/// >>> from wayfix.matching import Matcher, RoadNetwork
/// >>> nodes = {"node": [1, 2, 3, 4], "lat": [-35.28, -35.28, -35.2805, -35.2805],
/// ...          "lon": [149.13, 149.14, 149.13, 149.14]}
/// >>> edges = {"from": [1, 3, 1, 2], "to": [2, 4, 3, 4], "oneway": ["no"] * 4}
/// >>> matcher = Matcher(RoadNetwork(nodes, edges))
/// >>> points = {"time": [0, 10, 20, 30], "lat": -35.2805 + np.array([5e-5, 1e-4, -5e-5, 0]),
/// ...           "lon": 149.131 + 0.001 * np.arange(4)}
/// >>> drive = matcher.match_drive(points)
/// >>> roads = drive.smoothed()
/// >>> matcher.network.edge_between(3, 4), roads.edge
/// (5, array([5, 5, 5, 5]))
/// >>> bool(roads.probability.min() > 0.9)
/// True
///
/// The same live, point by point:
///
/// >>> vehicle = matcher.start(0, -35.28045, 149.131)
/// >>> surprise = -vehicle.step(10, -35.2804, 149.132)
/// >>> vehicle.live.edge
/// 5
#[pyclass(name = "Matcher", module = "wayfix.matching", frozen)]
#[derive(Debug)]
pub(crate) struct PyMatcher {
    pub(super) matcher: Arc<Matcher>,
    network: Py<PyRoadNetwork>,
}

fn model(before: MatchModel, given: Option<&Bound<'_, PyDict>>) -> PyResult<MatchModel> {
    replaced(&before, given, |_| Ok(()))
}

#[pymethods]
impl PyMatcher {
    #[new]
    #[pyo3(signature = (network, **model))]
    fn new(
        network: &Bound<'_, PyRoadNetwork>,
        model: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let model = self::model(MatchModel::default(), model)?;
        let roads = Arc::clone(&network.get().network);
        let made = in_background(network.py(), move |_| {
            // A matcher owns its roads, and Python's network stays in use. The copy is made here,
            // without the global lock.
            Matcher::new(roads.as_ref().clone()).with_model(model)
        })?;
        let matcher = Arc::new(made.map_err(invalid)?);
        Ok(Self { matcher, network: network.clone().unbind() })
    }

    /// The roads.
    #[getter]
    fn network(&self, py: Python<'_>) -> Py<PyRoadNetwork> {
        self.network.clone_ref(py)
    }

    /// Parameters of the model, as a dictionary.
    #[getter]
    fn model<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, self.matcher.model())
    }

    /// Returns a matcher with some parameters of the model replaced.
    #[pyo3(signature = (**model))]
    fn with_model(&self, py: Python<'_>, model: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let model = self::model(*self.matcher.model(), model)?;
        // A copy without any search or index to build, so Ctrl-C can wait for it.
        let matcher = py.detach(|| self.matcher.as_ref().clone().with_model(model));
        let matcher = Arc::new(matcher.map_err(invalid)?);
        Ok(Self { matcher, network: self.network.clone_ref(py) })
    }

    /// Matches a whole drive, with ascending times.
    fn match_drive(this: &Bound<'_, Self>, points: &Bound<'_, PyAny>) -> PyResult<PyMatchedDrive> {
        let points = Columns::read(points)?.points()?;
        let matcher = Arc::clone(&this.get().matcher);
        let drive = in_background(this.py(), move |_| matcher.match_drive(&points))?;
        let drive = drive.map_err(|error| of_drive(this.py(), &error))?;
        Ok(PyMatchedDrive::new(this, drive))
    }

    /// Matches the drives of a data frame or a dictionary of arrays with a column that names the
    /// trip. Rows may be in any order; among rows of one trip with the same time, the first counts.
    ///
    /// Parameters
    /// ----------
    /// points : data frame or dict of arrays
    ///     As for all methods.
    /// trip : str, optional
    ///     Name of the column with the trip of each row; without it, all rows are one trip.
    /// estimator : {"smoothed", "live", "late"}
    ///     Answers given all points of a trip, given the points up to each, or given `lag` more.
    /// lag : int, optional
    ///     Number of points that late answers wait for; required for these.
    /// errors : {"raise", "skip"}
    ///     For trips that cannot be matched, for example with a point that is not on Earth: raise
    ///     an exception, or give no answers and add an entry to `failed`.
    /// n_jobs, progress
    ///     As for `Hmm.score_all`, counting trips.
    ///
    /// Returns
    /// -------
    /// MatchedTrips
    ///     Its `points()` and `routes()` are data frames of the kind that was given.
    #[pyo3(signature = (points, trip=None, *, estimator="smoothed", lag=None, errors="raise",
                        n_jobs=1, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "options, by name")]
    fn match_trips<'py>(
        this: &Bound<'py, Self>,
        points: &Bound<'py, PyAny>,
        trip: Option<&str>,
        estimator: &str,
        lag: Option<&Bound<'py, PyAny>>,
        errors: &str,
        n_jobs: isize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        // Frames are sorted and put together in Python, which comes back to `_match`.
        let trips = this.py().import("wayfix._trips")?;
        let threads = (n_jobs, progress);
        trips.call_method1("match_trips", (this, points, trip, estimator, lag, errors, threads))
    }

    /// Matches sorted points, split into drives at the offsets.
    #[expect(clippy::too_many_arguments, reason = "those of `match_trips`")]
    fn _match<'py>(
        &self,
        py: Python<'py>,
        columns: Columns<'py>,
        offsets: Vec<usize>,
        estimator: &str,
        lag: Option<Size>,
        skip: bool,
        n_jobs: isize,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let estimator = Estimator::of(estimator, lag.map(|lag| lag.0))?;
        // Drives are counted by the threads that match, and reported by this one, which has the
        // global lock.
        let (count, done) = (offsets.len().saturating_sub(1), Arc::new(AtomicUsize::new(0)));
        // `order_of` in `_trips` made the offsets: they ascend, up to the number of rows, so
        // `match_all` may slice by them.
        let drives = Drives { points: columns.points()?, offsets, estimator, skip };
        let (matcher, told) = (Arc::clone(&self.matcher), Arc::clone(&done));
        let jobs = threads(n_jobs)?;
        let work = move |watch: &Watch| drives.match_all(&matcher, jobs, watch, &told);
        let report = || {
            let Some(call) = &progress else { return Ok(()) };
            call.call1((done.load(Ordering::Relaxed), count)).map(|_| ())
        };
        let found = in_background_with(py, work, report)?;
        // Once more: the last drives ended after the last report.
        report()?;
        found.into_python(py)
    }

    /// Learns the model from drives without labels. Takes about `iterations` times as long as
    /// matching, and as much again to test the gain on held-out drives.
    ///
    /// Parameters
    /// ----------
    /// points, trip
    ///     As for `match_trips`.
    /// iterations : int
    ///     Largest number of iterations (15).
    #[pyo3(signature = (points, trip=None, *, iterations=Size(15)))]
    fn learn(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        trip: Option<&str>,
        iterations: Size,
    ) -> PyResult<PyLearnedMatchModel> {
        let sorted = py.import("wayfix._trips")?.call_method1("sorted_trips", (points, trip))?;
        let (columns, offsets): (Columns<'_>, Vec<usize>) = sorted.extract()?;
        let points = columns.points()?;
        let matcher = Arc::clone(&self.matcher);
        let learned = in_background(py, move |_| {
            let drives: Vec<&[TracePoint]> =
                offsets.windows(2).map(|ends| &points[ends[0]..ends[1]]).collect();
            matcher.learn(&drives, iterations.0)
        })?;
        PyLearnedMatchModel::new(py, learned.map_err(|error| of_drive(py, &error))?)
    }

    /// Starts a vehicle at the first point of its drive. It keeps `lag` points (0) before the last
    /// one, for late answers. `time` is in seconds, or a date.
    #[pyo3(signature = (time, lat, lon, *, lag=Size(0), accuracy=f64::NAN, heading=f64::NAN, speed=f64::NAN))]
    #[expect(clippy::too_many_arguments, reason = "those of a point, by name")]
    fn start(
        this: &Bound<'_, Self>,
        time: &Bound<'_, PyAny>,
        lat: f64,
        lon: f64,
        lag: Size,
        accuracy: f64,
        heading: f64,
        speed: f64,
    ) -> PyResult<PyVehicle> {
        let point = point(moment(time)?, [lat, lon], [accuracy, heading, speed]);
        let vehicle = this.get().matcher.start(&point, lag.0);
        let vehicle = vehicle.map_err(|error| of_drive(this.py(), &error))?;
        Ok(PyVehicle::new(this, vehicle))
    }

    /// Returns a vehicle with the state that `Vehicle.to_bytes` returned.
    fn vehicle_from_bytes(this: &Bound<'_, Self>, bytes: &[u8]) -> PyResult<PyVehicle> {
        PyVehicle::from_bytes(this, bytes)
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self { matcher: Arc::clone(&self.matcher), network: self.network.clone_ref(py) }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// Pickles the network and the parameters of the model.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<PyRoadNetwork>, Bound<'py, PyAny>))> {
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, (self.network(py), self.model(py)?)))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        network: &Bound<'_, PyRoadNetwork>,
        model: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        Self::new(network, Some(model))
    }

    fn __repr__(&self) -> String {
        format!("<Matcher: {} edges>", self.matcher.network().edges().len())
    }
}

/// Reads drives from a file: GPX, GeoJSON, or CSV with the columns `trace`, `time`, `longitude` and
/// `latitude`, and optionally `accuracy`, `heading` and `speed`. Returns a dictionary with the
/// arrays `trip`, `time`, `lat`, `lon`, `accuracy`, `heading` and `speed`, for
/// `match_trips(points, "trip")`, and a report of what was left out.
#[pyfunction]
pub(crate) fn read_traces(py: Python<'_>, path: PathBuf) -> PyResult<(Bound<'_, PyDict>, String)> {
    let read = in_background(py, move |_| wayfix_roads::matching::read_traces(path))?;
    let (traces, report) = read.map_err(invalid)?;
    let column = |of: fn(&TracePoint) -> f64| -> Vec<f64> {
        traces.iter().flat_map(|trace| trace.points.iter().map(of)).collect()
    };
    let columns = PyDict::new(py);
    let names: Vec<&str> = traces
        .iter()
        .flat_map(|trace| std::iter::repeat_n(trace.name.as_str(), trace.points.len()))
        .collect();
    // Texts as objects: numpy's own would take the width of the longest name for each.
    columns.set_item("trip", py.import("numpy")?.call_method1("array", (names, "object"))?)?;
    columns.set_item("time", column(|point| point.time).to_pyarray(py))?;
    columns.set_item("lat", column(|point| point.position.latitude).to_pyarray(py))?;
    columns.set_item("lon", column(|point| point.position.longitude).to_pyarray(py))?;
    let accuracy = column(|point| point.accuracy.unwrap_or(f64::NAN));
    columns.set_item("accuracy", accuracy.to_pyarray(py))?;
    let heading = column(|point| point.heading.unwrap_or(f64::NAN));
    columns.set_item("heading", heading.to_pyarray(py))?;
    columns.set_item("speed", column(|point| point.speed.unwrap_or(f64::NAN)).to_pyarray(py))?;
    Ok((columns, report.to_string()))
}
