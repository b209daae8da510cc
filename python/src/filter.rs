//! A live filter, as Python sees it.

use std::sync::Arc;

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix::inference::FilterSnapshot;
use wayfix::{
    DenseTransition, Filter, Hmm, InferenceError, LikelihoodVector, SparseTransition,
    TableLikelihood,
};

use crate::array::{self, contiguous};
use crate::error::{inference, invalid};
use crate::kinds::Model;
use crate::model::PyHmm;

/// A filter over a model of any kind.
#[derive(Debug, Clone)]
enum Live {
    DenseVector(Filter<Arc<Hmm<DenseTransition, LikelihoodVector>>>),
    DenseTable(Filter<Arc<Hmm<DenseTransition, TableLikelihood>>>),
    SparseVector(Filter<Arc<Hmm<SparseTransition, LikelihoodVector>>>),
    SparseTable(Filter<Arc<Hmm<SparseTransition, TableLikelihood>>>),
}

/// Live filter, made by `Hmm.filter()`: what is known of the present state.
///
/// Examples
/// --------
/// >>> import wayfix
/// >>> hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
/// >>> live = hmm.filter()
/// >>> for symbol in [0, 0, 1]:
/// ...     _ = live.step(symbol)
/// >>> live.belief.round(3)
/// array([0.623, 0.377])
/// >>> live.predict()
/// >>> live.steps
/// 4
#[pyclass(name = "Filter", module = "wayfix")]
#[derive(Debug)]
pub(crate) struct PyFilter {
    live: Live,
    hmm: Py<PyHmm>,
}

macro_rules! with_filter {
    ($live:expr, |$filter:ident| $body:expr) => {
        match $live {
            Live::DenseVector($filter) => $body,
            Live::DenseTable($filter) => $body,
            Live::SparseVector($filter) => $body,
            Live::SparseTable($filter) => $body,
        }
    };
}

impl PyFilter {
    pub(crate) fn new(hmm: &Bound<'_, PyHmm>) -> Self {
        let live = match hmm.get().model() {
            Model::DenseVector(hmm) => Live::DenseVector(Filter::new(hmm.clone())),
            Model::DenseTable(hmm) => Live::DenseTable(Filter::new(hmm.clone())),
            Model::SparseVector(hmm) => Live::SparseVector(Filter::new(hmm.clone())),
            Model::SparseTable(hmm) => Live::SparseTable(Filter::new(hmm.clone())),
        };
        Self { live, hmm: hmm.clone().unbind() }
    }

    fn observe(&mut self, observation: &Bound<'_, PyAny>, moves: bool) -> PyResult<f64> {
        fn rows<T>(
            ys: &Bound<'_, PyAny>,
            then: impl FnOnce(&[f64]) -> Result<T, InferenceError>,
        ) -> PyResult<Result<T, InferenceError>> {
            let array = array::doubles(ys, "likelihoods")?;
            Ok(then(contiguous(array.as_slice(), "an observation")?))
        }
        let py = observation.py();
        let done = match &mut self.live {
            Live::DenseVector(filter) => {
                rows(observation, |y| if moves { filter.step(y) } else { filter.update(y) })?
            }
            Live::SparseVector(filter) => {
                rows(observation, |y| if moves { filter.step(y) } else { filter.update(y) })?
            }
            Live::DenseTable(filter) => {
                let y = array::symbol(observation)?;
                if moves { filter.step(&y) } else { filter.update(&y) }
            }
            Live::SparseTable(filter) => {
                let y = array::symbol(observation)?;
                if moves { filter.step(&y) } else { filter.update(&y) }
            }
        };
        done.map_err(|error| inference(py, 0, &error))
    }
}

#[pymethods]
impl PyFilter {
    /// Takes a step: a move, then an observation. Returns the log-likelihood of the observation
    /// given those before; an observation that raises leaves the filter as it was.
    fn step(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.observe(observation, true)
    }

    /// Takes a further observation without a move. Returns its log-likelihood given all before.
    fn update(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.observe(observation, false)
    }

    /// Takes a step without an observation.
    fn predict(&mut self, py: Python<'_>) -> PyResult<()> {
        let done = with_filter!(&mut self.live, |filter| filter.predict());
        done.map_err(|error| inference(py, 0, &error))
    }

    /// Returns to the start, with no steps taken.
    fn restart(&mut self) {
        with_filter!(&mut self.live, |filter| filter.restart());
    }

    /// Probabilities of all states: a copy.
    #[getter]
    fn belief<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        with_filter!(&self.live, |filter| filter.belief().as_slice().to_pyarray(py))
    }

    /// Most probable state; ties go to the lowest.
    #[getter]
    fn mode(&self) -> usize {
        with_filter!(&self.live, |filter| filter.belief().mode())
    }

    /// Number of steps.
    #[getter]
    fn steps(&self) -> usize {
        with_filter!(&self.live, |filter| filter.steps())
    }

    /// Log-likelihood of the observations so far.
    #[getter]
    fn log_likelihood(&self) -> f64 {
        with_filter!(&self.live, |filter| filter.log_likelihood())
    }

    /// Returns the state as bytes, without the model.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &with_filter!(&self.live, |filter| filter.snapshot().to_bytes()))
    }

    /// Restores the state that `to_bytes` returned; it goes on to the bit.
    pub(crate) fn restore(&mut self, bytes: &[u8]) -> PyResult<()> {
        let snapshot = FilterSnapshot::from_bytes(bytes).map_err(invalid)?;
        with_filter!(&mut self.live, |filter| filter.restore(&snapshot)).map_err(invalid)
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self { live: self.live.clone(), hmm: self.hmm.clone_ref(py) }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// What a pickle keeps: the model and the state.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((self.hmm.bind(py).getattr("filter_from_bytes")?, (self.to_bytes(py),)))
    }

    fn __repr__(&self) -> String {
        format!("<Filter: {} steps, log-likelihood {}>", self.steps(), self.log_likelihood())
    }
}
