//! Likelihoods of a step of eight sequences, side by side.
//!
//! The largest of each lane is within `UNSCALED`, and the others are at least `TINY`, or the lane
//! becomes invalid: with entries of at least `LEAST_ENTRY`, no lifted product then becomes 0
//! unseen. In a model with rounded tails, small ones may.

use super::{Group, LaneModel};
use crate::inference::step::Workspace;
use crate::kernels::{self, Eight, LANES, Packed};
use crate::likelihood::{Likelihood, Values};
use crate::limits::{TINY, UNSCALED, exponent, power};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Stands for a likelihood below the range of exp: it is tiny, so that the lane becomes invalid.
const LOST: f64 = f64::from_bits(1);

/// Largest likelihood of each lane, and ln of what was taken out.
pub(crate) struct LaneScales {
    pub(crate) largest: Eight,
    pub(crate) logs: Eight,
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Packs the likelihoods of a step, 1 in lanes that have ended. Lanes whose likelihoods are not valid, or too small beside the largest, become invalid.
    pub(crate) fn likelihoods<S>(
        &self,
        group: &Group<'_, S>,
        step: usize,
        lanes: &mut [Workspace; LANES],
        valid: &mut [bool; LANES],
        out: &mut [Packed],
    ) -> LaneScales
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut rows = [&self.ones[..]; LANES];
        let rounded = self.hmm.rounds_tails();
        let mut scales = LaneScales { largest: [1.0; LANES], logs: [0.0; LANES] };
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(lanes).enumerate() {
            if valid[l] && step <= group.steps[l] {
                match self.row(sequence.observation(step), lane) {
                    Some(row) => (rows[l], scales.logs[l]) = row,
                    None => valid[l] = false,
                }
            }
        }
        // Rows as the sensors gave them: checked by their range, while they are packed.
        let range = kernels::pack(rows, out);
        for (l, valid) in valid.iter_mut().enumerate() {
            let mut tiny = range.tiny[l];
            scales.largest[l] = range.largest[l];
            *valid &= range.least[l] >= 0.0;
            if *valid && !UNSCALED.contains(&range.largest[l]) {
                *valid = scale(out, l, &mut scales, &mut tiny).is_some();
            }
            *valid &= !tiny || rounded;
        }
        scales
    }

    /// Returns the likelihoods of an observation, and ln of what was taken out; `None` if they are
    /// not valid, or nothing is possible.
    fn row<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut Workspace,
    ) -> Option<(&'a [f64], f64)> {
        let n = self.states();
        let Workspace { scratch, values } = lane;
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
fn scale(out: &mut [Packed], lane: usize, scales: &mut LaneScales, tiny: &mut bool) -> Option<()> {
    let largest = scales.largest[lane];
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
    scales.largest[lane] = largest * factor;
    scales.logs[lane] += by as f64 * std::f64::consts::LN_2;
    Some(())
}
