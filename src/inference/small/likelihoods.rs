//! Likelihoods of a stretch of steps as the filter scales them.

use super::power;
use crate::hmm::Hmm;
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// How many steps are gathered at a time.
const GATHERED: usize = 256;
/// As in a step of the filter.
const UNSCALED: std::ops::RangeInclusive<f64> = power(-16)..=power(16);

/// What belongs to the likelihoods of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Factors {
    /// The largest of them, as they are taken.
    pub(super) largest: f64,
    /// The logarithm of what they were divided by.
    pub(super) log_scale: f64,
    pub(super) log_factor: f64,
}

/// Likelihoods of some steps, as far as they are ordinary.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    pub(super) states: usize,
    pub(super) values: Vec<f64>,
    pub(super) factors: Vec<Factors>,
    /// How many steps were asked for.
    pub(super) wanted: usize,
}

/// Gathers the likelihoods of the steps from `first`, up to one that the
/// filter has to look at.
pub(super) fn gather<A, B, S>(
    hmm: &Hmm<A, B>,
    sequence: &S,
    first: usize,
    scratch: &mut Scratch,
    out: &mut Gathered,
) where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let n = hmm.states();
    out.states = n;
    out.wanted = GATHERED.min(sequence.steps() + 1 - first);
    out.values.clear();
    out.factors.clear();
    for step in first..first + out.wanted {
        let Ok(diagonal) = hmm.likelihood().diagonal(sequence.observation(step), scratch) else {
            break;
        };
        if let Values::Checked { linear, largest, .. } = diagonal.values
            && linear.len() == n
            && diagonal.log_factor == 0.0
            && UNSCALED.contains(&largest)
        {
            out.values.extend_from_slice(linear);
            out.factors.push(Factors { largest, log_scale: 0.0, log_factor: 0.0 });
        } else if put(n, &diagonal, out).is_none() {
            break;
        }
    }
}

/// Any diagonal. `None` if it is not valid, or some of it is lost.
fn put(n: usize, diagonal: &Diagonal<'_>, out: &mut Gathered) -> Option<()> {
    let largest = diagonal.check(n).ok()?;
    let (mut lost, least) = (false, f64::MIN_POSITIVE);
    let log_factor = diagonal.log_factor;
    let factors = match diagonal.values {
        Values::Linear(linear) | Values::Checked { linear, .. } if UNSCALED.contains(&largest) => {
            out.values.extend_from_slice(linear);
            Factors { largest, log_scale: 0.0, log_factor }
        }
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            if largest == 0.0 {
                return None;
            }
            out.values.extend(linear.iter().map(|b| b / largest));
            let scaled = &out.values[out.values.len() - n..];
            lost |= linear.iter().zip(scaled).any(|(b, scaled)| *b > 0.0 && *scaled < least);
            Factors { largest: 1.0, log_scale: largest.ln(), log_factor }
        }
        Values::Log(logs) => {
            if largest == f64::NEG_INFINITY {
                return None;
            }
            out.values.extend(logs.iter().map(|log| (log - largest).exp()));
            let scaled = &out.values[out.values.len() - n..];
            let possible = |log: f64| log > f64::NEG_INFINITY;
            lost |= logs.iter().zip(scaled).any(|(log, scaled)| possible(*log) && *scaled < least);
            Factors { largest: 1.0, log_scale: largest, log_factor }
        }
    };
    if lost {
        out.values.truncate(out.factors.len() * n);
        return None;
    }
    out.factors.push(factors);
    Some(())
}
