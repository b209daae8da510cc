//! The likelihoods of a stretch of steps, gathered into one block.

use std::ops::Range;

use super::super::LogSum;
use super::{LEAST_FACTOR, exponent, power, room, with_constant};
use crate::hmm::Hmm;
use crate::kernels::LARGEST_LOG;
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Likelihoods with their largest value in this range are taken as they are.
pub(super) const UNSCALED: std::ops::RangeInclusive<f64> = power(-16)..=power(16);
/// Beyond these exponents, scaling itself would need care.
const EXPONENTS: std::ops::RangeInclusive<i64> = -1000..=1000;

/// What was taken out of likelihoods. Ordinary ones leave it as it is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Factors {
    logs: LogSum,
    exponent: i64,
}

impl Factors {
    /// Adds it all to a sum of logarithms.
    pub(super) fn add_to(&self, sum: &mut LogSum, exponent: i64) {
        sum.add((self.exponent + exponent) as f64 * std::f64::consts::LN_2);
        sum.add(self.logs.value());
    }

    pub(super) fn add_log(&mut self, log: f64) {
        self.logs.add(log);
    }

    /// The logarithm of all of it.
    pub(super) fn log(&self) -> f64 {
        let mut sum = LogSum::default();
        self.add_to(&mut sum, 0);
        sum.value()
    }
}

/// Whatever gives likelihoods, without its type: what goes through them is
/// then compiled once, with this crate, and only this with each model. Steps have
/// [`room`] for as many values; what is beyond the last state stays as it is, 0.
pub(super) trait Diagonals {
    /// Copies the diagonals of some steps unseen. `None` if one is in logarithms,
    /// has a factor, or the sensor fails.
    fn plain(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()>;

    /// Gathers the diagonals of some steps, each with its largest value near one. Backwards
    /// it goes through them from the last to the first, so that sums of factors do not
    /// depend on where a stretch ends.
    fn scaled(
        &mut self,
        steps: Range<usize>,
        backwards: bool,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()>;
}

impl dyn Diagonals + '_ {
    pub(super) fn ahead(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        self.scaled(steps, false, out, factors)
    }

    pub(super) fn back(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        self.scaled(steps, true, out, factors)
    }
}

/// One by one in ascending order, with the logarithm of what was taken out of each step.
pub(super) fn one_by_one<const N: usize>(
    diagonals: &mut dyn Diagonals,
    first: usize,
    out: &mut [[f64; N]],
    logs: &mut [f64],
) -> Option<()> {
    for (step, (out, log)) in (first..).zip(out.iter_mut().zip(logs)) {
        let mut factors = Factors::default();
        diagonals.ahead(step..step + 1, out, &mut factors)?;
        *log = factors.log();
    }
    Some(())
}

/// The diagonals of a sequence.
pub(super) struct Sensed<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    scratch: Scratch,
    states: usize,
}

impl<'m, A, B, S> Sensed<'m, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    pub(super) fn new(hmm: &'m Hmm<A, B>, sequence: &'m S) -> Self {
        Self { hmm, sequence, scratch: Scratch::default(), states: hmm.states() }
    }

    fn put_plain<const N: usize>(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        for (step, row) in steps.zip(out.as_chunks_mut::<N>().0) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            if diagonal.log_factor != 0.0 {
                return None;
            }
            copy(diagonal.linear_values()?, self.states, row)?;
        }
        Some(())
    }

    fn put<const N: usize>(
        &mut self,
        steps: Range<usize>,
        backwards: bool,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        let (first, rows) = (steps.start, &mut out.as_chunks_mut::<N>().0[..steps.len()]);
        for number in 0..rows.len() {
            let at = if backwards { rows.len() - 1 - number } else { number };
            self.put_one(first + at, &mut rows[at], factors)?;
        }
        Some(())
    }

    /// The diagonal of one step, its largest value near one.
    #[inline(always)]
    fn put_one<const N: usize>(
        &mut self,
        step: usize,
        out: &mut [f64; N],
        factors: &mut Factors,
    ) -> Option<()> {
        let observation = self.sequence.observation(step);
        let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
        let (linear, largest) = match diagonal.values {
            Values::Checked { linear, largest, .. } => (linear, largest),
            Values::Linear(linear) => {
                copy(linear, self.states, out)?;
                let (mut largest, mut valid) = (0.0, true);
                for &b in &*out {
                    valid &= (0.0..=f64::MAX).contains(&b);
                    largest = if b > largest { b } else { largest };
                }
                (valid.then_some(linear)?, largest)
            }
            Values::Log(_) => return put_unusual(&diagonal, self.states, 0.0, out, factors),
        };
        if diagonal.log_factor != 0.0 || !UNSCALED.contains(&largest) {
            return put_unusual(&diagonal, self.states, largest, out, factors);
        }
        copy(linear, self.states, out)
    }
}

impl<A, B, S> Diagonals for Sensed<'_, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    fn plain(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        match room(self.states) {
            2 => self.put_plain::<2>(steps, out),
            3 => self.put_plain::<3>(steps, out),
            4 => self.put_plain::<4>(steps, out),
            _ => None, // not asked for
        }
    }

    fn scaled(
        &mut self,
        steps: Range<usize>,
        backwards: bool,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        with_constant!(self.states, N => self.put::<N>(steps, backwards, out, factors))
    }
}

/// Copies one value for each state; the room beyond stays as it is.
#[inline(always)]
fn copy<const N: usize>(values: &[f64], states: usize, out: &mut [f64; N]) -> Option<()> {
    match <&[f64; N]>::try_from(values) {
        Ok(values) if states == N => *out = *values,
        _ if values.len() == states => out.get_mut(..states)?.copy_from_slice(values),
        _ => return None,
    }
    Some(())
}

/// A diagonal in logarithms, with a factor, or of an unusual scale; `largest`
/// is of those that are none.
#[inline(never)]
fn put_unusual(
    diagonal: &Diagonal<'_>,
    states: usize,
    largest: f64,
    out: &mut [f64],
    factors: &mut Factors,
) -> Option<()> {
    if diagonal.len() != states {
        return None;
    }
    if diagonal.log_factor != 0.0 {
        if diagonal.log_factor.is_nan() || diagonal.log_factor.abs() > LARGEST_LOG {
            return None;
        }
        factors.logs.add(diagonal.log_factor);
    }
    match diagonal.values {
        Values::Log(logs) => from_logs(logs, out, factors),
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            let by = exponent(largest);
            if !EXPONENTS.contains(&by) {
                return None;
            }
            factors.exponent += by;
            let mut lost = false;
            for (out, b) in out.iter_mut().zip(linear) {
                *out = b * power(-by);
                // What this has lost digits of, or made 0, was small.
                lost |= *b > 0.0 && *out < LEAST_FACTOR;
            }
            (!lost).then_some(())
        }
    }
}

/// Likelihoods from logarithms, the largest of them one.
fn from_logs(logs: &[f64], out: &mut [f64], factors: &mut Factors) -> Option<()> {
    let mut largest = f64::NEG_INFINITY;
    for &log in logs {
        if !(log.abs() <= LARGEST_LOG || log == f64::NEG_INFINITY) {
            return None;
        }
        largest = if log > largest { log } else { largest };
    }
    if largest == f64::NEG_INFINITY {
        return None;
    }
    factors.logs.add(largest);
    let mut small = false;
    for (b, &log) in out.iter_mut().zip(logs) {
        *b = (log - largest).exp();
        small |= *b < LEAST_FACTOR && log > f64::NEG_INFINITY;
    }
    (!small).then_some(())
}
