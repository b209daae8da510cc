//! Likelihoods of consecutive steps, in one block.

use std::f64::consts::LN_2;
use std::ops::Range;

use crate::hmm::Hmm;
use crate::inference::step::scores::{TakenOut, likelihood_scores};
use crate::kernels::{self, Scores, ScoresIn, Valid};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::limits::{LARGEST_LOG, LEAST_FACTOR, UNSCALED, UNSHIFTED, exponent, power};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Logarithm of [`LEAST_FACTOR`], or more.
const LEAST_LOG: f64 = -138.0;

/// Likelihoods of a sequence, without its type: code that uses them is compiled once, with this
/// crate.
pub(crate) trait LikelihoodRows {
    /// Copies the likelihoods of some steps. Returns true if something was taken out of them, and
    /// then writes its logarithms to `logs`; `None` if some are not valid or have too wide a range.
    ///
    /// The largest of each step is brought near one, unless all can be taken as they are, none
    /// above 2^16, and that is not ruled out by `scaled`.
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

    /// Copies likelihoods of N states, or of any number for N = 0, as they are: a copy of a length
    /// that is not known is a call. `None` if one is in logarithms, has a factor, or is above 2^16.
    #[inline(always)]
    fn copy<const N: usize>(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        let states = if N > 0 { N } else { self.hmm.states() };
        let (mut most, mut checked) = (0.0_f64, true);
        for (step, row) in steps.zip(out.chunks_exact_mut(states)) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            // A factor would have to be taken out: the caller then scales each step.
            if diagonal.log_factor != 0.0 {
                return None;
            }
            let linear = match diagonal.values {
                // The sensor has checked them and knows the largest; a look at each value takes
                // longer than the copy.
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
        // One call of a kernel for all steps, not one for each.
        if !checked {
            most = most.max(kernels::largest(out, Valid::Likelihoods).ok()?);
        }
        (most <= *UNSCALED.end()).then_some(())
    }

    /// Copies logarithms less the largest of each step, which is passed on with the number of the
    /// step. `None` if a step has others than logarithms, a factor, or nothing that is possible.
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
            // One length for both, which the compiler knows for N states.
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
        // A copy of known length, for the numbers of states where it was measured to pay.
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
                    // On the grid already, and the largest so near 0 that nothing is taken out.
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
            // One form for all: it is converted at once.
            if *form.get_or_insert(next) != next {
                return None;
            }
        }
        if form == Some(ScoresIn::Linear) {
            kernels::largest(out, Valid::Likelihoods).ok()?;
            kernels::log2_in_place(out);
        }
        // A score far from 0 would take digits from sums: whole numbers come out exactly.
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

/// Returns the largest of the logarithms of likelihoods; `None` if they are not valid, or nothing
/// is possible. (A call of a kernel takes longer than a few comparisons.)
#[inline(always)]
fn largest_log(logs: &[f64]) -> Option<f64> {
    let (mut largest, mut valid) = (f64::NEG_INFINITY, true);
    for &log in logs {
        valid &= Valid::Logs.is(log);
        largest = if log > largest { log } else { largest };
    }
    (valid && largest > f64::NEG_INFINITY).then_some(largest)
}

/// Scores of any diagonal.
#[inline(never)]
fn write_scores(diagonal: Diagonal<'_>, out: &mut [f64], taken_out: &mut TakenOut) -> Option<()> {
    let largest = diagonal.check(out.len()).ok()?;
    let scores: Scores<'_> = likelihood_scores(&diagonal, largest, taken_out)?;
    scores.write(out);
    Some(())
}

/// True if the logarithm of a likelihood is too low: a product in the chain could become less than
/// 2^-700 (`limits`, "Few states").
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
            // `power` is right up to 1022; 1000 leaves room. A largest likelihood of 0 fails here
            // too, as its exponent reads -1023.
            if by.abs() > 1000 {
                return None;
            }
            log += by as f64 * LN_2;
            for (out, b) in out.iter_mut().zip(linear) {
                *out = b * power(-by);
                // A smaller one could make a product in the chain less than 2^-700 (`limits`, "Few
                // states").
                lost |= *b > 0.0 && *out < LEAST_FACTOR;
            }
        }
    }
    (!lost).then_some(log)
}
