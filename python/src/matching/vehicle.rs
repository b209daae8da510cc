//! The class `Vehicle`: a live drive, point by point.

use std::sync::{Mutex, MutexGuard};

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix_roads::matching::Vehicle;

use super::points::{moment, point};
use super::{PyMatcher, PyRoadAnswer, PyStretches};
use crate::error::{invalid, of_drive, placed};
use crate::typed::{Size, index};

/// Vehicle on the road, made by `Matcher.start(...)` and updated point by point.
///
/// Can be copied and pickled, with its matcher.
#[pyclass(name = "Vehicle", module = "wayfix.matching", frozen)]
#[derive(Debug)]
pub(crate) struct PyVehicle {
    /// Updated without the global lock, by the thread that has the next point.
    vehicle: Mutex<Vehicle>,
    matcher: Py<PyMatcher>,
}

impl PyVehicle {
    pub(super) fn new(matcher: &Bound<'_, PyMatcher>, vehicle: Vehicle) -> Self {
        Self { vehicle: Mutex::new(vehicle), matcher: matcher.clone().unbind() }
    }

    pub(super) fn from_bytes(matcher: &Bound<'_, PyMatcher>, bytes: &[u8]) -> PyResult<Self> {
        let vehicle: Vehicle = serde_json::from_slice(bytes)
            .map_err(|error| invalid(format!("the state of a vehicle: {error}")))?;
        // For a vehicle of another network this fails here, rather than at the next point.
        vehicle.credible(&matcher.get().matcher, 0.5).map_err(invalid)?;
        Ok(Self::new(matcher, vehicle))
    }

    fn lock(&self) -> MutexGuard<'_, Vehicle> {
        // A call that panicked has raised an exception; it does not make later calls fail.
        self.vehicle.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Vehicle) -> T + Send) -> T {
        // The global lock is released first: a thread that held it while waiting for the vehicle
        // would block the one that has the vehicle and waits for the global lock.
        py.detach(|| work(&mut self.lock()))
    }

    fn answer(&self, found: wayfix_roads::matching::RoadAnswer) -> PyRoadAnswer {
        PyRoadAnswer::new(self.matcher.get().matcher.network(), found)
    }
}

#[pymethods]
impl PyVehicle {
    /// Takes the next point; `time` is in seconds, or a date. Returns its log-density given all
    /// earlier points. An error leaves the vehicle as it was.
    #[pyo3(signature = (time, lat, lon, *, accuracy=f64::NAN, heading=f64::NAN, speed=f64::NAN))]
    #[expect(clippy::too_many_arguments, reason = "those of a point, by name")]
    fn step(
        &self,
        py: Python<'_>,
        time: &Bound<'_, PyAny>,
        lat: f64,
        lon: f64,
        accuracy: f64,
        heading: f64,
        speed: f64,
    ) -> PyResult<f64> {
        let point = point(moment(time)?, [lat, lon], [accuracy, heading, speed]);
        let matcher = &self.matcher.get().matcher;
        // The number of points is read under the same lock: another thread may take a step.
        let (points, done) =
            self.with(py, |vehicle| (vehicle.points(), vehicle.step(matcher, &point)));
        done.map_err(|error| placed(py, of_drive(py, &error), 0, Some(points + 1)))
    }

    /// Answer for the last point, given all points so far.
    #[getter]
    fn live(&self, py: Python<'_>) -> PyRoadAnswer {
        self.answer(self.with(py, |vehicle| vehicle.live()))
    }

    /// Answer for the point `lag` points ago, given all points so far.
    #[getter]
    fn late(&self, py: Python<'_>) -> PyRoadAnswer {
        self.answer(self.with(py, |vehicle| vehicle.late()))
    }

    /// Returns the answer for the point `points` points ago, or None if it has been dropped.
    fn ago(&self, py: Python<'_>, points: Size) -> Option<PyRoadAnswer> {
        self.with(py, |vehicle| vehicle.ago(points.0)).map(|found| self.answer(found))
    }

    /// Returns stretches of roads that hold the vehicle now with a probability of at least `mass`,
    /// or all possible edges if the roads hold less than that.
    fn credible(&self, py: Python<'_>, mass: f64) -> PyResult<PyStretches> {
        let matcher = self.matcher.bind(py);
        let found = self.with(py, |vehicle| vehicle.credible(&self.matcher.get().matcher, mass));
        PyStretches::new(matcher, found.map_err(invalid)?)
    }

    /// Returns the edges with their probabilities, the most probable first. Off the road is not
    /// among them.
    fn edges<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>) {
        let found = self.with(py, |vehicle| vehicle.edges()).into_iter();
        let (edges, probabilities): (Vec<i64>, Vec<f64>) =
            found.map(|(edge, p)| (index(Some(edge)), p)).unzip();
        (edges.to_pyarray(py), probabilities.to_pyarray(py))
    }

    /// Number of points so far.
    #[getter]
    fn points(&self, py: Python<'_>) -> usize {
        self.with(py, |vehicle| vehicle.points())
    }

    /// Log-likelihood of all points so far.
    #[getter]
    fn log_likelihood(&self, py: Python<'_>) -> f64 {
        self.with(py, |vehicle| vehicle.log_likelihood())
    }

    /// Returns the state as bytes (JSON), for `vehicle_from_bytes` of a matcher with the same network.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.with(py, |vehicle| serde_json::to_vec(vehicle));
        Ok(PyBytes::new(py, &bytes.map_err(invalid)?))
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        let vehicle = Mutex::new(self.with(py, |vehicle| vehicle.clone()));
        Self { vehicle, matcher: self.matcher.clone_ref(py) }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// Pickles the matcher and the state.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((self.matcher.bind(py).getattr("vehicle_from_bytes")?, (self.to_bytes(py)?,)))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let points = self.points(py);
        format!("<Vehicle: {points} points, {}>", self.live(py).__repr__())
    }
}
