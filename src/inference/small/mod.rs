//! Whole sequences under models of up to eight states without a control: the
//! same routines in arrays of a fixed size, which the compiler keeps in
//! registers.
//!
//! All sums here are of products of numbers that are far from the ends of a
//! double's range, or exactly 0. Where that can't be kept, or a sensor, an
//! operator or an observation gives reason for an error, a routine gives up
//! and the general one starts over: it knows about logarithms and errors.

mod chain;
mod columns;
mod diagonals;
mod ends;
mod filter;
mod halves;
mod score;
mod score_in_segments;
mod segments;
mod smooth;
mod smooth_in_segments;
mod viterbi;

pub(super) use filter::filter;
pub(super) use score::score;
pub(super) use smooth::smooth;
pub(super) use viterbi::viterbi;

use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// Models of more states gain nothing.
const MOST_STATES: usize = 8;
/// For fewer steps it is not worth while to ask for the matrix.
const FEWEST_STEPS: usize = 8;
/// Entries and likelihoods below this are left to the general routines.
const LEAST_FACTOR: f64 = power(-200);

/// 2^exponent, for exponents from -1022 to 1023.
#[inline(always)]
const fn power(exponent: i64) -> f64 {
    f64::from_bits((1023 + exponent).cast_unsigned() << 52)
}

/// The exponent of the power of two below a normal number.
#[inline(always)]
fn exponent(x: f64) -> i64 {
    (x.to_bits() >> 52).cast_signed() - 1023
}

/// Length of the arrays for so many states. Those beyond the last are never possible:
/// that adds 0 at the end of each sum, which leaves it as it is to the bit.
fn room(states: usize) -> usize {
    match states {
        ..=2 => 2,
        3 | 4 => states,
        _ => MOST_STATES,
    }
}

/// One value for each state, and something for the room beyond.
fn filled_up<const N: usize>(values: &[f64], with: f64) -> Option<[f64; N]> {
    let mut out = [with; N];
    out.get_mut(..values.len())?.copy_from_slice(values);
    Some(out)
}

/// Leaves out what is beyond the last state of each step.
fn without_room(values: &mut Vec<f64>, states: usize) {
    let room = room(states);
    if room == states {
        return;
    }
    let steps = values.len() / room;
    (1..steps)
        .for_each(|step| values.copy_within(step * room..step * room + states, step * states));
    values.truncate(steps * states);
}

/// An expression in which a name is the [`room`] of a model, as a constant: for each
/// there is code of its own.
macro_rules! with_constant {
    ($n:expr, $name:ident => $body:expr) => {
        with_constant!(super::room($n), $name => $body; 2 3 4 8)
    };
    ($n:expr, $name:ident => $body:expr; $($number:literal)*) => {
        match $n {
            $($number => {
                const $name: usize = $number;
                $body
            })*
            _ => None,
        }
    };
}
use with_constant;

/// The control of an operator without one, if the model is small, the sequence long
/// enough, and there is no evidence on moves.
fn control_of<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>, steps: usize) -> Option<&A::Control> {
    if hmm.states() > MOST_STATES || steps < FEWEST_STEPS {
        return None;
    }
    let control = hmm.transition().no_control()?;
    hmm.transition().check_control(control).ok()?;
    hmm.transition().evidence(control).is_none().then_some(control)
}
