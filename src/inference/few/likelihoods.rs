//! Likelihoods of consecutive steps, in one block.

use std::f64::consts::LN_2;
use std::ops::Range;

use super::super::scores::{TakenOut, likelihood_scores};
use crate::hmm::Hmm;
use crate::kernels::{self, Scores, ScoresIn, Valid};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::range::{LARGEST_LOG, LEAST_FACTOR, UNSCALED, exponent, power};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Likelihoods of a sequence, without its type: code that uses them is compiled once, with this
/// crate.
pub(super) trait Rows {
    /// Copies the likelihoods of some steps, and writes to `logs` the logarithms of what was taken
    /// out of each. `None` if some are not valid or have too wide a range.
    ///
    /// With `scaled`, the largest of each step is brought near one; otherwise, steps whose
    /// likelihoods are not in logarithms are left as they are, none above 2^16.
    fn likelihoods(
        &mut self,
        steps: Range<usize>,
        scaled: bool,
        out: &mut [f64],
        logs: &mut [f64],
    ) -> Option<()>;

    /// Copies the scores of some steps, log2 of likelihoods up to parts that are taken out.
    fn scores(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Option<()>;
}

/// Likelihoods of a model's sensor.
pub(super) struct Sensed<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    scratch: Scratch,
}

impl<'m, A, B, S: ?Sized> Sensed<'m, A, B, S> {
    pub(super) fn new(hmm: &'m Hmm<A, B>, sequence: &'m S) -> Self {
        Self { hmm, sequence, scratch: Scratch::default() }
    }
}

impl<A, B, S> Rows for Sensed<'_, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    fn likelihoods(
        &mut self,
        steps: Range<usize>,
        scaled: bool,
        out: &mut [f64],
        logs: &mut [f64],
    ) -> Option<()> {
        let states = self.hmm.states();
        let (mut most, mut checked) = (0.0_f64, true);
        logs.fill(0.0);
        for ((step, row), log) in steps.zip(out.chunks_exact_mut(states)).zip(logs) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let linear = match diagonal.values {
                Values::Checked { linear, largest, .. } if diagonal.log_factor == 0.0 => {
                    most = most.max(largest);
                    linear
                }
                Values::Linear(linear) if diagonal.log_factor == 0.0 => {
                    checked = false;
                    linear
                }
                _ => {
                    *log = scale(&diagonal, row)?;
                    continue;
                }
            };
            if scaled {
                *log = scale(&diagonal, row)?;
            } else {
                copy(linear, row)?;
            }
        }
        if !checked {
            most = most.max(kernels::largest(out, Valid::Likelihoods).ok()?);
        }
        (scaled || most <= *UNSCALED.end()).then_some(())
    }

    fn scores(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Option<()> {
        let (states, mut form) = (self.hmm.states(), None);
        for (step, row) in steps.zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let (values, next) = match diagonal.values {
                _ if diagonal.log_factor != 0.0 => {
                    write_scores(&diagonal, row, taken_out)?;
                    continue;
                }
                Values::Checked { log2: Some(log2), .. } => (log2, ScoresIn::Log2),
                Values::Linear(linear) => (linear, ScoresIn::Linear),
                _ => {
                    write_scores(&diagonal, row, taken_out)?;
                    continue;
                }
            };
            // One form for all: it is converted at once.
            if *form.get_or_insert(next) != next {
                return None;
            }
            copy(values, row)?;
        }
        if form == Some(ScoresIn::Linear) {
            kernels::largest(out, Valid::Likelihoods).ok()?;
            kernels::log2_in_place(out);
        }
        Some(())
    }
}

/// Copies a row of few values. (A copy of unknown length is a call.)
#[inline(always)]
fn copy(values: &[f64], out: &mut [f64]) -> Option<()> {
    macro_rules! copy_arrays {
        ($($n:literal)*) => {
            match out.len() {
                $($n => *out.first_chunk_mut::<$n>()? = *values.first_chunk::<$n>()?,)*
                _ => out.copy_from_slice(values.get(..out.len())?),
            }
        };
    }
    copy_arrays!(2 3 4 8);
    (values.len() == out.len()).then_some(())
}

/// Scores of any diagonal.
#[inline(never)]
fn write_scores(diagonal: &Diagonal<'_>, out: &mut [f64], taken_out: &mut TakenOut) -> Option<()> {
    let largest = diagonal.check(out.len()).ok()?;
    let scores: Scores<'_> = likelihood_scores(diagonal, largest, taken_out)?;
    scores.write(out);
    Some(())
}

/// Likelihoods of any diagonal, with the largest near one. Returns the logarithm of what was taken
/// out.
#[inline(never)]
fn scale(diagonal: &Diagonal<'_>, out: &mut [f64]) -> Option<f64> {
    let largest = diagonal.check(out.len()).ok()?;
    if diagonal.log_factor.is_nan() || diagonal.log_factor.abs() > LARGEST_LOG {
        return None;
    }
    let (mut lost, mut log) = (false, diagonal.log_factor);
    match diagonal.values {
        Values::Log(logs) => {
            if largest == f64::NEG_INFINITY {
                return None;
            }
            log += largest;
            for (b, &log) in out.iter_mut().zip(logs) {
                *b = (log - largest).exp();
                lost |= *b < LEAST_FACTOR && log > f64::NEG_INFINITY;
            }
        }
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            let by = if UNSCALED.contains(&largest) { 0 } else { exponent(largest) };
            if by.abs() > 1000 {
                return None;
            }
            log += by as f64 * LN_2;
            for (out, b) in out.iter_mut().zip(linear) {
                *out = b * power(-by);
                lost |= *b > 0.0 && *out < LEAST_FACTOR;
            }
        }
    }
    (!lost).then_some(log)
}
