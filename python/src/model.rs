//! Models, as Python sees them.

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use wayfix::inference::{SmoothedSequence, ViterbiPath};
use wayfix::{Belief, InferenceError, LikelihoodVector, Prior};

use crate::array::{self, contiguous};
use crate::error::{inference, invalid};
use crate::filter::PyFilter;
use crate::kinds::{Model, Observed, with_sequence, with_sequences};
use crate::many::{check, collect};
use crate::parts::{Operator, dense_moves, join, operator, rows, sparse_moves, table_of};
use crate::results::{PyPath, PySmoothed};

/// Hidden Markov model: where it starts, how it moves, and how likely each observation is.
///
/// Without a table, an observation is an array of the likelihoods of all states (of any scale), or
/// of their logarithms; with one, it is a symbol, an integer from 0.
///
/// Parameters
/// ----------
/// start : array, shape (n,)
///     Probabilities of the first state; they sum to one.
/// moves : array or scipy.sparse matrix of shape (n, n), or three arrays
///     Probabilities of moves from the state of the row to that of the column; rows sum to one.
///     Three arrays are rows, columns and probabilities of a sparse matrix.
/// table : array, shape (n, m), optional
///     Probabilities of m symbols in each state; rows sum to one.
/// logarithms : bool
///     True if observations are logarithms of likelihoods.
/// start_before_move : bool
///     True if the first state is that before a first move, and not that of the first observation.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> import wayfix
/// >>> hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
/// >>> hmm.viterbi([0, 0, 1, 1]).states
/// array([0, 0, 1, 1])
/// >>> hmm.smooth([0, 0, 1, 1]).probabilities.round(3)
/// array([[0.919, 0.081],
///        [0.886, 0.114],
///        [0.37 , 0.63 ],
///        [0.28 , 0.72 ]])
#[pyclass(name = "Hmm", module = "wayfix", frozen)]
#[derive(Debug)]
pub(crate) struct PyHmm {
    model: Model,
    logarithms: bool,
}

impl PyHmm {
    fn all_observed<'py>(&self, all: &[Bound<'py, PyAny>]) -> PyResult<Vec<Observed<'py>>> {
        all.iter().map(|ys| self.model.observed(ys)).collect()
    }

    pub(crate) fn model(&self) -> &Model {
        &self.model
    }
}

#[pymethods]
impl PyHmm {
    #[new]
    #[pyo3(signature = (start, moves, *, table=None, logarithms=false, start_before_move=false))]
    fn new(
        start: &Bound<'_, PyAny>,
        moves: &Bound<'_, PyAny>,
        table: Option<&Bound<'_, PyAny>>,
        logarithms: bool,
        start_before_move: bool,
    ) -> PyResult<Self> {
        let start = array::doubles(start, "start probabilities")?;
        let start = contiguous(start.as_slice(), "start")?.to_vec();
        let belief = Belief::new(start).map_err(invalid)?;
        let n = belief.states();
        let prior = if start_before_move {
            Prior::BeforeFirstTransition(belief)
        } else {
            Prior::AtFirstObservation(belief)
        };
        let table = table.map(table_of).transpose()?;
        let vector =
            if logarithms { LikelihoodVector::log(n) } else { LikelihoodVector::linear(n) };
        let model = match (operator(moves, n)?, table) {
            (Operator::Dense(a), Some(b)) => Model::DenseTable(join(prior, a, b)?),
            (Operator::Dense(a), None) => Model::DenseVector(join(prior, a, vector)?),
            (Operator::Sparse(a), Some(b)) => Model::SparseTable(join(prior, *a, b)?),
            (Operator::Sparse(a), None) => Model::SparseVector(join(prior, *a, vector)?),
        };
        Ok(Self { model, logarithms })
    }

    /// What a pickle keeps: the arguments.
    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let (prior, moves, table) = match &self.model {
            Model::DenseVector(hmm) => (hmm.prior(), dense_moves(py, hmm.transition())?, None),
            Model::DenseTable(hmm) => {
                (hmm.prior(), dense_moves(py, hmm.transition())?, Some(rows(py, hmm.likelihood())?))
            }
            Model::SparseVector(hmm) => (hmm.prior(), sparse_moves(py, hmm.transition())?, None),
            Model::SparseTable(hmm) => (
                hmm.prior(),
                sparse_moves(py, hmm.transition())?,
                Some(rows(py, hmm.likelihood())?),
            ),
        };
        let arguments = (prior.belief().as_slice().to_pyarray(py), moves).into_pyobject(py)?;
        let named = PyDict::new(py);
        named.set_item("table", table)?;
        named.set_item("logarithms", self.logarithms)?;
        named.set_item("start_before_move", matches!(prior, Prior::BeforeFirstTransition(_)))?;
        Ok((arguments, named))
    }

    /// Returns a filter with the state that `Filter.to_bytes` returned.
    fn filter_from_bytes(this: &Bound<'_, Self>, bytes: &[u8]) -> PyResult<PyFilter> {
        let mut filter = PyFilter::new(this);
        filter.restore(bytes)?;
        Ok(filter)
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.model.states()
    }

    /// Returns the log-likelihood of a sequence.
    fn score(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<f64> {
        let observed = &self.model.observed(observations)?;
        let found: Result<f64, InferenceError> =
            with_sequence!(&self.model, observed, |hmm, ys| py.detach(|| hmm.log_likelihood(ys)));
        found.map_err(|error| inference(py, 0, &error))
    }

    /// Returns the probabilities of all states at each step given all observations.
    fn smooth(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PySmoothed> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| py.detach(|| {
            let smoothed = hmm.smooth(ys)?;
            Ok((smoothed.posteriors().as_slice().to_vec(), smoothed.log_likelihood()))
        }));
        let (rows, log_likelihood) =
            found.map_err(|error: InferenceError| inference(py, 0, &error))?;
        PySmoothed::new(py, rows, self.model.states(), log_likelihood)
    }

    /// Returns the probabilities of all states at each step given the observations so far.
    fn forward(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PySmoothed> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| py.detach(|| {
            let filtered = hmm.forward(ys)?;
            Ok((filtered.posteriors().as_slice().to_vec(), filtered.log_likelihood()))
        }));
        let (rows, log_likelihood) =
            found.map_err(|error: InferenceError| inference(py, 0, &error))?;
        PySmoothed::new(py, rows, self.model.states(), log_likelihood)
    }

    /// Returns the most probable path; ties go to the lowest state.
    fn viterbi(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PyPath> {
        let observed = &self.model.observed(observations)?;
        let found: Result<_, InferenceError> = with_sequence!(&self.model, observed, |hmm, ys| {
            py.detach(|| {
                hmm.viterbi(ys).map(|path| (path.states().to_vec(), path.log_probability()))
            })
        });
        let (states, log_probability) = found.map_err(|error| inference(py, 0, &error))?;
        Ok(PyPath::new(py, &states, log_probability))
    }

    /// Returns the `count` most probable paths, best first.
    fn k_best(
        &self,
        py: Python<'_>,
        observations: &Bound<'_, PyAny>,
        count: usize,
    ) -> PyResult<Vec<PyPath>> {
        let observed = &self.model.observed(observations)?;
        let found: Result<Vec<(Vec<usize>, f64)>, InferenceError> =
            with_sequence!(&self.model, observed, |hmm, ys| {
                py.detach(|| {
                    let paths = hmm.k_best(ys, count)?;
                    Ok(paths
                        .iter()
                        .map(|path| (path.states().to_vec(), path.log_probability()))
                        .collect())
                })
            });
        let paths = found.map_err(|error| inference(py, 0, &error))?;
        Ok(paths.iter().map(|(states, log)| PyPath::new(py, states, *log)).collect())
    }

    /// Returns the log-likelihoods of many sequences, of any lengths; some five times as fast as
    /// one by one if they are short.
    fn score_all<'py>(
        &self,
        py: Python<'py>,
        sequences: Vec<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let all = &self.all_observed(&sequences)?;
        let mut scores = Vec::with_capacity(all.len());
        let stopped = with_sequences!(&self.model, all, |hmm, ys| {
            py.detach(|| hmm.log_likelihood_map_all(ys, collect(&mut scores, |score| score)))
        });
        check(py, stopped)?;
        Ok(scores.to_pyarray(py))
    }

    /// Returns the probabilities of all states at each step of many sequences, of any lengths.
    fn smooth_all<'py>(
        &self,
        py: Python<'py>,
        sequences: Vec<Bound<'py, PyAny>>,
    ) -> PyResult<Vec<PySmoothed>> {
        let all = &self.all_observed(&sequences)?;
        let mut results = Vec::with_capacity(all.len());
        let stopped = with_sequences!(&self.model, all, |hmm, ys| py.detach(|| {
            let copy = |smoothed: SmoothedSequence| {
                (smoothed.posteriors().as_slice().to_vec(), smoothed.log_likelihood())
            };
            hmm.smooth_map_all(ys, collect(&mut results, copy))
        }));
        check(py, stopped)?;
        let states = self.model.states();
        results.into_iter().map(|(rows, log)| PySmoothed::new(py, rows, states, log)).collect()
    }

    /// Returns the most probable paths of many sequences, of any lengths.
    fn viterbi_all<'py>(
        &self,
        py: Python<'py>,
        sequences: Vec<Bound<'py, PyAny>>,
    ) -> PyResult<Vec<PyPath>> {
        let all = &self.all_observed(&sequences)?;
        let mut paths = Vec::with_capacity(all.len());
        let stopped = with_sequences!(&self.model, all, |hmm, ys| py.detach(|| {
            let copy = |path: ViterbiPath| (path.states().to_vec(), path.log_probability());
            hmm.viterbi_map_all(ys, collect(&mut paths, copy))
        }));
        check(py, stopped)?;
        Ok(paths.iter().map(|(states, log)| PyPath::new(py, states, *log)).collect())
    }

    /// Returns a live filter at the start.
    fn filter(this: &Bound<'_, Self>) -> PyFilter {
        PyFilter::new(this)
    }
}
