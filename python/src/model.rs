//! The class `Hmm`: a model of any of four kinds (dense or sparse moves, a table or vectors of
//! likelihoods), with the batch routines.
//!
//! Python's matrices have a *row* for the state that a move leaves, as in hmmlearn; the library's
//! have a column for it. The transpose is taken in `parts`, and nowhere else.

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::{Belief, LikelihoodVector, Prior};

use crate::array::{self, contiguous};
use crate::error::{inference, invalid, reserve};
use crate::filter::PyFilter;
use crate::kinds::{Model, with_sequence, with_sequences};
use crate::many::{Way, results};
use crate::parts::{Operator, dense_moves, join, operator, rows, sparse_moves, table_of};
use crate::results::{PyPath, PySmoothed};
use crate::typed::{Size, threads};
use crate::watch::computed;

/// Hidden Markov model: where it starts, how it moves, and how likely each observation is.
///
/// With a table, an observation is a symbol, an integer from 0. Without one, it is an array of the
/// likelihoods of all states (on any scale), or of their logarithms.
///
/// Parameters
/// ----------
/// start : array, shape (n,)
///     Probabilities of the first state; they sum to one.
/// moves : array or scipy.sparse matrix of shape (n, n), or three arrays
///     Probabilities of moves from the state of the row to that of the column; rows sum to one.
///     Three arrays are the rows, columns and probabilities of a sparse matrix, as in the
///     attribute `moves`.
/// table : array, shape (n, m), optional
///     Probabilities of m symbols in each state; rows sum to one.
/// logarithms : bool
///     True if observations are logarithms of likelihoods.
/// start_before_move : bool
///     True if `start` is the distribution before a first move, rather than at the first
///     observation.
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
    /// True if observations are logarithms of likelihoods.
    #[pyo3(get)]
    logarithms: bool,
}

impl PyHmm {
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }
}

/// Raises MemoryError if the paths would not fit into memory, where the library would abort.
fn paths_fit(states: usize, steps: usize, count: usize) -> PyResult<()> {
    let (mut bytes, mut paths) = (0_usize, 1);
    for _ in 0..steps {
        // The routine keeps up to `paths` back-pointers of 16 bytes for each state of this step. A
        // state has no more paths into it than there are paths into all states of the previous
        // step, so the lists grow from 1 by a factor of `states` until `count` caps them.
        bytes = bytes.saturating_add(states.saturating_mul(paths).saturating_mul(16));
        paths = states.saturating_mul(paths).min(count);
    }
    // The paths themselves, a state of 8 bytes for each step.
    bytes = bytes.saturating_add(paths.saturating_mul(steps).saturating_mul(8));
    reserve(bytes, || format!("{count} paths of {steps} steps"))
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
        // The number of states is that of the start; everything else is checked against it.
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

    /// Pickles the arguments of the constructor.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let arguments = (self.start(py), self.moves(py)?);
        // A plain `__reduce__` has no keyword arguments; `copyreg.__newobj_ex__` takes them.
        let named = PyDict::new(py);
        named.set_item("table", self.table(py)?)?;
        named.set_item("logarithms", self.logarithms)?;
        named.set_item("start_before_move", self.start_before_move())?;
        let with_names = py.import("copyreg")?.getattr("__newobj_ex__")?;
        let all = (py.get_type::<Self>(), arguments, named).into_pyobject(py)?;
        Ok((with_names, all.into_any()))
    }

    /// Returns a filter with the state that `Filter.to_bytes` returned.
    fn filter_from_bytes(this: &Bound<'_, Self>, bytes: &[u8]) -> PyResult<PyFilter> {
        let mut filter = PyFilter::new(this);
        filter.restore(bytes)?;
        Ok(filter)
    }

    /// Probabilities of the first state.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.model.prior().belief().as_slice().to_pyarray(py)
    }

    /// Probabilities of moves: an array, or rows, columns and probabilities of a sparse matrix.
    #[getter]
    fn moves<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match &self.model {
            Model::DenseVector(hmm) => dense_moves(py, hmm.transition()),
            Model::DenseTable(hmm) => dense_moves(py, hmm.transition()),
            Model::SparseVector(hmm) => sparse_moves(py, hmm.transition()),
            Model::SparseTable(hmm) => sparse_moves(py, hmm.transition()),
        }
    }

    /// Probabilities of symbols, or None without a table.
    #[getter]
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.model.table().map(|table| rows(py, table)).transpose()
    }

    /// True if `start` is the distribution before a first move.
    #[getter]
    fn start_before_move(&self) -> bool {
        matches!(self.model.prior(), Prior::BeforeFirstTransition(_))
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.model.states()
    }

    /// Returns the log-likelihood of a sequence.
    fn score(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<f64> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| {
            computed(py, |watch| hmm.log_likelihood(&watch.over(ys)))?
        });
        found.map_err(|error| inference(py, 0, &error))
    }

    /// Returns the probabilities of all states at each step given all observations.
    fn smooth(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PySmoothed> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| {
            computed(py, |watch| hmm.smooth(&watch.over(ys)))?
        });
        PySmoothed::smoothed(py, found.map_err(|error| inference(py, 0, &error))?)
    }

    /// Returns the probabilities of all states at each step given the observations so far.
    fn forward(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PySmoothed> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| {
            computed(py, |watch| hmm.forward(&watch.over(ys)))?
        });
        PySmoothed::filtered(py, found.map_err(|error| inference(py, 0, &error))?)
    }

    /// Returns the most probable path; ties go to the lowest state.
    fn viterbi(&self, py: Python<'_>, observations: &Bound<'_, PyAny>) -> PyResult<PyPath> {
        let observed = &self.model.observed(observations)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| {
            computed(py, |watch| hmm.viterbi(&watch.over(ys)))?
        });
        Ok(PyPath::of(py, found.map_err(|error| inference(py, 0, &error))?))
    }

    /// Returns the `count` most probable paths, best first. Raises MemoryError for more paths than
    /// fit into memory.
    fn k_best(
        &self,
        py: Python<'_>,
        observations: &Bound<'_, PyAny>,
        count: Size,
    ) -> PyResult<Vec<PyPath>> {
        let count = count.0;
        let observed = &self.model.observed(observations)?;
        paths_fit(self.model.states(), observed.steps(), count)?;
        let found = with_sequence!(&self.model, observed, |hmm, ys| {
            computed(py, |watch| hmm.k_best(&watch.over(ys), count))?
        });
        let paths = found.map_err(|error| inference(py, 0, &error))?;
        Ok(paths.into_iter().map(|path| PyPath::of(py, path)).collect())
    }

    /// Returns the log-likelihoods of many sequences, of any lengths. Short sequences take about a
    /// fifth of the time that `score` would need one by one.
    ///
    /// Parameters
    /// ----------
    /// sequences : list of observations, or observations with `lengths`
    ///     Without lengths, a list with one sequence in each place; with lengths, one array in
    ///     which the sequences follow one another.
    /// lengths : array of int, optional
    ///     Number of observations of each sequence.
    /// n_jobs : int
    ///     Number of threads (1), at most one on each processor; -1 for one on each.
    /// progress : callable, optional
    ///     Called with the number of sequences done and the number of all, ten times a second and
    ///     at the end.
    #[pyo3(signature = (sequences, lengths=None, *, n_jobs=1, progress=None))]
    fn score_all<'py>(
        &self,
        py: Python<'py>,
        sequences: &Bound<'py, PyAny>,
        lengths: Option<&Bound<'py, PyAny>>,
        n_jobs: isize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (all, way) =
            (self.model.many(sequences, lengths)?, Way { jobs: threads(n_jobs)?, progress });
        let scores = with_sequences!(&self.model, &all, |hmm, ys| {
            results(py, &way, hmm, ys, |ys| hmm.log_likelihood_all(ys))?
        });
        Ok(PyArray1::from_vec(py, scores))
    }

    /// Returns the probabilities of all states at each step of many sequences, of any lengths. The
    /// arguments are those of `score_all`.
    #[pyo3(signature = (sequences, lengths=None, *, n_jobs=1, progress=None))]
    fn smooth_all<'py>(
        &self,
        py: Python<'py>,
        sequences: &Bound<'py, PyAny>,
        lengths: Option<&Bound<'py, PyAny>>,
        n_jobs: isize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Vec<PySmoothed>> {
        let (all, way) =
            (self.model.many(sequences, lengths)?, Way { jobs: threads(n_jobs)?, progress });
        let smoothed = with_sequences!(&self.model, &all, |hmm, ys| {
            results(py, &way, hmm, ys, |ys| hmm.smooth_all(ys))?
        });
        smoothed.into_iter().map(|smoothed| PySmoothed::smoothed(py, smoothed)).collect()
    }

    /// Returns the most probable paths of many sequences, of any lengths. The arguments are those
    /// of `score_all`.
    #[pyo3(signature = (sequences, lengths=None, *, n_jobs=1, progress=None))]
    fn viterbi_all<'py>(
        &self,
        py: Python<'py>,
        sequences: &Bound<'py, PyAny>,
        lengths: Option<&Bound<'py, PyAny>>,
        n_jobs: isize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Vec<PyPath>> {
        let (all, way) =
            (self.model.many(sequences, lengths)?, Way { jobs: threads(n_jobs)?, progress });
        let paths = with_sequences!(&self.model, &all, |hmm, ys| {
            results(py, &way, hmm, ys, |ys| hmm.viterbi_all(ys))?
        });
        Ok(paths.into_iter().map(|path| PyPath::of(py, path)).collect())
    }

    /// Returns a live filter at the start.
    fn filter(this: &Bound<'_, Self>) -> PyFilter {
        PyFilter::new(this)
    }

    fn __repr__(&self) -> String {
        let moves = self.model.entries().map_or("dense".into(), |count| count.to_string());
        let of = match (self.model.table(), self.logarithms) {
            (Some(table), _) => format!("a table of {} symbols", table.symbols()),
            (None, true) => "log-likelihoods".into(),
            (None, false) => "likelihoods".into(),
        };
        format!("<Hmm: {} states, {moves} moves, {of}>", self.states())
    }
}
