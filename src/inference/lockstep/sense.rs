//! The likelihoods of a step of eight sequences, side by side.

use super::{Group, Lane, Plan};
use crate::kernels::lockstep::{self, Abreast};
use crate::kernels::{Eight, LANES, TINY};
use crate::likelihood::{Likelihood, Values};
use crate::range::UNSCALED;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// The least double above 0. In place of a likelihood that exp does not hold.
const LOST: f64 = f64::from_bits(1);

/// What is known of the likelihoods in each lane.
pub(super) struct Sensed {
    pub(super) largest: Eight,
    /// ln of what was taken out.
    pub(super) logs: Eight,
}

/// The likelihoods of one lane.
struct Row<'a> {
    values: &'a [f64],
    log: f64,
}

impl<A: Transition, B: Likelihood> Plan<'_, A, B> {
    /// Gathers the likelihoods of a step, 1 in lanes that have ended. Lanes that do
    /// not hold any more are marked.
    pub(super) fn sense<S>(
        &self,
        group: &Group<'_, S>,
        step: usize,
        lanes: &mut [Lane; LANES],
        held: &mut [bool; LANES],
        out: &mut [Abreast],
    ) -> Sensed
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut rows = [&self.ones[..]; LANES];
        let rounded = self.hmm.rounds_tails();
        let mut sensed = Sensed { largest: [1.0; LANES], logs: [0.0; LANES] };
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(lanes).enumerate() {
            if !held[l] || step > group.steps[l] {
                continue;
            }
            if let Some(row) = self.row(sequence.observation(step), lane) {
                rows[l] = row.values;
                sensed.logs[l] = row.log;
            } else {
                held[l] = false;
            }
        }
        let gathered = lockstep::gather(rows, out);
        for (l, held) in held.iter_mut().enumerate() {
            let (largest, mut tiny) = (gathered.largest[l], gathered.tiny[l]);
            sensed.largest[l] = largest;
            *held &= gathered.least[l] >= 0.0;
            if *held && !UNSCALED.contains(&largest) {
                match rescale(out, l, largest) {
                    Some(scale) => {
                        sensed.largest[l] = largest * scale.factor;
                        sensed.logs[l] += scale.log;
                        tiny = scale.tiny;
                    }
                    None => *held = false,
                }
            }
            *held &= !tiny || rounded;
        }
        sensed
    }

    /// The likelihoods of an observation; `None` if they are not valid, or nothing
    /// is possible.
    fn row<'a>(&'a self, observation: &'a B::Observation, lane: &'a mut Lane) -> Option<Row<'a>> {
        let n = self.ones.len();
        let Lane { scratch, values } = lane;
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).ok()?;
        diagonal.check_shape(n).ok()?;
        let (log, rounded) = (diagonal.log_factor, self.hmm.rounds_tails());
        let logs = match diagonal.values {
            Values::Linear(values) | Values::Checked { linear: values, .. } => {
                return Some(Row { values, log });
            }
            Values::Log(logs) => logs,
        };
        let largest = diagonal.check(n).ok()?;
        if largest == f64::NEG_INFINITY {
            return None;
        }
        let likelihood = |log: &f64| {
            let b = (log - largest).exp();
            match b >= f64::MIN_POSITIVE || *log == f64::NEG_INFINITY {
                true => b,
                false if rounded => 0.0,
                false => LOST,
            }
        };
        values.clear();
        values.extend(logs.iter().map(likelihood));
        Some(Row { values, log: log + largest })
    }
}

/// A power of two that brings the largest likelihood of a lane near one.
struct Scale {
    factor: f64,
    log: f64,
    tiny: bool,
}

/// Applies it; `None` if there is none.
#[cold]
fn rescale(out: &mut [Abreast], lane: usize, largest: f64) -> Option<Scale> {
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let exponent = ((largest.to_bits() >> 52).cast_signed() - 1023).clamp(-1000, 1000);
    let factor = f64::from_bits((1023 - exponent).cast_unsigned() << 52);
    let mut tiny = false;
    for eight in out {
        let b = &mut eight[lane];
        let possible = *b > 0.0;
        *b *= factor;
        tiny |= possible && *b < TINY;
    }
    Some(Scale { factor, log: exponent as f64 * std::f64::consts::LN_2, tiny })
}
