//! Baum–Welch.

use std::ops::ControlFlow;

use numpy::{PyArray1, PyReadonlyArray2, PyUntypedArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::emission::Rows;
use wayfix::error::LearnError;
use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{Hmm, Likelihood, Prior, Transition};

use super::family::{AnyFamily, PyFamily};
use crate::array::{self, matrix};
use crate::error::invalid;
use crate::kinds::Model;
use crate::model::PyHmm;
use crate::parts::{dense_moves, rows, sparse_moves};
use crate::typed::Size;
use crate::watch::{Watch, computed, unwind};

/// Model that `learn` learned.
///
/// Attributes
/// ----------
/// hmm : Hmm
///     The model. With a family, its observations are those of `family.log_likelihoods(rows)`.
/// family : Family or None
///     The family with what was learned of it.
/// objectives : array
///     The objective before learning and after each iteration: the log-likelihood, and the
///     logarithm of the priors that pseudo-counts stand for.
/// log_likelihood : float
///     Log-likelihood of all sequences that were not left out.
/// converged, stopped : bool
///     True if the last iteration gained less than the tolerance, or `progress` ended learning.
/// cause : str or None
///     Reason for an end before that.
/// left_out : list of tuple
///     Sequences that the first model rules out: their indices, and why.
/// aic, bic : float
///     Information criteria.
#[pyclass(name = "Learned", module = "wayfix.learning", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PyLearned {
    hmm: Py<PyAny>,
    family: Option<Py<PyFamily>>,
    objectives: Py<PyArray1<f64>>,
    log_likelihood: f64,
    converged: bool,
    stopped: bool,
    cause: Option<String>,
    left_out: Vec<(usize, String)>,
    aic: f64,
    bic: f64,
}

#[pymethods]
impl PyLearned {
    /// Number of iterations.
    #[getter]
    fn iterations(&self, py: Python<'_>) -> usize {
        self.objectives.bind(py).len() - 1
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (iterations, log) = (self.iterations(py), self.log_likelihood);
        format!("<Learned: {iterations} iterations, log-likelihood {log}>")
    }
}

/// A learned model, or why there is none.
type Learning<A, B> = Result<LearnedModel<A, B>, LearnError>;

/// Learns, and tells of each iteration.
fn run<A, B>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch, &mut dyn FnMut(&LearnedModel<A, B>) -> ControlFlow<()>) -> Learning<A, B>
    + Send,
) -> PyResult<LearnedModel<A, B>>
where
    LearnedModel<A, B>: Send,
{
    let progress = progress.map(|progress| progress.clone().unbind());
    let ends = |now: &LearnedModel<A, B>| {
        let Some(progress) = &progress else { return false };
        let called = Python::attach(|py| {
            progress.bind(py).call1((now.iterations(), now.objective()))?.is_truthy()
        });
        called.unwrap_or_else(|raised| unwind(raised))
    };
    let mut tell =
        |now: &_| if ends(now) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    computed(py, |watch| work(watch, &mut tell))?.map_err(invalid)
}

/// Returns the learned model with its moves as arrays.
fn learned<A: Transition, B: Likelihood>(
    py: Python<'_>,
    found: &LearnedModel<A, B>,
    moves: Bound<'_, PyAny>,
    table: Option<Bound<'_, PyAny>>,
    family: Option<PyFamily>,
) -> PyResult<PyLearned> {
    let prior = found.model().prior();
    let named = PyDict::new(py);
    named.set_item("start_before_move", matches!(prior, Prior::BeforeFirstTransition(_)))?;
    named.set_item("logarithms", table.is_none())?;
    named.set_item("table", table)?;
    let start = prior.belief().as_slice().to_pyarray(py);
    let left_out = found.left_out().iter().map(|out| (out.sequence, out.source.to_string()));
    Ok(PyLearned {
        hmm: py.get_type::<PyHmm>().call((start, moves), Some(&named))?.unbind(),
        family: family.map(|family| Py::new(py, family)).transpose()?,
        objectives: found.objectives().to_pyarray(py).unbind(),
        log_likelihood: found.log_likelihood(),
        converged: found.converged(),
        stopped: found.stopped(),
        cause: found.cause().map(ToString::to_string),
        left_out: left_out.collect(),
        aic: found.criteria().aic(),
        bic: found.criteria().bic(),
    })
}

/// Reads rows of sequences, all of one width.
fn read<'py>(sequences: &[Bound<'py, PyAny>]) -> PyResult<Vec<PyReadonlyArray2<'py, f64>>> {
    sequences.iter().map(|sequence| array::rows(sequence, "observations")).collect()
}

fn rows_of<'a>(arrays: &'a [PyReadonlyArray2<'_, f64>]) -> PyResult<Vec<Rows<'a>>> {
    let width = arrays.first().map_or(0, |array| array.shape()[1]);
    let rows =
        |array| Rows::new(matrix(array, width, "observations")?, width.max(1)).map_err(invalid);
    arrays.iter().map(rows).collect()
}

/// Model of the moves of another, with a family for its sensor.
fn with_family<A: Transition + Clone, B: Likelihood>(
    hmm: &Hmm<A, B>,
    family: Option<&PyFamily>,
) -> PyResult<Hmm<A, AnyFamily>> {
    let Some(family) = family else {
        return Err(invalid("a model without a table needs a family to be learned"));
    };
    Hmm::new(hmm.prior().clone(), hmm.transition().clone(), family.0.clone()).map_err(invalid)
}

/// Learns start, moves and table or family from sequences, of any lengths: Baum–Welch, to a local
/// maximum of the likelihood.
///
/// Probabilities of 0 stay 0, and states that are alike stay alike. Ctrl-C ends it.
///
/// Parameters
/// ----------
/// hmm : Hmm
///     The model to begin with. With a table, the table is learned; without one, the `family`.
/// sequences : list of arrays
///     Symbols, or rows of numbers for a family.
/// family : Family, optional
///     Family to begin with.
/// iterations : int
///     Largest number of iterations (100).
/// tolerance : float
///     Gain of an iteration below which learning ends, in nats.
/// keep_start : bool
///     True to keep the start as it is.
/// start_count, move_count, table_count : float
///     Pseudo-counts of Dirichlet priors: 0 for maximum likelihood, 1 for Laplace's rule.
/// progress : callable, optional
///     Called with the number of each iteration and its objective; learning ends once it returns
///     something true.
///
/// Examples
/// --------
/// >>> import wayfix
/// >>> from wayfix.learning import learn
/// >>> hmm = wayfix.Hmm([0.5, 0.5], [[0.6, 0.4], [0.4, 0.6]], table=[[0.7, 0.3], [0.3, 0.7]])
/// >>> learned = learn(hmm, [[0, 0, 0, 0, 1, 1, 1], [1, 1, 1, 0, 0, 0, 0, 0]])
/// >>> bool(learned.log_likelihood > learned.objectives[0] + 2)
/// True
/// >>> learned.hmm.viterbi([0, 0, 0, 1, 1]).states
/// array([0, 0, 0, 1, 1])
#[pyfunction]
#[pyo3(signature = (hmm, sequences, family=None, *, iterations=Size(100), tolerance=1e-3,
                    keep_start=false, start_count=0.0, move_count=0.0, table_count=0.0,
                    progress=None))]
#[expect(clippy::too_many_arguments, reason = "options, by name")]
pub(crate) fn learn(
    py: Python<'_>,
    hmm: &Bound<'_, PyHmm>,
    sequences: Vec<Bound<'_, PyAny>>,
    family: Option<&Bound<'_, PyFamily>>,
    iterations: Size,
    tolerance: f64,
    keep_start: bool,
    start_count: f64,
    move_count: f64,
    table_count: f64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyLearned> {
    let options = LearningOptions {
        iterations: iterations.0,
        tolerance,
        keep_prior: keep_start,
        prior_pseudo_count: start_count,
        transition_pseudo_count: move_count,
        likelihood_pseudo_count: table_count,
    };
    let family = family.map(Bound::get);
    let symbols = || -> PyResult<Vec<Vec<usize>>> {
        if family.is_some() {
            return Err(invalid("a model with a table is learned without a family"));
        }
        sequences.iter().map(|ys| array::indices(ys, "symbols")).collect()
    };
    match hmm.get().model() {
        Model::DenseTable(hmm) => {
            let symbols = symbols()?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_with(&watch.over_all(symbols), &options, tell)
            })?;
            let model = found.model();
            let moves = dense_moves(py, model.transition())?;
            learned(py, &found, moves, Some(rows(py, model.likelihood())?), None)
        }
        Model::SparseTable(hmm) => {
            let symbols = symbols()?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_with(&watch.over_all(symbols), &options, tell)
            })?;
            let model = found.model();
            let moves = sparse_moves(py, model.transition())?;
            learned(py, &found, moves, Some(rows(py, model.likelihood())?), None)
        }
        Model::DenseVector(hmm) => {
            let (hmm, arrays) = (with_family(hmm, family)?, read(&sequences)?);
            let rows = rows_of(&arrays)?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_with(&watch.over_all(rows), &options, tell)
            })?;
            let family = PyFamily(found.model().likelihood().clone());
            learned(py, &found, dense_moves(py, found.model().transition())?, None, Some(family))
        }
        Model::SparseVector(hmm) => {
            let (hmm, arrays) = (with_family(hmm, family)?, read(&sequences)?);
            let rows = rows_of(&arrays)?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_with(&watch.over_all(rows), &options, tell)
            })?;
            let family = PyFamily(found.model().likelihood().clone());
            learned(py, &found, sparse_moves(py, found.model().transition())?, None, Some(family))
        }
    }
}
