//! The classes `Stretches` and `RankedRoutes`: stretches of roads as columns, and the best routes
//! of a drive.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use wayfix::map::Position;
use wayfix_roads::matching::{RankedRoutes, Stretch, Stretches};

use super::PyMatcher;
use super::network::line;
use crate::typed::index;

/// Stretches of roads: a route, or the set that holds a vehicle.
///
/// Attributes
/// ----------
/// edge : array of int
///     Number of the edge of each stretch; -1 off the road.
/// enter, exit : array
///     Metres from the start of the edge to both ends of the stretch; off the road, 0 and the
///     straight distance.
/// ends : array, shape (stretches, 2, 2)
///     Latitude and longitude of both ends.
/// probabilities : array
///     Probability that the vehicle is on each stretch; empty for a route.
/// probability : float
///     Probability of the route, or that the vehicle is on one of the stretches; NaN for
///     `MatchedDrive.route`, whose probability is in `MatchedDrive.routes(1)`.
#[pyclass(name = "Stretches", module = "wayfix.matching", frozen)]
#[derive(Debug)]
pub(crate) struct PyStretches {
    stretches: Vec<Stretch>,
    #[pyo3(get)]
    edge: Py<PyArray1<i64>>,
    #[pyo3(get)]
    enter: Py<PyArray1<f64>>,
    #[pyo3(get)]
    exit: Py<PyArray1<f64>>,
    #[pyo3(get)]
    ends: Py<PyArray3<f64>>,
    #[pyo3(get)]
    probabilities: Py<PyArray1<f64>>,
    #[pyo3(get)]
    probability: f64,
    matcher: Py<PyMatcher>,
}

impl PyStretches {
    pub(super) fn new(matcher: &Bound<'_, PyMatcher>, found: Stretches) -> PyResult<Self> {
        let py = matcher.py();
        let Stretches { stretches, probabilities, probability } = found;
        let edge: Vec<i64> = stretches.iter().map(|part| index(part.edge)).collect();
        let enter: Vec<f64> = stretches.iter().map(|part| part.enter).collect();
        let exit: Vec<f64> = stretches.iter().map(|part| part.exit).collect();
        let ends = stretches.iter().flat_map(|part| part.ends);
        let ends = ends.flat_map(|end| [end.latitude, end.longitude]).collect();
        let ends = PyArray1::from_vec(py, ends).reshape([stretches.len(), 2, 2])?;
        Ok(Self {
            edge: edge.to_pyarray(py).unbind(),
            enter: enter.to_pyarray(py).unbind(),
            exit: exit.to_pyarray(py).unbind(),
            ends: ends.unbind(),
            probabilities: probabilities.to_pyarray(py).unbind(),
            probability,
            matcher: matcher.clone().unbind(),
            stretches,
        })
    }
}

#[pymethods]
impl PyStretches {
    /// Length on roads, in metres.
    #[getter]
    fn metres(&self) -> f64 {
        // Off the road, a stretch has its straight distance, which is not on roads. Folded, since
        // `sum` starts from −0: a route without roads would be printed as "-0 m".
        let on_road = self.stretches.iter().filter(|part| part.edge.is_some());
        on_road.fold(0.0, |sum, part| sum + part.metres())
    }

    /// Returns the line of all stretches, one after another: latitudes and longitudes, of shape
    /// (points, 2). A point where two stretches meet appears once.
    fn line<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let matcher = &self.matcher.get().matcher;
        let mut points: Vec<Position> =
            self.stretches.iter().flat_map(|part| matcher.line(part)).collect();
        points.dedup();
        line(py, &points)
    }

    /// Returns the stretches as GeoJSON, with node ids.
    fn to_geojson(&self) -> String {
        self.matcher.get().matcher.route_to_geojson(&self.stretches)
    }

    fn __len__(&self) -> usize {
        self.stretches.len()
    }

    fn __repr__(&self) -> String {
        format!("<Stretches: {}, {:.0} m on roads>", self.stretches.len(), self.metres())
    }
}

/// Most probable routes of a drive.
///
/// Attributes
/// ----------
/// routes : list of Stretches
///     Distinct routes, the most probable first.
/// remaining : float
///     Probability of all other routes together.
/// is_exact : bool
///     True if the routes are proven to be the most probable ones.
#[pyclass(name = "RankedRoutes", module = "wayfix.matching", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PyRankedRoutes {
    routes: Vec<Py<PyStretches>>,
    remaining: f64,
    is_exact: bool,
}

impl PyRankedRoutes {
    pub(super) fn new(
        matcher: &Bound<'_, PyMatcher>,
        found: RankedRoutes<Position>,
    ) -> PyResult<Self> {
        let RankedRoutes { routes, remaining, is_exact } = found;
        let routes = routes
            .into_iter()
            .map(|route| Py::new(matcher.py(), PyStretches::new(matcher, route)?));
        Ok(Self { routes: routes.collect::<PyResult<_>>()?, remaining, is_exact })
    }
}

#[pymethods]
impl PyRankedRoutes {
    fn __repr__(&self) -> String {
        let Self { routes, remaining, .. } = self;
        format!("<RankedRoutes: {} routes, {remaining:.3} for all others>", routes.len())
    }
}
