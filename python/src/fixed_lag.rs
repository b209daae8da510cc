//! The class `FixedLag`: the library's fixed-lag smoother over a model of any kind. Its verbs are
//! in `live`.

use std::sync::Arc;

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix::inference::FixedLagSnapshot;
use wayfix::{DenseTransition, FixedLag, Hmm, LikelihoodVector, SparseTransition, TableLikelihood};

use crate::error::{inference, invalid};
use crate::live::{Live, live_methods, live_of, with_live};
use crate::model::PyHmm;
use crate::typed::Size;

type Of<A, B> = FixedLag<Arc<Hmm<A, B>>, ()>;
type Streams = Live<
    Of<DenseTransition, LikelihoodVector>,
    Of<DenseTransition, TableLikelihood>,
    Of<SparseTransition, LikelihoodVector>,
    Of<SparseTransition, TableLikelihood>,
>;

/// Live smoother: after each step, the beliefs of the last steps given all observations so far.
///
/// Can be copied and pickled; a copy continues with the same bits.
///
/// Parameters
/// ----------
/// hmm : Hmm
///     The model.
/// lag : int
///     Number of steps that it looks back; 0 is the filter.
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
    live: Streams,
    hmm: Py<PyHmm>,
}

live_methods!(PyFixedLag, FixedLagSnapshot<()>, |live| live.filter(), {
    #[new]
    fn new(hmm: &Bound<'_, PyHmm>, lag: Size) -> Self {
        let live = live_of!(hmm.get().model(), |hmm| FixedLag::new(hmm.clone(), lag.0));
        Self { live, hmm: hmm.clone().unbind() }
    }

    /// Probabilities of all states `lag` steps ago, or at the first step if there were fewer: a
    /// copy.
    #[getter]
    fn lagged<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        with_live!(&self.live, |live| live.lagged().as_slice().to_pyarray(py))
    }

    /// Returns the probabilities of all states at a step, from 1 (0 is before the first), or None
    /// if that step is not kept.
    #[pyo3(name = "get")]
    fn at<'py>(&self, py: Python<'py>, step: Size) -> Option<Bound<'py, PyArray1<f64>>> {
        with_live!(&self.live, |live| live.get(step.0).map(|p| p.as_slice().to_pyarray(py)))
    }

    /// Number of steps that it looks back.
    #[getter]
    fn lag(&self) -> usize {
        with_live!(&self.live, |live| live.lag())
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_bytes(hmm: &Bound<'_, PyHmm>, lag: Size, bytes: &[u8]) -> PyResult<Self> {
        // The state also has the lag, which `restore` takes over.
        let mut live = Self::new(hmm, lag);
        live.restore(bytes)?;
        Ok(live)
    }

    /// Pickles the model, the lag and the state.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<PyHmm>, usize, Bound<'py, PyBytes>))> {
        let made = py.get_type::<Self>().getattr("_from_bytes")?;
        Ok((made, (self.hmm.clone_ref(py), self.lag(), self.to_bytes(py)?)))
    }

    fn __repr__(&self) -> String {
        format!("<FixedLag: {} steps, lag {}>", self.steps(), self.lag())
    }
});
