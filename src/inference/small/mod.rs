//! Whole sequences under models of up to eight states without a control: the
//! same routines in arrays of a fixed size, which the compiler keeps in
//! registers.
//!
//! All sums here are of products of numbers that are far from the ends of a
//! double's range, or exactly 0. Where that can't be kept, or a sensor, an
//! operator or an observation gives reason for an error, a routine gives up
//! and the general one starts over: it knows about logarithms and errors.

mod chain;
mod diagonals;
mod forward;
mod halves;
mod score;
mod smooth;
mod viterbi;

use std::any::Any;

pub(super) use forward::forward;
pub(super) use score::score;
pub(super) use smooth::smooth;
pub(super) use viterbi::viterbi;

use crate::hmm::Hmm;
use crate::kernels::LIFT;
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// Models of more states gain nothing.
const MOST_STATES: usize = 8;
/// For fewer steps it is not worth while to ask for the matrix.
const FEWEST_STEPS: usize = 8;
/// Entries and likelihoods below this are left to the general routines.
const LEAST_FACTOR: f64 = power(-200);

/// 2^exponent, for exponents from -1022 to 1023.
const fn power(exponent: i64) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// The exponent of the power of two below a normal number.
fn exponent(x: f64) -> i64 {
    (x.to_bits() >> 52).cast_signed() - 1023
}

/// Calls a function with the number of states as a constant.
macro_rules! with_constant {
    ($n:expr, $function:ident($($argument:expr),*)) => {
        match $n {
            1 => $function::<1>($($argument),*),
            2 => $function::<2>($($argument),*),
            3 => $function::<3>($($argument),*),
            4 => $function::<4>($($argument),*),
            5 => $function::<5>($($argument),*),
            6 => $function::<6>($($argument),*),
            7 => $function::<7>($($argument),*),
            8 => $function::<8>($($argument),*),
            _ => None,
        }
    };
}
use with_constant;

/// The control of an operator without one, if the model is small and the
/// sequence long enough.
fn control_of<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>, steps: usize) -> Option<&A::Control> {
    if hmm.states() > MOST_STATES || steps < FEWEST_STEPS {
        return None;
    }
    let control = (&() as &dyn Any).downcast_ref::<A::Control>()?;
    hmm.transition().check_control(control).ok()?;
    Some(control)
}

/// A, column after column, by a product for each state. `None` if an entry is
/// too small, or the columns do not sum to one.
fn columns<A: Transition>(transition: &A, control: &A::Control) -> Option<Vec<f64>> {
    let n = transition.states();
    let (mut unit, mut columns) = (vec![0.0; n], vec![0.0; n * n]);
    for (from, column) in columns.chunks_exact_mut(n).enumerate() {
        // Lifted, so that an entry that is a product of small ones is not lost.
        unit[from] = LIFT;
        transition.apply(control, &unit, column);
        unit[from] = 0.0;
        column.iter_mut().for_each(|entry| *entry /= LIFT);
        let valid = |&entry: &f64| entry == 0.0 || entry >= LEAST_FACTOR;
        if !(column.iter().all(valid) && super::step::is_one(column.iter().sum())) {
            return None;
        }
    }
    Some(columns)
}
