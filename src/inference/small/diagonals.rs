//! The likelihoods of a stretch of steps, gathered into one block.

use std::ops::Range;

use super::super::LogSum;
use super::{LEAST_FACTOR, exponent, power, with_constant};
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
/// then compiled once.
pub(super) trait Diagonals {
    /// Copies the diagonals of some steps unseen. `None` if one is in logarithms,
    /// has a factor, or the sensor fails.
    fn plain(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()>;

    /// Gathers the diagonals of some steps, in ascending order, each with its
    /// largest value near one.
    fn ahead(&mut self, steps: Range<usize>, out: &mut [f64], factors: &mut Factors) -> Option<()>;

    /// The same, but goes through them from the last to the first, so that
    /// sums of factors do not depend on where a stretch ends.
    fn back(&mut self, steps: Range<usize>, out: &mut [f64], factors: &mut Factors) -> Option<()>;
}

/// As [`Diagonals::ahead`], with the logarithm of what was taken out of each step.
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
}

impl<'m, A, B, S> Sensed<'m, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    pub(super) fn new(hmm: &'m Hmm<A, B>, sequence: &'m S) -> Self {
        Self { hmm, sequence, scratch: Scratch::default() }
    }

    fn put_plain<const N: usize>(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        for (step, row) in steps.zip(out.as_chunks_mut::<N>().0) {
            let observation = self.sequence.observation(step);
            let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
            if diagonal.log_factor != 0.0 {
                return None;
            }
            *row = *<&[f64; N]>::try_from(diagonal.linear_values()?).ok()?;
        }
        Some(())
    }

    /// The diagonal of one step, its largest value near one.
    #[inline]
    fn put<const N: usize>(
        &mut self,
        step: usize,
        out: &mut [f64; N],
        factors: &mut Factors,
    ) -> Option<()> {
        let observation = self.sequence.observation(step);
        let diagonal = self.hmm.likelihood().diagonal(observation, &mut self.scratch).ok()?;
        let (linear, largest): (&[f64; N], f64) = match diagonal.values {
            Values::Checked { linear, largest, .. } => (linear.try_into().ok()?, largest),
            Values::Linear(linear) => {
                let (mut largest, mut valid) = (0.0, true);
                for &b in linear {
                    valid &= (0.0..=f64::MAX).contains(&b);
                    largest = if b > largest { b } else { largest };
                }
                (valid.then_some(linear.try_into().ok()?)?, largest)
            }
            Values::Log(_) => return put_unusual(&diagonal, 0.0, out, factors),
        };
        if diagonal.log_factor != 0.0 || !UNSCALED.contains(&largest) {
            return put_unusual(&diagonal, largest, out, factors);
        }
        *out = *linear;
        Some(())
    }

    fn put_ahead<const N: usize>(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        let rows = out.as_chunks_mut::<N>().0;
        steps.zip(rows).try_for_each(|(step, row)| self.put(step, row, factors))
    }

    fn put_back<const N: usize>(
        &mut self,
        steps: Range<usize>,
        out: &mut [f64],
        factors: &mut Factors,
    ) -> Option<()> {
        let rows = out.as_chunks_mut::<N>().0;
        steps.zip(rows).rev().try_for_each(|(step, row)| self.put(step, row, factors))
    }
}

impl<A, B, S> Diagonals for Sensed<'_, A, B, S>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    fn plain(&mut self, steps: Range<usize>, out: &mut [f64]) -> Option<()> {
        with_constant!(self.hmm.states(), N => self.put_plain::<N>(steps, out))
    }

    fn ahead(&mut self, steps: Range<usize>, out: &mut [f64], factors: &mut Factors) -> Option<()> {
        with_constant!(self.hmm.states(), N => self.put_ahead::<N>(steps, out, factors))
    }

    fn back(&mut self, steps: Range<usize>, out: &mut [f64], factors: &mut Factors) -> Option<()> {
        with_constant!(self.hmm.states(), N => self.put_back::<N>(steps, out, factors))
    }
}

/// A diagonal in logarithms, with a factor, or of an unusual scale; `largest`
/// is of those that are none.
#[inline(never)]
fn put_unusual<const N: usize>(
    diagonal: &Diagonal<'_>,
    largest: f64,
    out: &mut [f64; N],
    factors: &mut Factors,
) -> Option<()> {
    if diagonal.log_factor != 0.0 {
        if diagonal.log_factor.is_nan() || diagonal.log_factor.abs() > LARGEST_LOG {
            return None;
        }
        factors.logs.add(diagonal.log_factor);
    }
    match diagonal.values {
        Values::Log(logs) => from_logs(logs.try_into().ok()?, out, factors),
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            let by = exponent(largest);
            if !EXPONENTS.contains(&by) {
                return None;
            }
            factors.exponent += by;
            let linear: &[f64; N] = linear.try_into().ok()?;
            *out = linear.map(|b| b * power(-by));
            // What this has lost digits of, or made 0, was small.
            let lost = linear.iter().zip(&*out).any(|(b, out)| *b > 0.0 && *out < LEAST_FACTOR);
            (!lost).then_some(())
        }
    }
}

/// Likelihoods from logarithms, the largest of them one.
fn from_logs<const N: usize>(
    logs: &[f64; N],
    out: &mut [f64; N],
    factors: &mut Factors,
) -> Option<()> {
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
