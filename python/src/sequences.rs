//! Functions beneath `wayfix.hmmlearn`: inference by a dense model, given the log-likelihoods of
//! all states at each step of several sequences, which follow one another in one array.
//!
//! The Python classes compute the log-likelihoods, or `densities` does; so their families of
//! observations, and those that a user derives from them, need nothing of the library.

use std::sync::atomic::AtomicU64;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use wayfix::inference::{SmoothedSequence, ViterbiPath};
use wayfix::{Belief, DenseTransition, Hmm, Likelihood, LikelihoodVector, Prior};
use wayfix_learn::Rows;

use crate::array::{contiguous, matrix};
use crate::error::{invalid, of_sequence};
use crate::kinds::split;
use crate::many::in_chunks;
use crate::recorder::Recorder;
use crate::results::states_of;
use crate::watch::{Watch, Watched, computed};

/// Parameters of a chain, and log-likelihoods of all rows with the lengths of the sequences.
struct Input<'a> {
    states: usize,
    start: &'a [f64],
    transitions: &'a [f64],
    values: &'a [f64],
    sequences: Vec<Rows<'a>>,
}

impl<'a> Input<'a> {
    fn new(
        start: &'a PyReadonlyArray1<'_, f64>,
        transitions: &'a PyReadonlyArray2<'_, f64>,
        logs: &'a PyReadonlyArray2<'_, f64>,
        lengths: &[usize],
    ) -> PyResult<Self> {
        let start = contiguous(start.as_slice(), "start probabilities")?;
        let states = start.len();
        if states == 0 {
            return Err(invalid("there are no states, expected at least one"));
        }
        let transitions = matrix(transitions, states, "transitions")?;
        if transitions.len() != states * states {
            let rows = transitions.len() / states;
            return Err(invalid(format!("transitions have {rows} rows, expected {states}")));
        }
        let values = matrix(logs, states, "log-likelihoods")?;
        let parts = split(values, lengths, states)?;
        let rows = |part| Rows::new(part, states).map_err(invalid);
        let sequences = parts.into_iter().map(rows).collect::<PyResult<_>>()?;
        Ok(Self { states, start, transitions, values, sequences })
    }

    /// Creates a model with this sensor. Rows of transitions are divided by their sums: hmmlearn
    /// accepts rows that sum to one up to 1e-5, and the library is stricter.
    fn model<B: Likelihood>(&self, sensor: B) -> PyResult<Hmm<DenseTransition, B>> {
        let n = self.states;
        // The start is divided by its sum for the same reason.
        let belief = Belief::from_weights(self.start.to_vec()).map_err(invalid)?;
        let mut rows = self.transitions.to_vec();
        for row in rows.chunks_exact_mut(n) {
            let sum: f64 = row.iter().sum();
            // A row of zeros becomes NaN, which the operator refuses.
            for p in row {
                *p /= sum;
            }
        }
        let dense = DenseTransition::from_fn(n, |to, from| rows[from * n + to]);
        let prior = Prior::AtFirstObservation(belief);
        Hmm::new(prior, dense.map_err(invalid)?, sensor).map_err(invalid)
    }

    /// Creates a model whose observations are rows of log-likelihoods.
    fn of_rows(&self) -> PyResult<Hmm<DenseTransition, LikelihoodVector>> {
        self.model(LikelihoodVector::log(self.states))
    }

    fn watched<'w>(&self, watch: &'w Watch) -> Vec<Watched<'w, Rows<'a>>> {
        watch.over_all(self.sequences.clone())
    }

    /// Makes an array of the values of all rows.
    fn rows<'py>(&self, py: Python<'py>, values: Vec<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = values.len() / self.states;
        PyArray1::from_vec(py, values).reshape([rows, self.states])
    }
}

/// True if each row is a distribution: no number below 0, and a sum of one up to 1e-5.
#[pyfunction]
pub(crate) fn are_distributions(rows: PyReadonlyArray2<'_, f64>) -> bool {
    let array = rows.as_array();
    // Both comparisons are false for NaN.
    let is_one = |row: &[f64]| {
        row.iter().all(|p| *p >= 0.0) && (row.iter().sum::<f64>() - 1.0).abs() <= 1e-5
    };
    array.rows().into_iter().all(|row| row.as_slice().map_or_else(|| is_one(&row.to_vec()), is_one))
}

/// Returns the log-likelihood of each sequence.
#[pyfunction]
pub(crate) fn log_likelihoods<'py>(
    py: Python<'py>,
    start: PyReadonlyArray1<'py, f64>,
    transitions: PyReadonlyArray2<'py, f64>,
    logs: PyReadonlyArray2<'py, f64>,
    lengths: Vec<usize>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let input = Input::new(&start, &transitions, &logs, &lengths)?;
    let hmm = input.of_rows()?;
    let mut scores = Vec::with_capacity(lengths.len());
    let run = |watch: &Watch| {
        let keep = |score| scores.push(score);
        in_chunks(&hmm, watch, input.sequences.clone(), |ys| hmm.log_likelihood_all(ys), keep)
    };
    computed(py, run)?.map_err(|error| of_sequence(py, &error))?;
    Ok(PyArray1::from_vec(py, scores))
}

/// Returns the log-likelihood of each sequence, and the probabilities of all states at each step.
#[pyfunction]
#[expect(clippy::type_complexity, reason = "a tuple of arrays, as Python's callers take it")]
pub(crate) fn smooth<'py>(
    py: Python<'py>,
    start: PyReadonlyArray1<'py, f64>,
    transitions: PyReadonlyArray2<'py, f64>,
    logs: PyReadonlyArray2<'py, f64>,
    lengths: Vec<usize>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
    let input = Input::new(&start, &transitions, &logs, &lengths)?;
    let (hmm, n) = (input.of_rows()?, input.states);
    let mut scores = Vec::with_capacity(lengths.len());
    let mut posteriors = Vec::new();
    let run = |watch: &Watch| {
        // The first row of a result is step 0, before the first observation. A single result is
        // kept in its own memory, since a copy might not fit beside it.
        let keep = |smoothed: SmoothedSequence| {
            scores.push(smoothed.log_likelihood());
            if lengths.len() == 1 {
                posteriors = smoothed.into_posteriors().into_vec();
                posteriors.drain(..n);
            } else {
                // The first sequence reserves room for all of them, and later ones reserve nothing.
                posteriors.reserve_exact(input.values.len() - posteriors.len());
                posteriors.extend_from_slice(&smoothed.posteriors().as_slice()[n..]);
            }
        };
        in_chunks(&hmm, watch, input.sequences.clone(), |ys| hmm.smooth_all(ys), keep)
    };
    computed(py, run)?.map_err(|error| of_sequence(py, &error))?;
    Ok((PyArray1::from_vec(py, scores), input.rows(py, posteriors)?))
}

/// Returns the log-probability of each best path, and the states of all steps.
#[pyfunction]
#[expect(clippy::type_complexity, reason = "a tuple of arrays, as Python's callers take it")]
pub(crate) fn viterbi<'py>(
    py: Python<'py>,
    start: PyReadonlyArray1<'py, f64>,
    transitions: PyReadonlyArray2<'py, f64>,
    logs: PyReadonlyArray2<'py, f64>,
    lengths: Vec<usize>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>)> {
    let input = Input::new(&start, &transitions, &logs, &lengths)?;
    let hmm = input.of_rows()?;
    let mut scores = Vec::with_capacity(lengths.len());
    let mut states = Vec::with_capacity(input.values.len() / input.states);
    let run = |watch: &Watch| {
        let keep = |path: ViterbiPath| {
            scores.push(path.log_probability());
            states.extend(states_of(path));
        };
        in_chunks(&hmm, watch, input.sequences.clone(), |ys| hmm.viterbi_all(ys), keep)
    };
    computed(py, run)?.map_err(|error| of_sequence(py, &error))?;
    Ok((PyArray1::from_vec(py, scores), PyArray1::from_vec(py, states)))
}

/// Returns the expectations for an M-step: the log-likelihood of all sequences, the probabilities
/// of all states at each step, and the expected numbers of starts and of moves (from, to).
#[pyfunction]
#[expect(clippy::type_complexity, reason = "a tuple of arrays, as Python's callers take it")]
pub(crate) fn expectations<'py>(
    py: Python<'py>,
    start: PyReadonlyArray1<'py, f64>,
    transitions: PyReadonlyArray2<'py, f64>,
    logs: PyReadonlyArray2<'py, f64>,
    lengths: Vec<usize>,
) -> PyResult<(f64, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)>
{
    let input = Input::new(&start, &transitions, &logs, &lengths)?;
    let n = input.states;
    // Zero bits are the number 0. Each row is written by the thread that has its sequence.
    let bits: Vec<AtomicU64> = input.values.iter().map(|_| AtomicU64::new(0)).collect();
    let hmm = input.model(Recorder::new(n, input.values, &bits))?;
    let run = |watch: &Watch| hmm.expectations(&input.watched(watch));
    let (expected, failed) = computed(py, run)?;
    // hmmlearn has no notion of leaving a sequence out: the first that fails raises.
    if let Some(error) = failed.first() {
        return Err(of_sequence(py, error));
    }
    let mut moves = vec![0.0; n * n];
    expected.moves().moves().for_each(|m| moves[m.from * n + m.to] += m.weight);
    let log_likelihood = expected.log_likelihood();
    let first = expected.first().to_pyarray(py);
    let posteriors = bits.into_iter().map(|bits| f64::from_bits(bits.into_inner())).collect();
    let posteriors = input.rows(py, posteriors)?;
    let moves = PyArray1::from_vec(py, moves).reshape([n, n])?;
    Ok((log_likelihood, posteriors, first, moves))
}
