//! The class `MatchedDrive`: a whole drive, with its answers and its routes.

use std::sync::Arc;

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use wayfix_roads::matching::{MatchedDrive, Stretches};

use super::answers::Answers;
use super::trips::Estimator;
use super::{PyMatcher, PyRankedRoutes, PyRoadAnswers, PyStretches};
use crate::error::invalid;
use crate::typed::{Size, index};
use crate::watch::in_background;

/// Drive on a road network, made by `Matcher.match_drive(points)`: the distribution of the roads
/// at each point, and the most probable route.
#[pyclass(name = "MatchedDrive", module = "wayfix.matching", frozen)]
#[derive(Debug)]
pub(crate) struct PyMatchedDrive {
    drive: Arc<MatchedDrive>,
    matcher: Py<PyMatcher>,
}

impl PyMatchedDrive {
    pub(super) fn new(matcher: &Bound<'_, PyMatcher>, drive: MatchedDrive) -> Self {
        Self { drive: Arc::new(drive), matcher: matcher.clone().unbind() }
    }

    fn answers(&self, py: Python<'_>, estimator: Estimator) -> PyResult<PyRoadAnswers> {
        let network = self.matcher.get().matcher.network();
        let found = py.detach(|| {
            // Late answers are computed here, point by point; the others are stored in the drive.
            let mut answers = Answers::default();
            (0..self.drive.points().len())
                .for_each(|point| answers.push(network, &estimator.answer(&self.drive, point)));
            answers
        });
        found.into_python(py)
    }

    fn check(&self, point: Size) -> PyResult<usize> {
        let (point, points) = (point.0, self.drive.points().len());
        if point < points {
            return Ok(point);
        }
        Err(invalid(format!("there is no point {point}, expected a number below {points}")))
    }
}

#[pymethods]
impl PyMatchedDrive {
    /// Returns the answers for all points, each given the points up to it.
    fn live(&self, py: Python<'_>) -> PyResult<PyRoadAnswers> {
        self.answers(py, Estimator::Live)
    }

    /// Returns the answers for all points, each given the points up to it and `lag` more.
    fn late(&self, py: Python<'_>, lag: Size) -> PyResult<PyRoadAnswers> {
        self.answers(py, Estimator::Late(lag.0))
    }

    /// Returns the answers for all points, each given all points.
    fn smoothed(&self, py: Python<'_>) -> PyResult<PyRoadAnswers> {
        self.answers(py, Estimator::Smoothed)
    }

    /// Most probable route: consecutive edges, and stretches off the road.
    #[getter]
    fn route(&self, py: Python<'_>) -> PyResult<PyStretches> {
        // The probability of the route takes a search of its own, which `routes` makes.
        let stretches = self.drive.route().to_vec();
        let route = Stretches { stretches, probabilities: Vec::new(), probability: f64::NAN };
        PyStretches::new(self.matcher.bind(py), route)
    }

    /// Returns the `count` most probable distinct routes.
    fn routes(&self, py: Python<'_>, count: Size) -> PyResult<PyRankedRoutes> {
        // After Ctrl-C the search goes on without this call, so it must own what it reads.
        let matcher = Arc::clone(&self.matcher.get().matcher);
        let drive = Arc::clone(&self.drive);
        let found = in_background(py, move |_| matcher.routes(&drive, count.0))?;
        PyRankedRoutes::new(self.matcher.bind(py), found.map_err(invalid)?)
    }

    /// Returns the edges at a point, from 0, with their probabilities, the most probable first. Off
    /// the road is not among them.
    #[expect(clippy::type_complexity, reason = "a pair of arrays, as Python's callers take it")]
    fn edges<'py>(
        &self,
        py: Python<'py>,
        point: Size,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>)> {
        let (edges, probabilities): (Vec<i64>, Vec<f64>) = self
            .drive
            .edges(self.check(point)?)
            .into_iter()
            .map(|(edge, p)| (index(Some(edge)), p))
            .unzip();
        Ok((edges.to_pyarray(py), probabilities.to_pyarray(py)))
    }

    /// Returns stretches of roads that hold the vehicle at a point with a probability of at least
    /// `mass`, or all possible edges if the roads hold less than that.
    fn credible(&self, py: Python<'_>, point: Size, mass: f64) -> PyResult<PyStretches> {
        let (matcher, point) = (self.matcher.bind(py), self.check(point)?);
        let found = self.drive.credible(&matcher.get().matcher, point, mass);
        PyStretches::new(matcher, found.map_err(invalid)?)
    }

    /// Log-density of each point given all earlier points, with lengths in metres.
    #[getter]
    fn log_normalizers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let points = 0..self.drive.points().len();
        points.map(|point| self.drive.log_normalizer(point)).collect::<Vec<f64>>().to_pyarray(py)
    }

    /// Log-likelihood of all points.
    #[getter]
    fn log_likelihood(&self) -> f64 {
        self.drive.log_likelihood()
    }

    /// Length of the route on roads, in metres.
    #[getter]
    fn metres(&self) -> f64 {
        self.drive.metres()
    }

    fn __len__(&self) -> usize {
        self.drive.points().len()
    }

    fn __repr__(&self) -> String {
        let (points, metres) = (self.drive.points().len(), self.drive.metres());
        format!("<MatchedDrive: {points} points, {metres:.0} m on roads>")
    }
}
