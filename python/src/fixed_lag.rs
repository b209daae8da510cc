//! A fixed-lag smoother, as Python sees it.

use std::sync::Arc;

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix::inference::FixedLagSnapshot;
use wayfix::{
    DenseTransition, FixedLag, Hmm, InferenceError, LikelihoodVector, SparseTransition,
    TableLikelihood,
};

use crate::array;
use crate::error::{inference, invalid};
use crate::kinds::Model;
use crate::model::PyHmm;
use crate::typed::Size;

type Smoother<A, B> = FixedLag<Arc<Hmm<A, B>>, ()>;

/// A smoother over a model of any kind.
#[derive(Debug, Clone)]
enum Live {
    DenseVector(Smoother<DenseTransition, LikelihoodVector>),
    DenseTable(Smoother<DenseTransition, TableLikelihood>),
    SparseVector(Smoother<SparseTransition, LikelihoodVector>),
    SparseTable(Smoother<SparseTransition, TableLikelihood>),
}

macro_rules! with_smoother {
    ($live:expr, |$smoother:ident| $body:expr) => {
        match $live {
            Live::DenseVector($smoother) => $body,
            Live::DenseTable($smoother) => $body,
            Live::SparseVector($smoother) => $body,
            Live::SparseTable($smoother) => $body,
        }
    };
}

/// Live smoother: after each step, the beliefs of the last steps given all observations so far.
///
/// Can be copied and pickled, and goes on to the bit.
///
/// Parameters
/// ----------
/// hmm : Hmm
///     The model.
/// lag : int
///     Number of steps that it looks back; with 0 it is the filter.
///
/// Examples
/// --------
/// >>> import wayfix
/// >>> hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
/// >>> live = wayfix.FixedLag(hmm, 2)
/// >>> for symbol in [0, 0, 1, 0, 0]:
/// ...     _ = live.step(symbol)
/// >>> live.lagged.round(3)  # of the third step
/// array([0.865, 0.135])
/// >>> hmm.smooth([0, 0, 1, 0, 0]).probabilities[2].round(3)
/// array([0.865, 0.135])
#[pyclass(name = "FixedLag", module = "wayfix")]
#[derive(Debug)]
pub(crate) struct PyFixedLag {
    live: Live,
    hmm: Py<PyHmm>,
}

impl PyFixedLag {
    fn observe(&mut self, observation: &Bound<'_, PyAny>, moves: bool) -> PyResult<f64> {
        fn rows<T>(
            ys: &Bound<'_, PyAny>,
            then: impl FnOnce(&[f64]) -> Result<T, InferenceError>,
        ) -> PyResult<Result<T, InferenceError>> {
            let array = array::doubles(ys, "likelihoods")?;
            Ok(then(array.as_slice().map_err(invalid)?))
        }
        let done = match &mut self.live {
            Live::DenseVector(live) => {
                rows(observation, |y| if moves { live.step(y) } else { live.update(y) })?
            }
            Live::SparseVector(live) => {
                rows(observation, |y| if moves { live.step(y) } else { live.update(y) })?
            }
            Live::DenseTable(live) => {
                let y = array::symbol(observation)?;
                if moves { live.step(&y) } else { live.update(&y) }
            }
            Live::SparseTable(live) => {
                let y = array::symbol(observation)?;
                if moves { live.step(&y) } else { live.update(&y) }
            }
        };
        done.map_err(|error| inference(observation.py(), 0, &error))
    }
}

#[pymethods]
impl PyFixedLag {
    #[new]
    fn new(hmm: &Bound<'_, PyHmm>, lag: Size) -> Self {
        let lag = lag.0;
        let live = match hmm.get().model() {
            Model::DenseVector(hmm) => Live::DenseVector(FixedLag::new(hmm.clone(), lag)),
            Model::DenseTable(hmm) => Live::DenseTable(FixedLag::new(hmm.clone(), lag)),
            Model::SparseVector(hmm) => Live::SparseVector(FixedLag::new(hmm.clone(), lag)),
            Model::SparseTable(hmm) => Live::SparseTable(FixedLag::new(hmm.clone(), lag)),
        };
        Self { live, hmm: hmm.clone().unbind() }
    }

    /// Takes a step: a move, then an observation. Returns the log-likelihood of the observation
    /// given those before; an observation that raises leaves the smoother as it was.
    fn step(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.observe(observation, true)
    }

    /// Takes a further observation without a move. Returns its log-likelihood given all before.
    fn update(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.observe(observation, false)
    }

    /// Takes a step without an observation.
    fn predict(&mut self, py: Python<'_>) -> PyResult<()> {
        let done = with_smoother!(&mut self.live, |live| live.predict());
        done.map_err(|error| inference(py, 0, &error))
    }

    /// Returns to the start, with no steps taken.
    fn restart(&mut self) {
        with_smoother!(&mut self.live, |live| live.restart());
    }

    /// Probabilities of all states `lag` steps ago, or at the first step there was: a copy.
    #[getter]
    fn lagged<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        with_smoother!(&self.live, |live| live.lagged().as_slice().to_pyarray(py))
    }

    /// Probabilities of all states now: a copy.
    #[getter]
    fn belief<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        with_smoother!(&self.live, |live| live.filter().belief().as_slice().to_pyarray(py))
    }

    /// Returns the probabilities of all states at a step, from 1 (0 is before the first), or None if
    /// it is not among the last.
    #[pyo3(name = "get")]
    fn at<'py>(&self, py: Python<'py>, step: Size) -> Option<Bound<'py, PyArray1<f64>>> {
        with_smoother!(&self.live, |live| live.get(step.0).map(|p| p.as_slice().to_pyarray(py)))
    }

    /// Number of steps that it looks back.
    #[getter]
    fn lag(&self) -> usize {
        with_smoother!(&self.live, |live| live.lag())
    }

    /// Number of steps.
    #[getter]
    fn steps(&self) -> usize {
        with_smoother!(&self.live, |live| live.filter().steps())
    }

    /// Log-likelihood of the observations so far.
    #[getter]
    fn log_likelihood(&self) -> f64 {
        with_smoother!(&self.live, |live| live.filter().log_likelihood())
    }

    /// Returns the state as bytes, without the model.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &with_smoother!(&self.live, |live| live.snapshot().to_bytes()))
    }

    /// Restores the state that `to_bytes` returned; it goes on to the bit.
    fn restore(&mut self, bytes: &[u8]) -> PyResult<()> {
        let snapshot = FixedLagSnapshot::from_bytes(bytes).map_err(invalid)?;
        with_smoother!(&mut self.live, |live| live.restore(&snapshot)).map_err(invalid)
    }

    /// Makes what a pickle kept.
    #[staticmethod]
    fn _from_bytes(hmm: &Bound<'_, PyHmm>, lag: Size, bytes: &[u8]) -> PyResult<Self> {
        let mut live = Self::new(hmm, lag);
        live.restore(bytes)?;
        Ok(live)
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self { live: self.live.clone(), hmm: self.hmm.clone_ref(py) }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// What a pickle keeps: the model, the lag and the state.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<PyHmm>, usize, Bound<'py, PyBytes>))> {
        let made = py.get_type::<Self>().getattr("_from_bytes")?;
        Ok((made, (self.hmm.clone_ref(py), self.lag(), self.to_bytes(py))))
    }

    fn __repr__(&self) -> String {
        format!("<FixedLag: {} steps, lag {}>", self.steps(), self.lag())
    }
}
