//! The class `Filter`: the library's filter over a model of any kind. Its verbs are in `live`.

use std::sync::Arc;

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix::inference::FilterSnapshot;
use wayfix::{DenseTransition, Filter, Hmm, LikelihoodVector, SparseTransition, TableLikelihood};

use crate::error::{inference, invalid};
use crate::live::{Live, live_methods, live_of, with_live};
use crate::model::PyHmm;

type Of<A, B> = Filter<Arc<Hmm<A, B>>>;
type Streams = Live<
    Of<DenseTransition, LikelihoodVector>,
    Of<DenseTransition, TableLikelihood>,
    Of<SparseTransition, LikelihoodVector>,
    Of<SparseTransition, TableLikelihood>,
>;

/// Live filter, made by `Hmm.filter()`: the distribution of the present state.
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
    live: Streams,
    hmm: Py<PyHmm>,
}

impl PyFilter {
    pub(crate) fn new(hmm: &Bound<'_, PyHmm>) -> Self {
        let live = live_of!(hmm.get().model(), |hmm| Filter::new(hmm.clone()));
        Self { live, hmm: hmm.clone().unbind() }
    }
}

live_methods!(PyFilter, FilterSnapshot, |live| live, {
    /// Pickles the model and the state.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        // A bound method pickles as its object and its name. So the model comes along, once for all
        // of its filters in a pickle.
        Ok((self.hmm.bind(py).getattr("filter_from_bytes")?, (self.to_bytes(py)?,)))
    }

    fn __repr__(&self) -> String {
        format!("<Filter: {} steps, log-likelihood {}>", self.steps(), self.log_likelihood())
    }
});
