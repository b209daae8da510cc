//! The function `learn`: Baum–Welch for a model of any kind, with progress and Ctrl-C.

use std::ops::ControlFlow;

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use wayfix::error::{LearnError, SequenceError};
use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{Hmm, Likelihood, Transition};
use wayfix_learn::Rows;

use super::family::PyFamily;
use super::kinds::AnyFamily;
use super::learned::{PyLearned, learned};
use crate::array::{self, matrix};
use crate::error::{invalid, is_impossible, of_sequence, of_several};
use crate::kinds::Model;
use crate::model::PyHmm;
use crate::parts::{dense_moves, rows, sparse_moves};
use crate::typed::Size;
use crate::watch::{Watch, computed, unwind};

/// Learned model, or the reason why there is none.
type Learning<A, B> = Result<LearnedModel<A, B>, LearnError>;

/// Learns, and reports each iteration.
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
    // `Py`, not `Bound`: the closure runs without the global lock, and attaches only for the call.
    let ends = |now: &LearnedModel<A, B>| {
        let Some(progress) = &progress else { return false };
        let called = Python::attach(|py| {
            progress.bind(py).call1((now.iterations(), now.objective()))?.is_truthy()
        });
        // The library's callback has no way to return an exception; `computed` catches this one.
        called.unwrap_or_else(|raised| unwind(raised))
    };
    let mut tell = |now: &_| {
        // The first pass finds invalid sequences. Without this check, learning would go on without
        // them, and the user would hear of them only at the end.
        if not_valid(now).is_some() || ends(now) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let found = computed(py, |watch| work(watch, &mut tell))?;
    let found = found.map_err(|error| match error {
        LearnError::Sequence(error) => of_sequence(py, &error),
        LearnError::AllFailed(at) => of_sequence(py, &at.cause),
        other => invalid(other),
    })?;
    not_valid(&found).map_or(Ok(()), |error| Err(of_sequence(py, error)))?;
    Ok(found)
}

/// Returns the first sequence that was left out because it is invalid, not because the model rules
/// it out.
fn not_valid<A, B>(found: &LearnedModel<A, B>) -> Option<&SequenceError> {
    found.left_out().iter().find(|out| !is_impossible(&out.source))
}

/// Reads the rows of each sequence. That all have one width is checked in `rows_of`.
fn read<'py>(sequences: &[Bound<'py, PyAny>]) -> PyResult<Vec<PyReadonlyArray2<'py, f64>>> {
    let rows = |(number, sequence): (usize, &Bound<'py, PyAny>)| {
        array::rows(sequence, "observations")
            .map_err(|error| of_several(sequence.py(), number, &error))
    };
    sequences.iter().enumerate().map(rows).collect()
}

fn rows_of<'a>(arrays: &'a [PyReadonlyArray2<'_, f64>]) -> PyResult<Vec<Rows<'a>>> {
    let width = arrays.first().map_or(0, |array| array.shape()[1]);
    let rows =
        |array| Rows::new(matrix(array, width, "observations")?, width.max(1)).map_err(invalid);
    arrays.iter().map(rows).collect()
}

/// Returns a model with the moves of `hmm` and a family as its sensor.
fn with_family<A: Transition + Clone, B: Likelihood>(
    hmm: &Hmm<A, B>,
    family: Option<&PyFamily>,
) -> PyResult<Hmm<A, AnyFamily>> {
    let Some(family) = family else {
        return Err(invalid("a model without a table needs a family to be learned"));
    };
    Hmm::new(hmm.prior().clone(), hmm.transition().clone(), family.0.clone()).map_err(invalid)
}

/// Learns start, moves and table or family from sequences of any lengths, by Baum–Welch: to a local
/// maximum of the likelihood.
///
/// Probabilities of 0 stay 0, and states with equal parameters stay equal. Ctrl-C ends it.
///
/// Parameters
/// ----------
/// hmm : Hmm
///     The initial model. With a table, the table is learned; without one, the `family`.
/// sequences : list of arrays
///     Symbols, or rows of numbers for a family. An invalid sequence raises, with its number and
///     step; sequences that the model rules out are left out.
/// family : Family, optional
///     The initial family.
/// iterations : int
///     Largest number of iterations (100).
/// tolerance : float
///     Gain of an iteration below which learning ends, in nats.
/// keep_start : bool
///     True to keep the start probabilities as they are.
/// start_count, move_count, table_count : float
///     Pseudo-counts of Dirichlet priors: 0 for maximum likelihood, 1 for Laplace's rule.
/// progress : callable, optional
///     Called with the number and the objective of each iteration; learning ends once it returns a
///     true value.
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
    let options = LearningOptions::default()
        .with_iterations(iterations.0)
        .with_tolerance(tolerance)
        .with_keep_prior(keep_start)
        .with_prior_pseudo_count(start_count)
        .with_transition_pseudo_count(move_count)
        .with_likelihood_pseudo_count(table_count);
    let family = family.map(Bound::get);
    let symbols = || -> PyResult<Vec<Vec<usize>>> {
        // Otherwise the family would be ignored without a word.
        if family.is_some() {
            return Err(invalid("a model with a table is learned without a family"));
        }
        let read = |(sequence, ys)| {
            array::symbols(ys, &[]).map_err(|error| of_several(py, sequence, &error))
        };
        sequences.iter().enumerate().map(read).collect()
    };
    match hmm.get().model() {
        // The branches differ only in types: the learned moves are returned in the form in which
        // they were given, together with either a table or a family.
        Model::DenseTable(hmm) => {
            let symbols = symbols()?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_until(&watch.over_all(symbols), &options, tell)
            })?;
            let model = found.model();
            let moves = dense_moves(py, model.transition())?;
            learned(py, &found, moves, Some(rows(py, model.likelihood())?), None)
        }
        Model::SparseTable(hmm) => {
            let symbols = symbols()?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_until(&watch.over_all(symbols), &options, tell)
            })?;
            let model = found.model();
            let moves = sparse_moves(py, model.transition())?;
            learned(py, &found, moves, Some(rows(py, model.likelihood())?), None)
        }
        Model::DenseVector(hmm) => {
            let (hmm, arrays) = (with_family(hmm, family)?, read(&sequences)?);
            let rows = rows_of(&arrays)?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_until(&watch.over_all(rows), &options, tell)
            })?;
            let family = PyFamily(found.model().likelihood().clone());
            learned(py, &found, dense_moves(py, found.model().transition())?, None, Some(family))
        }
        Model::SparseVector(hmm) => {
            let (hmm, arrays) = (with_family(hmm, family)?, read(&sequences)?);
            let rows = rows_of(&arrays)?;
            let found = run(py, progress, |watch, tell| {
                hmm.learn_until(&watch.over_all(rows), &options, tell)
            })?;
            let family = PyFamily(found.model().likelihood().clone());
            learned(py, &found, sparse_moves(py, found.model().transition())?, None, Some(family))
        }
    }
}
