//! The classes `RoadAnswer` and `RoadAnswers`: the road at one point, and at all points of drives
//! as columns.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use wayfix::map::Position;
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::RoadAnswer;

use crate::typed::index;

/// Road that a vehicle was on at a point of its drive.
///
/// Attributes
/// ----------
/// edge : int or None
///     Number of the most probable edge; None off the road.
/// metres_along : float
///     Metres from the start of the edge at the most probable point; 0 off the road.
/// position : tuple of float or None
///     Latitude and longitude of the most probable point; None off the road.
/// probability : float
///     Probability of the edge, or of being off the road.
/// entropy : float
///     Entropy of the distribution over edges and off the road, in nats.
/// off_road : float
///     Probability of being off the road.
#[pyclass(name = "RoadAnswer", module = "wayfix.matching", frozen, eq, get_all)]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PyRoadAnswer {
    edge: Option<usize>,
    metres_along: f64,
    position: Option<(f64, f64)>,
    probability: f64,
    entropy: f64,
    off_road: f64,
}

fn position(network: &RoadNetwork, answer: &RoadAnswer) -> Option<Position> {
    answer.edge.map(|edge| network.position_along(edge, answer.metres_along))
}

impl PyRoadAnswer {
    pub(super) fn new(network: &RoadNetwork, answer: RoadAnswer) -> Self {
        let position = position(network, &answer).map(|at| (at.latitude, at.longitude));
        let RoadAnswer { edge, metres_along, probability, entropy, off_road } = answer;
        Self { edge, metres_along, position, probability, entropy, off_road }
    }
}

#[pymethods]
impl PyRoadAnswer {
    pub(super) fn __repr__(&self) -> String {
        let Self { edge, metres_along, probability, .. } = self;
        match edge {
            Some(edge) => format!(
                "<RoadAnswer: edge {edge}, {metres_along:.1} m along, probability {probability:.3}>"
            ),
            None => format!("<RoadAnswer: off the road, probability {probability:.3}>"),
        }
    }
}

/// Answers of many points, column by column.
#[derive(Debug, Default)]
pub(super) struct Answers {
    edge: Vec<i64>,
    metres_along: Vec<f64>,
    positions: Vec<f64>,
    probability: Vec<f64>,
    entropy: Vec<f64>,
    off_road: Vec<f64>,
}

impl Answers {
    pub(super) fn push(&mut self, network: &RoadNetwork, answer: &RoadAnswer) {
        self.edge.push(index(answer.edge));
        self.metres_along.push(answer.metres_along);
        let at = position(network, answer);
        self.positions.extend(at.map_or([f64::NAN; 2], |at| [at.latitude, at.longitude]));
        self.probability.push(answer.probability);
        self.entropy.push(answer.entropy);
        self.off_road.push(answer.off_road);
    }

    /// Appends points that were not matched.
    pub(super) fn push_missing(&mut self, count: usize) {
        // All columns keep the same length, so that a row is still one point after a drive that
        // failed.
        let all = self.edge.len() + count;
        self.edge.resize(all, -1);
        self.positions.resize(2 * all, f64::NAN);
        let columns =
            [&mut self.metres_along, &mut self.probability, &mut self.entropy, &mut self.off_road];
        for column in columns {
            column.resize(all, f64::NAN);
        }
    }

    pub(super) fn append(&mut self, mut more: Self) {
        self.edge.append(&mut more.edge);
        self.metres_along.append(&mut more.metres_along);
        self.positions.append(&mut more.positions);
        self.probability.append(&mut more.probability);
        self.entropy.append(&mut more.entropy);
        self.off_road.append(&mut more.off_road);
    }

    pub(super) fn into_python(self, py: Python<'_>) -> PyResult<PyRoadAnswers> {
        let Self { edge, metres_along, positions, probability, entropy, off_road } = self;
        let count = edge.len();
        Ok(PyRoadAnswers {
            edge: PyArray1::from_vec(py, edge).unbind(),
            metres_along: PyArray1::from_vec(py, metres_along).unbind(),
            positions: PyArray1::from_vec(py, positions).reshape([count, 2])?.unbind(),
            probability: PyArray1::from_vec(py, probability).unbind(),
            entropy: PyArray1::from_vec(py, entropy).unbind(),
            off_road: PyArray1::from_vec(py, off_road).unbind(),
        })
    }
}

/// Roads at the points of drives.
///
/// Attributes
/// ----------
/// edge : array of int
///     Number of the most probable edge; -1 off the road.
/// metres_along : array
///     Metres from the start of the edge at the most probable point; 0 off the road.
/// positions : array, shape (points, 2)
///     Latitude and longitude of the most probable point; NaN off the road.
/// probability : array
///     Probability of the edge, or of being off the road.
/// entropy : array
///     Entropy of the distribution over edges and off the road, in nats.
/// off_road : array
///     Probability of being off the road.
#[pyclass(name = "RoadAnswers", module = "wayfix.matching", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PyRoadAnswers {
    edge: Py<PyArray1<i64>>,
    metres_along: Py<PyArray1<f64>>,
    positions: Py<PyArray2<f64>>,
    probability: Py<PyArray1<f64>>,
    entropy: Py<PyArray1<f64>>,
    off_road: Py<PyArray1<f64>>,
}

#[pymethods]
impl PyRoadAnswers {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.edge.bind(py).len().unwrap_or(0)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("<RoadAnswers: {} points>", self.__len__(py))
    }
}
