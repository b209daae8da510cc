//! Functions of a dense model and the log-likelihoods of all states at each step of several
//! sequences, one after another: what `wayfix.hmmlearn` is built on.

use std::error::Error;
use std::sync::atomic::{AtomicU64, Ordering};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use wayfix::emission::Rows;
use wayfix::error::LikelihoodError;
use wayfix::inference::{SmoothedSequence, ViterbiPath};
use wayfix::likelihood::{Diagonal, LearnLikelihood, Scratch};
use wayfix::{Belief, DenseTransition, Hmm, Likelihood, LikelihoodVector, Prior};

use crate::array::{contiguous, matrix};
use crate::error::{invalid, of_sequence};
use crate::few;
use crate::many::{check, collect};

/// Log-likelihoods of all rows, and where the sequences end.
pub(crate) struct Input<'a> {
    pub(crate) values: &'a [f64],
    pub(crate) states: usize,
    pub(crate) lengths: &'a [usize],
}

impl<'a> Input<'a> {
    fn new(values: &'a [f64], states: usize, lengths: &'a [usize]) -> PyResult<Self> {
        let rows = values.len() / states.max(1);
        let sum: usize = lengths.iter().sum();
        if sum != rows || lengths.contains(&0) {
            return Err(invalid(format!(
                "lengths of {} sequences sum to {sum}, expected {rows}, each above 0",
                lengths.len()
            )));
        }
        Ok(Self { values, states, lengths })
    }

    pub(crate) fn sequences(&self) -> PyResult<Vec<Rows<'a>>> {
        let mut rest = self.values;
        let part = |&length: &usize| {
            let (part, after) = rest.split_at(length * self.states);
            rest = after;
            Rows::new(part, self.states).map_err(invalid)
        };
        self.lengths.iter().map(part).collect()
    }
}

/// Creates a model whose observations are rows of log-likelihoods, from probabilities of the
/// first states and rows of transitions, each of which is divided by its sum.
pub(crate) fn model<B: Likelihood>(
    start: &[f64],
    transitions: &[f64],
    sensor: B,
) -> PyResult<Hmm<DenseTransition, B>> {
    let n = start.len();
    let prior = Prior::AtFirstObservation(Belief::from_weights(start.to_vec()).map_err(invalid)?);
    let rows = normalized(transitions, n);
    let dense = DenseTransition::from_fn(n, |to, from| rows[from * n + to]).map_err(invalid)?;
    Hmm::new(prior, dense, sensor).map_err(invalid)
}

/// Returns rows divided by their sums, which are one up to 1e-5.
pub(crate) fn normalized(rows: &[f64], n: usize) -> Vec<f64> {
    let mut rows = rows.to_vec();
    for row in rows.chunks_exact_mut(n) {
        let sum: f64 = row.iter().sum();
        for p in row {
            *p /= sum;
        }
    }
    rows
}

/// Returns true if each row sums to one, up to 1e-5.
#[pyfunction]
pub(crate) fn rows_sum_to_one(rows: PyReadonlyArray2<'_, f64>) -> bool {
    let array = rows.as_array();
    array.rows().into_iter().all(|row| (row.sum() - 1.0).abs() <= 1e-5)
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
    let (n, start, transitions) = parameters(&start, &transitions)?;
    let input = Input::new(matrix(&logs, n, "log-likelihoods")?, n, &lengths)?;
    let hmm = model(start, transitions, LikelihoodVector::log(n))?;
    let sequences = input.sequences()?;
    let mut scores = Vec::with_capacity(lengths.len());
    check(py, py.detach(|| hmm.log_likelihood_map_all(sequences, collect(&mut scores, |s| s))))?;
    Ok(scores.to_pyarray(py))
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
    let (n, start, transitions) = parameters(&start, &transitions)?;
    let input = Input::new(matrix(&logs, n, "log-likelihoods")?, n, &lengths)?;
    let hmm = model(start, transitions, LikelihoodVector::log(n))?;
    let sequences = input.sequences()?;
    let mut scores = Vec::with_capacity(lengths.len());
    let mut posteriors = Vec::with_capacity(input.values.len());
    let keep = |smoothed: SmoothedSequence| {
        // Step 0 is before the first observation.
        posteriors.extend_from_slice(&smoothed.posteriors().as_slice()[n..]);
        smoothed.log_likelihood()
    };
    check(py, py.detach(|| hmm.smooth_map_all(sequences, collect(&mut scores, keep))))?;
    let rows = posteriors.len() / n;
    let posteriors = PyArray1::from_vec(py, posteriors).reshape([rows, n])?;
    Ok((scores.to_pyarray(py), posteriors))
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
    let (n, start, transitions) = parameters(&start, &transitions)?;
    let input = Input::new(matrix(&logs, n, "log-likelihoods")?, n, &lengths)?;
    let hmm = model(start, transitions, LikelihoodVector::log(n))?;
    let sequences = input.sequences()?;
    let mut scores = Vec::with_capacity(lengths.len());
    let mut states = Vec::with_capacity(input.values.len() / n);
    let keep = |path: ViterbiPath| {
        states.extend(path.states().iter().map(|state| i64::try_from(*state).unwrap_or(i64::MAX)));
        path.log_probability()
    };
    check(py, py.detach(|| hmm.viterbi_map_all(sequences, collect(&mut scores, keep))))?;
    Ok((scores.to_pyarray(py), states.to_pyarray(py)))
}

/// Returns what a re-estimation needs: the log-likelihood of all sequences, the probabilities of
/// all states at each step, and the expected numbers of starts and of moves (from, to).
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
    let (n, start, transitions) = parameters(&start, &transitions)?;
    let values = matrix(&logs, n, "log-likelihoods")?;
    let input = Input::new(values, n, &lengths)?;
    if let Some(found) = few::expectations(py, start, transitions, &input)? {
        let few::Expected { log_likelihood, posteriors, first, moves } = found;
        let posteriors = PyArray1::from_vec(py, posteriors).reshape([values.len() / n, n])?;
        let moves = PyArray1::from_vec(py, moves).reshape([n, n])?;
        return Ok((log_likelihood, posteriors, first.to_pyarray(py), moves));
    }
    let posteriors: Vec<AtomicU64> = values.iter().map(|_| AtomicU64::new(0)).collect();
    let recorder = Recorder { states: n, values, posteriors: &posteriors };
    let hmm = model(start, transitions, recorder)?;
    let sequences = input.sequences()?;
    let (expected, failed) = py.detach(|| hmm.expectations(&sequences));
    if let Some(error) = failed.first() {
        return Err(of_sequence(py, error));
    }
    let mut moves = vec![0.0; n * n];
    expected.moves().moves().for_each(|m| moves[m.from * n + m.to] += m.weight);
    let log_likelihood = expected.log_likelihood();
    let first = expected.first().to_pyarray(py);
    let posteriors: Vec<f64> =
        posteriors.into_iter().map(|bits| f64::from_bits(bits.into_inner())).collect();
    let posteriors = PyArray1::from_vec(py, posteriors).reshape([values.len() / n, n])?;
    let moves = PyArray1::from_vec(py, moves).reshape([n, n])?;
    Ok((log_likelihood, posteriors, first, moves))
}

/// A sensor whose observations are rows of log-likelihoods, and whose statistics are the
/// probabilities of the states at each of them.
#[derive(Debug)]
struct Recorder<'a> {
    states: usize,
    values: &'a [f64],
    /// Bits of the probabilities, in the places of `values`: each is written once, by whatever
    /// thread has it.
    posteriors: &'a [AtomicU64],
}

impl Likelihood for Recorder<'_> {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(Diagonal::log(observation))
    }

    fn is_precomputed(&self) -> bool {
        true
    }
}

impl LearnLikelihood for Recorder<'_> {
    type Statistics = ();

    fn statistics(&self) {}

    fn add(&self, (): &mut (), observation: &[f64], posterior: &[f64]) {
        // Observations are slices of the values.
        let bytes = observation.as_ptr().addr() - self.values.as_ptr().addr();
        let place = bytes / size_of::<f64>();
        let out = &self.posteriors[place..place + self.states];
        out.iter().zip(posterior).for_each(|(out, p)| out.store(p.to_bits(), Ordering::Relaxed));
    }

    fn merge(&self, (): &mut (), (): &()) {}

    fn maximize(&self, (): &(), _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Err("the caller re-estimates".into())
    }

    fn free_parameters(&self) -> usize {
        0
    }
}

/// Returns the number of states, and the checked parameters of a model.
fn parameters<'a>(
    start: &'a PyReadonlyArray1<'_, f64>,
    transitions: &'a PyReadonlyArray2<'_, f64>,
) -> PyResult<(usize, &'a [f64], &'a [f64])> {
    let start = contiguous(start.as_slice(), "start probabilities")?;
    let n = start.len();
    let transitions = matrix(transitions, n, "transitions")?;
    if transitions.len() != n * n {
        let rows = transitions.len() / n.max(1);
        return Err(invalid(format!("transitions have {rows} rows, expected {n}")));
    }
    Ok((n, start, transitions))
}
