//! Whole sequences under models of up to eight states without a control, many steps in a call of
//! a kernel: eight segments of the sequence, one in each lane, or one state in each lane.
//!
//! All sums are of products of numbers far from the ends of the range of doubles, or exactly 0.
//! Where that can't be kept, or a sensor, an operator or an observation gives reason for an error,
//! a routine returns `None`, and the caller starts over step by step: steps know about logarithms
//! and errors.

mod filter;
mod forward;
mod likelihoods;
mod segments;
mod smooth;
mod viterbi;

pub(crate) use filter::{filter, log_likelihood};
pub(crate) use smooth::smooth;
pub(crate) use viterbi::viterbi;

use super::choice::{self, Engine};
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::transition::Transition;
use wayfix_kernels::limits::{
    self, LEAST_FACTOR, LEAST_IN_CHAIN, LIFT, MIDDLE_RANGE, exponent, power,
};
use wayfix_kernels::{ChainState, LANES, Packed, SmallModel};

/// A model in arrays; states beyond the last are never possible.
struct FewStatesModel {
    states: usize,
    columns: [Packed; LANES],
    rows: [Packed; LANES],
    prior: ChainState,
    /// True if there is a transition before the first observation.
    moves: bool,
}

impl FewStatesModel {
    /// Reads the matrix of an operator by a product for each state. `None` if the model is
    /// not for this engine, an entry is too small, or the columns do not sum to one.
    fn new<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>) -> Option<Self> {
        let (control, states) = (control_of(hmm)?, hmm.states());
        let mut columns = [Packed::default(); LANES];
        let mut rows = columns;
        // Any operator is read by its product, also one without entries to list.
        let (mut unit, mut column) = (vec![0.0; states], vec![0.0; states]);
        for from in 0..states {
            // Lifted, so that an entry that is a product of small ones is not lost.
            unit[from] = LIFT;
            hmm.transition().apply(control, &unit, &mut column);
            unit[from] = 0.0;
            column.iter_mut().for_each(|entry| *entry /= LIFT);
            let valid = |&entry: &f64| entry == 0.0 || entry >= LEAST_FACTOR;
            if !(column.iter().all(valid) && limits::is_one(column.iter().sum())) {
                return None;
            }
            for (to, &entry) in column.iter().enumerate() {
                (columns[from][to], rows[to][from]) = (entry, entry);
            }
        }
        let mut prior = ChainState::new(0.0);
        prior.values[..states].copy_from_slice(hmm.prior().belief().as_slice());
        rescale(&mut prior)?;
        Some(Self { states, columns, rows, prior, moves: hmm.prior().moves_at(1) })
    }

    /// The first N states, for segments.
    fn segment_model<const N: usize>(&self) -> SmallModel<N> {
        let first =
            |lines: &[Packed; LANES]| std::array::from_fn(|j| std::array::from_fn(|i| lines[j][i]));
        let columns: [[f64; N]; N] = first(&self.columns);
        let entries = columns.as_flattened().iter().copied().filter(|a| *a > 0.0);
        SmallModel {
            columns,
            rows: first(&self.rows),
            least: limits::LEAST_SEGMENT_PRODUCT / entries.fold(1.0, f64::min),
        }
    }

    /// Takes a sequence in segments if it is for them, and if that fails, or else, step by step.
    fn in_segments_or_steps(
        &self,
        steps: usize,
        mut take: impl FnMut(bool) -> Option<f64>,
    ) -> Option<f64> {
        // Segments are looked at after every four steps only, and need a narrower range: what fails
        // there may go through a chain.
        let in_segments = choice::for_sequence(self.states, steps) == Engine::Segments;
        in_segments.then(|| take(true)).flatten().or_else(|| take(false))
    }
}

/// Brings the scale of a vector back to the middle range. `None` if its values are too far apart,
/// or nothing is left.
fn rescale(x: &mut ChainState) -> Option<()> {
    let sum: f64 = x.values.iter().sum();
    if !(MIDDLE_RANGE[0]..=MIDDLE_RANGE[1]).contains(&sum) {
        // Nothing is left, or a NaN or an infinity has come in.
        if !sum.is_normal() {
            return None;
        }
        let by = exponent(sum);
        x.values.iter_mut().for_each(|x| *x *= power(-by));
        x.exponent += by;
    }
    x.values.iter().all(|x| *x == 0.0 || *x >= LEAST_IN_CHAIN).then_some(())
}

/// Returns the control of the operator if the model is for this engine; the caller has asked
/// `choice` whether the number of states and steps is.
fn control_of<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>) -> Option<&'static A::Control> {
    let control = hmm.transition().no_control()?;
    hmm.transition().check_control(control).ok()?;
    // With evidence columns do not sum to one, and the general routine checks them.
    hmm.transition().evidence(control).is_none().then_some(control)
}
