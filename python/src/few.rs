//! Expectations of one sequence, from what the filter and the smoother return.
//!
//! ξ_k(i, j) = α_k(i) A(i, j) γ_{k+1}(j) / p_{k+1}(j) with p_{k+1} = A' α_k, and 0 where p is 0: so the
//! sum over k is A times a sum of products of α_k and γ_{k+1} / p_{k+1}, which needs no entry of A.
//! The library's own expectations take many sequences side by side, and are slower for one.

use pyo3::prelude::*;
use wayfix::LikelihoodVector;

use crate::error::inference;
use crate::sequences::{Input, model, normalized};

/// What a re-estimation needs.
pub(crate) struct Expected {
    pub(crate) log_likelihood: f64,
    pub(crate) posteriors: Vec<f64>,
    pub(crate) first: Vec<f64>,
    /// Expected moves, from the state of the row.
    pub(crate) moves: Vec<f64>,
}

/// Largest number of sequences: the library takes two side by side.
const FEW: usize = 1;
/// Number of steps from which on the library cuts a sequence into segments that go side by side.
const LONG: usize = 2048;
/// Prediction below which a product may leave the range of doubles.
const LEAST: f64 = 1e-280;

/// Returns the expectations of a sequence that is not long, or `None` if there are more, or numbers
/// beyond the range of doubles.
pub(crate) fn expectations(
    py: Python<'_>,
    start: &[f64],
    transitions: &[f64],
    input: &Input<'_>,
) -> PyResult<Option<Expected>> {
    if input.lengths.len() > FEW || input.lengths.iter().any(|length| *length >= LONG) {
        return Ok(None);
    }
    let n = input.states;
    let transitions = &normalized(transitions, n);
    let hmm = model(start, transitions, LikelihoodVector::log(n))?;
    let mut sum = Expected {
        log_likelihood: 0.0,
        posteriors: Vec::with_capacity(input.values.len()),
        first: vec![0.0; n],
        moves: vec![0.0; n * n],
    };
    let (mut predicted, mut ratio) = (vec![0.0; n], vec![0.0; n]);
    for (number, rows) in input.sequences()?.into_iter().enumerate() {
        let done = py.detach(|| hmm.forward(&rows).and_then(|f| Ok((f, hmm.smooth(&rows)?))));
        let (filtered, smoothed) = done.map_err(|error| inference(py, number, &error))?;
        if filtered.steps_in_logs() + smoothed.steps_in_logs() > 0 {
            return Ok(None);
        }
        // Step 0 is before the first observation.
        let filtered = filtered.posteriors().as_slice()[n..].chunks_exact(n);
        let after = &smoothed.posteriors().as_slice()[n..];
        sum.first.iter_mut().zip(after).for_each(|(sum, p)| *sum += p);
        for (before, after) in filtered.zip(after[n..].chunks_exact(n)) {
            predicted.fill(0.0);
            for (alpha, row) in before.iter().zip(transitions.chunks_exact(n)) {
                predicted.iter_mut().zip(row).for_each(|(sum, a)| *sum += alpha * a);
            }
            for ((ratio, p), gamma) in ratio.iter_mut().zip(&predicted).zip(after) {
                if *p < LEAST && *gamma > 0.0 {
                    return Ok(None);
                }
                *ratio = if *gamma > 0.0 { gamma / p } else { 0.0 };
            }
            for (alpha, sums) in before.iter().zip(sum.moves.chunks_exact_mut(n)) {
                sums.iter_mut().zip(&ratio).for_each(|(sum, ratio)| *sum += alpha * ratio);
            }
        }
        sum.posteriors.extend_from_slice(after);
        sum.log_likelihood += smoothed.log_likelihood();
    }
    sum.moves.iter_mut().zip(transitions).for_each(|(sum, a)| *sum *= a);
    Ok(Some(sum))
}
