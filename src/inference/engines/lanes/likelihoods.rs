//! Likelihoods of a step of eight sequences, side by side.

use super::{BatchModel, Group, Lane};
use crate::kernels::{self, Eight, LANES, Packed};
use crate::likelihood::{Likelihood, Values};
use crate::limits::{TINY, UNSCALED, exponent, power};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Stands for a likelihood below the range of exp: the lane is marked.
const LOST: f64 = f64::from_bits(1);

/// Largest likelihood of each lane, and ln of what was taken out.
pub(crate) struct Taken {
    pub(crate) largest: Eight,
    pub(crate) logs: Eight,
}

impl<A: Transition, B: Likelihood> BatchModel<'_, A, B> {
    /// Packs the likelihoods of a step, 1 in lanes that have ended. Marks lanes that do not hold.
    pub(crate) fn likelihoods<S>(
        &self,
        group: &Group<'_, S>,
        step: usize,
        lanes: &mut [Lane; LANES],
        held: &mut [bool; LANES],
        out: &mut [Packed],
    ) -> Taken
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut rows = [&self.ones[..]; LANES];
        let rounded = self.hmm.rounds_tails();
        let mut taken = Taken { largest: [1.0; LANES], logs: [0.0; LANES] };
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(lanes).enumerate() {
            if held[l] && step <= group.steps[l] {
                match self.row(sequence.observation(step), lane) {
                    Some(row) => (rows[l], taken.logs[l]) = row,
                    None => held[l] = false,
                }
            }
        }
        let range = kernels::pack(rows, out);
        for (l, held) in held.iter_mut().enumerate() {
            let mut tiny = range.tiny[l];
            taken.largest[l] = range.largest[l];
            *held &= range.least[l] >= 0.0;
            if *held && !UNSCALED.contains(&range.largest[l]) {
                *held = scale(out, l, &mut taken, &mut tiny).is_some();
            }
            *held &= !tiny || rounded;
        }
        taken
    }

    /// Returns the likelihoods of an observation, and ln of what was taken out; `None` if they are
    /// not valid, or nothing is possible.
    fn row<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut Lane,
    ) -> Option<(&'a [f64], f64)> {
        let n = self.ones.len();
        let Lane { scratch, values } = lane;
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).ok()?;
        diagonal.check_shape(n).ok()?;
        let logs = match diagonal.values {
            Values::Linear(values) | Values::Checked { linear: values, .. } => {
                return Some((values, diagonal.log_factor));
            }
            Values::Log(logs) => logs,
        };
        let largest = diagonal.check(n).ok()?;
        if largest == f64::NEG_INFINITY {
            return None;
        }
        let lost = if self.hmm.rounds_tails() { 0.0 } else { LOST };
        values.clear();
        values.extend(logs.iter().map(|log| match (log - largest).exp() {
            b if b >= f64::MIN_POSITIVE || *log == f64::NEG_INFINITY => b,
            _ => lost,
        }));
        Some((values, diagonal.log_factor + largest))
    }
}

/// Brings the largest likelihood of a lane near one, by a power of two. `None` if it is 0 or
/// infinite.
#[cold]
fn scale(out: &mut [Packed], lane: usize, taken: &mut Taken, tiny: &mut bool) -> Option<()> {
    let largest = taken.largest[lane];
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let by = exponent(largest).clamp(-1000, 1000);
    let factor = power(-by);
    *tiny = false;
    for eight in out {
        let b = &mut eight[lane];
        *tiny |= *b > 0.0 && *b * factor < TINY;
        *b *= factor;
    }
    taken.largest[lane] = largest * factor;
    taken.logs[lane] += by as f64 * std::f64::consts::LN_2;
    Some(())
}
