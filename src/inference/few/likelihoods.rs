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

/// Largest likelihoods from this to its inverse leave scores as they are.
const NEAR: f64 = power(-16);

/// Likelihoods of a sequence, without its type: code that uses them is compiled once, with this
/// crate.
pub(super) trait Rows {
    /// Copies the likelihoods of some steps. Returns true if something was taken out of them, and
    /// then writes its logarithms to `logs`; `None` if some are not valid or have too wide a range.
    ///
    /// With `scaled`, the largest of each step is brought near one; otherwise, steps whose
    /// likelihoods are not in logarithms are left as they are, none above 2^16.
    fn likelihoods(
        &mut self,
        steps: Range<usize>,
        scaled: bool,
        out: &mut [f64],
        logs: &mut [f64],
    ) -> Option<bool>;

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

impl<A, B, S> Sensed<'_, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    /// [`Rows::likelihoods`] of N states, or of any number for N = 0: a copy of a length that is
    /// not known is a call.
    #[inline(always)]
    fn copy_likelihoods<const N: usize>(
        &mut self,
        steps: Range<usize>,
        scaled: bool,
        out: &mut [f64],
        logs: &mut [f64],
    ) -> Option<bool> {
        let states = if N > 0 { N } else { self.hmm.states() };
        let (mut most, mut checked, mut any_log) = (0.0_f64, true, false);
        for ((number, step), row) in steps.enumerate().zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let linear = match diagonal.values {
                Values::Checked { linear, largest, .. } => {
                    most = if largest > most { largest } else { most };
                    linear
                }
                Values::Linear(linear) => {
                    checked = false;
                    linear
                }
                Values::Log(_) => &[],
            };
            if scaled || linear.is_empty() || diagonal.log_factor != 0.0 {
                if !any_log {
                    logs.fill(0.0);
                    any_log = true;
                }
                *logs.get_mut(number)? = scale(diagonal, row)?;
            } else if N > 0 {
                *row.first_chunk_mut::<N>()? = *<&[f64; N]>::try_from(linear).ok()?;
            } else {
                (linear.len() == states).then(|| row.copy_from_slice(linear))?;
            }
        }
        if !checked {
            most = most.max(kernels::largest(out, Valid::Likelihoods).ok()?);
        }
        (scaled || most <= *UNSCALED.end()).then_some(any_log)
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
    ) -> Option<bool> {
        match self.hmm.states() {
            2 => self.copy_likelihoods::<2>(steps, scaled, out, logs),
            3 => self.copy_likelihoods::<3>(steps, scaled, out, logs),
            4 => self.copy_likelihoods::<4>(steps, scaled, out, logs),
            8 => self.copy_likelihoods::<8>(steps, scaled, out, logs),
            _ => self.copy_likelihoods::<0>(steps, scaled, out, logs),
        }
    }

    fn scores(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Option<()> {
        let (states, mut form, mut far) = (self.hmm.states(), None, false);
        let is_near = |largest: f64| (NEAR..=1.0 / NEAR).contains(&largest);
        for (step, row) in steps.zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let next = match diagonal.values {
                Values::Checked { log2: Some(log2), largest, .. }
                    if diagonal.log_factor == 0.0 && is_near(largest) =>
                {
                    copy(log2, row)?;
                    ScoresIn::Log2
                }
                Values::Linear(linear) if diagonal.log_factor == 0.0 => {
                    copy(linear, row)?;
                    far |= !is_near(row.iter().fold(0.0, |a, b| if *b > a { *b } else { a }));
                    ScoresIn::Linear
                }
                _ => {
                    write_scores(diagonal, row, taken_out)?;
                    ScoresIn::Log2
                }
            };
            // One form for all: it is converted at once.
            if *form.get_or_insert(next) != next {
                return None;
            }
        }
        if form == Some(ScoresIn::Linear) {
            kernels::largest(out, Valid::Likelihoods).ok()?;
            kernels::log2_in_place(out);
        }
        if far {
            for row in out.chunks_exact_mut(states) {
                let largest = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let whole = if largest.is_finite() { largest.floor() } else { 0.0 };
                taken_out.whole += whole;
                row.iter_mut().for_each(|score| *score -= whole);
            }
        }
        Some(())
    }
}

/// Copies a row of few values. (A copy of unknown length is a call.)
#[inline(always)]
fn copy(values: &[f64], out: &mut [f64]) -> Option<()> {
    match (values, &mut *out) {
        (&[a, b], [x, y]) => (*x, *y) = (a, b),
        (&[a, b, c], [x, y, z]) => (*x, *y, *z) = (a, b, c),
        _ => (values.len() == out.len()).then(|| out.copy_from_slice(values))?,
    }
    Some(())
}

/// Scores of any diagonal.
#[inline(never)]
fn write_scores(diagonal: Diagonal<'_>, out: &mut [f64], taken_out: &mut TakenOut) -> Option<()> {
    let largest = diagonal.check(out.len()).ok()?;
    let scores: Scores<'_> = likelihood_scores(&diagonal, largest, taken_out)?;
    scores.write(out);
    Some(())
}

/// Likelihoods of any diagonal, with the largest near one. Returns the logarithm of what was taken
/// out. (By value: for a reference, each diagonal would be written to memory.)
#[inline(never)]
fn scale(diagonal: Diagonal<'_>, out: &mut [f64]) -> Option<f64> {
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
