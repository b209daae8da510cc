//! The verbs that live filters and smoothers share, over a model of any kind. PyO3 has no generic
//! classes, so a macro writes the methods into each class.

use pyo3::prelude::*;
use wayfix::inference::{FilterSnapshot, FixedLagSnapshot};

use crate::array::{contiguous, doubles};
use crate::error::invalid;

/// State of a stream, stored as bytes; a stream restored from them continues with the same bits.
pub(crate) trait StoredState: Sized {
    fn write(&self) -> PyResult<Vec<u8>>;
    fn read(bytes: &[u8]) -> PyResult<Self>;
}

impl StoredState for FilterSnapshot {
    fn write(&self) -> PyResult<Vec<u8>> {
        Ok(self.to_bytes())
    }

    fn read(bytes: &[u8]) -> PyResult<Self> {
        Self::from_bytes(bytes).map_err(invalid)
    }
}

// The library has a format of its own only for filters, so this is JSON.
impl StoredState for FixedLagSnapshot<()> {
    fn write(&self) -> PyResult<Vec<u8>> {
        serde_json::to_vec(self).map_err(invalid)
    }

    fn read(bytes: &[u8]) -> PyResult<Self> {
        serde_json::from_slice(bytes)
            .map_err(|error| invalid(format!("the state of a FixedLag: {error}")))
    }
}

/// Stream over a model with one of the two operators and one of the two sensors.
#[derive(Debug, Clone)]
pub(crate) enum Live<DenseVector, DenseTable, SparseVector, SparseTable> {
    DenseVector(DenseVector),
    DenseTable(DenseTable),
    SparseVector(SparseVector),
    SparseTable(SparseTable),
}

/// Makes a stream of a model.
macro_rules! live_of {
    ($model:expr, |$hmm:ident| $stream:expr) => {
        match $model {
            $crate::kinds::Model::DenseVector($hmm) => Live::DenseVector($stream),
            $crate::kinds::Model::DenseTable($hmm) => Live::DenseTable($stream),
            $crate::kinds::Model::SparseVector($hmm) => Live::SparseVector($stream),
            $crate::kinds::Model::SparseTable($hmm) => Live::SparseTable($stream),
        }
    };
}

/// Evaluates an expression with the stream in its own type.
macro_rules! with_live {
    ($live:expr, |$stream:ident| $body:expr) => {
        match $live {
            Live::DenseVector($stream) => $body,
            Live::DenseTable($stream) => $body,
            Live::SparseVector($stream) => $body,
            Live::SparseTable($stream) => $body,
        }
    };
}

/// Gives a class with the fields `live` and `hmm` the methods of all streams, and those in braces.
/// The expression returns the filter of a stream.
macro_rules! live_methods {
    ($class:ident, $snapshot:ty, |$stream:ident| $filter:expr, { $($own:tt)* }) => {
        impl $class {
            fn observe(&mut self, observation: &Bound<'_, PyAny>, moves: bool) -> PyResult<f64> {
                // For the error of a symbol, which is read before the stream sees it.
                let step = self.steps() + 1;
                // The global lock is kept: `self` is mutably borrowed, so a thread that got the
                // lock during the step could only run into the exception that PyO3 raises for that.
                let done = match &mut self.live {
                    Live::DenseVector(live) => $crate::live::row(observation, |y| {
                        if moves { live.step(y) } else { live.update(y) }
                    })?,
                    Live::SparseVector(live) => $crate::live::row(observation, |y| {
                        if moves { live.step(y) } else { live.update(y) }
                    })?,
                    Live::DenseTable(live) => {
                        let y = $crate::array::symbol(observation, step)?;
                        if moves { live.step(&y) } else { live.update(&y) }
                    }
                    Live::SparseTable(live) => {
                        let y = $crate::array::symbol(observation, step)?;
                        if moves { live.step(&y) } else { live.update(&y) }
                    }
                };
                done.map_err(|error| inference(observation.py(), 0, &error))
            }
        }

        #[pymethods]
        impl $class {
            $($own)*

            /// Takes a step: a move, then an observation. Returns the log-likelihood of the
            /// observation given those before. A step that raises changes nothing.
            fn step(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
                self.observe(observation, true)
            }

            /// Takes a further observation without a move. Returns its log-likelihood given all
            /// earlier ones.
            fn update(&mut self, observation: &Bound<'_, PyAny>) -> PyResult<f64> {
                self.observe(observation, false)
            }

            /// Takes a step without an observation.
            fn predict(&mut self, py: Python<'_>) -> PyResult<()> {
                let done = with_live!(&mut self.live, |live| live.predict());
                done.map_err(|error| inference(py, 0, &error))
            }

            /// Returns to the start, with no steps taken.
            fn restart(&mut self) {
                with_live!(&mut self.live, |live| live.restart());
            }

            /// Probabilities of all states now: a copy.
            #[getter]
            fn belief<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
                with_live!(&self.live, |$stream| $filter.belief().as_slice().to_pyarray(py))
            }

            /// Most probable state now; ties go to the lowest.
            #[getter]
            fn mode(&self) -> usize {
                with_live!(&self.live, |$stream| $filter.belief().mode())
            }

            /// Number of steps.
            #[getter]
            fn steps(&self) -> usize {
                with_live!(&self.live, |$stream| $filter.steps())
            }

            /// Log-likelihood of the observations so far.
            #[getter]
            fn log_likelihood(&self) -> f64 {
                with_live!(&self.live, |$stream| $filter.log_likelihood())
            }

            /// Returns the state as bytes, without the model.
            fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
                let bytes = with_live!(&self.live, |live| $crate::live::StoredState::write(&live.snapshot()));
                Ok(PyBytes::new(py, &bytes?))
            }

            /// Restores the state that `to_bytes` returned; it continues with the same bits.
            pub(crate) fn restore(&mut self, bytes: &[u8]) -> PyResult<()> {
                // Either error leaves the stream as it was: all bytes are read first, and the
                // library restores everything or nothing.
                let snapshot = <$snapshot as $crate::live::StoredState>::read(bytes)?;
                with_live!(&mut self.live, |live| live.restore(&snapshot)).map_err(invalid)
            }

            fn __copy__(&self, py: Python<'_>) -> Self {
                Self { live: self.live.clone(), hmm: self.hmm.clone_ref(py) }
            }

            fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
                self.__copy__(py)
            }
        }
    };
}

/// Calls `then` with the likelihoods of all states, borrowed from the array if possible.
pub(crate) fn row<T>(
    observation: &Bound<'_, PyAny>,
    then: impl FnOnce(&[f64]) -> T,
) -> PyResult<T> {
    let array = doubles(observation, "likelihoods")?;
    Ok(then(contiguous(array.as_slice(), "an observation")?))
}

pub(crate) use {live_methods, live_of, with_live};
