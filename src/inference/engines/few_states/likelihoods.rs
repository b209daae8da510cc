//! Likelihoods of consecutive steps, in one block of rows.
//!
//! Most of the time of a model with few states could go into asking the sensor. So there are fast
//! copies for the usual forms, checked once for all steps, and a slow path for any diagonal. All of
//! them keep the range that "Few states" in `limits` needs, or return `None`.

use std::f64::consts::LN_2;
use std::ops::Range;

use crate::hmm::Hmm;
use crate::inference::step::scores::{TakenOut, likelihood_scores};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::limits::{LARGEST_LOG, LEAST_FACTOR, UNSCALED, UNSHIFTED, exponent, power};
use wayfix_kernels::{self as kernels, Scores, ScoresIn, Valid};

/// Logarithm of [`LEAST_FACTOR`], rounded up.
const LEAST_LOG: f64 = -138.0;

/// Likelihoods of a sequence, as a trait object, so that the code that uses them is compiled once,
/// with this crate.
pub(crate) trait LikelihoodRows {
    /// Copies the likelihoods of some steps. Returns true if they were scaled, and then writes the
    /// logarithm of each step's divisor to `logs`; `None` if some are invalid or have too wide a
    /// range.
    ///
    /// They are scaled so that the largest of each step is near one, unless `scaled` is false and
    /// all can be used as they are, with none above 2^16.
    fn likelihoods(
        &mut self,
        steps: Range<usize>,
        scaled: bool,
        out: &mut [f64],
        logs: &mut [f64],
    ) -> Option<bool>;

    /// Copies the scores of some steps: log2 of the likelihoods, less the parts taken out.
    fn scores(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Option<()>;
}

/// Likelihoods of a model's sensor.
pub(crate) struct SensorRows<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    scratch: Scratch,
}

impl<'m, A, B, S> SensorRows<'m, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    pub(crate) fn new(hmm: &'m Hmm<A, B>, sequence: &'m S) -> Self {
        Self { hmm, sequence, scratch: Scratch::default() }
    }

    /// Copies likelihoods of N states, or of any number for N = 0, as they are. (N is known because
    /// a copy of unknown length is a function call.) Returns `None` if some are in logarithms, have
    /// a factor, or are above 2^16.
    #[inline(always)]
    fn copy<const N: usize>(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        let states = if N > 0 { N } else { self.hmm.states() };
        let (mut most, mut checked) = (0.0_f64, true);
        for (step, row) in steps.zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            // A factor would have to be taken out of each step. The caller then scales the steps
            // one by one.
            if diagonal.log_factor != 0.0 {
                return None;
            }
            let linear = match diagonal.values {
                // The sensor has checked the values and knows the largest. Another look at each
                // would take longer than the copy.
                Values::Checked { linear, largest, .. } => {
                    most = if largest > most { largest } else { most };
                    linear
                }
                Values::Linear(linear) => {
                    checked = false;
                    linear
                }
                Values::Log(_) => return None,
            };
            if N > 0 {
                *row.first_chunk_mut::<N>()? = *<&[f64; N]>::try_from(linear).ok()?;
            } else {
                (linear.len() == states).then(|| row.copy_from_slice(linear))?;
            }
        }
        // One kernel call for all steps instead of one for each step.
        if !checked {
            most = most.max(kernels::largest(out, Valid::Likelihoods).ok()?);
        }
        (most <= *UNSCALED.end()).then_some(())
    }

    /// Copies logarithms less the largest of each step, which is passed to `take` with the index of
    /// the step. Returns `None` if a step is not in logarithms, has a factor, or has no possible
    /// state.
    fn copy_logs(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        take: impl FnMut(usize, f64),
    ) -> Option<()> {
        match self.hmm.states() {
            2 => self.copy_logs_of::<2>(steps, out, take),
            _ => self.copy_logs_of::<0>(steps, out, take),
        }
    }

    #[inline(always)]
    fn copy_logs_of<const N: usize>(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        mut take: impl FnMut(usize, f64),
    ) -> Option<()> {
        let states = if N > 0 { N } else { self.hmm.states() };
        for (at, (step, row)) in steps.zip(out.chunks_exact_mut(states)).enumerate() {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let (Values::Log(logs), 0.0) = (&diagonal.values, diagonal.log_factor) else {
                return None;
            };
            // Makes both lengths equal, and constant where the number of states is a constant.
            let logs = logs.get(..states).filter(|_| logs.len() == states)?;
            let largest = largest_log(logs)?;
            row.iter_mut().zip(logs).for_each(|(out, log)| *out = log - largest);
            take(at, largest);
        }
        Some(())
    }
}

impl<A, B, S> LikelihoodRows for SensorRows<'_, A, B, S>
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
        // Copies of constant length, for the numbers of states where they were measured to be
        // faster.
        let plain = match self.hmm.states() {
            _ if scaled => None,
            2 => self.copy::<2>(steps.clone(), out),
            3 => self.copy::<3>(steps.clone(), out),
            4 => self.copy::<4>(steps.clone(), out),
            8 => self.copy::<8>(steps.clone(), out),
            _ => self.copy::<0>(steps.clone(), out),
        };
        if plain.is_some() {
            return Some(false);
        }
        if self.copy_logs(steps.clone(), out, |at, log| logs[at] = log).is_some() {
            let lost = is_lost(out);
            kernels::exp_in_place(out);
            return (!lost).then_some(true);
        }
        // Any other form is converted step by step.
        let rows = out.chunks_exact_mut(self.hmm.states());
        for ((step, row), log) in steps.zip(rows).zip(logs) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            *log = scale(&diagonal, row)?;
        }
        Some(true)
    }

    fn scores(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Option<()> {
        let before = taken_out.clone();
        if self.copy_logs(steps.clone(), out, |_, log| taken_out.factors.add(log)).is_some() {
            kernels::ln_to_log2(out);
            return Some(());
        }
        *taken_out = before;
        let (states, mut form, mut far) = (self.hmm.states(), None, false);
        let is_near = |largest: f64| UNSHIFTED.contains(&largest);
        for (step, row) in steps.zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            let next = match diagonal.values {
                Values::Checked { log2: Some(log2), largest, .. }
                    if diagonal.log_factor == 0.0 && is_near(largest) =>
                {
                    // The scores are on the grid already, and the largest is so near 0 that nothing
                    // has to be taken out.
                    copy(log2, row)?;
                    ScoresIn::Log2
                }
                Values::Linear(linear) if diagonal.log_factor == 0.0 => {
                    // Converted for all steps at once, below.
                    copy(linear, row)?;
                    far |= !is_near(row.iter().fold(0.0, |a, b| if *b > a { *b } else { a }));
                    ScoresIn::Linear
                }
                _ => {
                    write_scores(diagonal, row, taken_out)?;
                    ScoresIn::Log2
                }
            };
            // All steps must have the same form, since they are converted at once.
            if *form.get_or_insert(next) != next {
                return None;
            }
        }
        if form == Some(ScoresIn::Linear) {
            kernels::largest(out, Valid::Likelihoods).ok()?;
            kernels::log2_in_place(out);
        }
        // Scores far from 0 would cost sums their digits. Whole numbers are taken out exactly.
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

/// Copies a row of a few values. (A copy of unknown length is a function call.)
#[inline(always)]
fn copy(values: &[f64], out: &mut [f64]) -> Option<()> {
    match (values, &mut *out) {
        (&[a, b], [x, y]) => (*x, *y) = (a, b),
        (&[a, b, c], [x, y, z]) => (*x, *y, *z) = (a, b, c),
        _ => (values.len() == out.len()).then(|| out.copy_from_slice(values))?,
    }
    Some(())
}

/// Returns the largest of the logarithms of likelihoods, or `None` if they are invalid or all −∞.
/// (A kernel call would take longer than a few comparisons.)
#[inline(always)]
fn largest_log(logs: &[f64]) -> Option<f64> {
    let (mut largest, mut valid) = (f64::NEG_INFINITY, true);
    for &log in logs {
        valid &= Valid::Logs.is(log);
        largest = if log > largest { log } else { largest };
    }
    (valid && largest > f64::NEG_INFINITY).then_some(largest)
}

/// Writes the scores of any diagonal.
#[inline(never)]
fn write_scores(diagonal: Diagonal<'_>, out: &mut [f64], taken_out: &mut TakenOut) -> Option<()> {
    let largest = diagonal.check(out.len()).ok()?;
    let scores: Scores<'_> = likelihood_scores(&diagonal, largest, taken_out)?;
    scores.write(out);
    Some(())
}

/// Returns true if the logarithm of some likelihood is so low that a product in the chain could
/// fall below 2^-700 (`limits`, "Few states").
fn is_lost(logs: &[f64]) -> bool {
    let lost = |log: f64| log < LEAST_LOG && log > f64::NEG_INFINITY;
    logs.iter().fold(false, |any, log| any | lost(*log))
}

/// Likelihoods of any diagonal, with the largest near one. Returns the logarithm of what was taken
/// out.
#[inline(never)]
fn scale(diagonal: &Diagonal<'_>, out: &mut [f64]) -> Option<f64> {
    if diagonal.log_factor.is_nan() || diagonal.log_factor.abs() > LARGEST_LOG {
        return None;
    }
    let (mut lost, mut log) = (false, diagonal.log_factor);
    match diagonal.values {
        Values::Log(logs) => {
            let largest = largest_log(logs).filter(|_| logs.len() == out.len())?;
            log += largest;
            out.iter_mut().zip(logs).for_each(|(b, log)| *b = log - largest);
            lost = is_lost(out);
            kernels::exp_in_place(out);
        }
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            let largest = diagonal.check(out.len()).ok()?;
            let by = if UNSCALED.contains(&largest) { 0 } else { exponent(largest) };
            // `power` is valid up to 1022; 1000 leaves room. If the largest likelihood is 0, its
            // exponent reads as -1023, and it fails here too.
            if by.abs() > 1000 {
                return None;
            }
            log += by as f64 * LN_2;
            for (out, b) in out.iter_mut().zip(linear) {
                *out = b * power(-by);
                // A smaller likelihood could let a product in the chain fall below 2^-700
                // (`limits`, "Few states").
                lost |= *b > 0.0 && *out < LEAST_FACTOR;
            }
        }
    }
    (!lost).then_some(log)
}
