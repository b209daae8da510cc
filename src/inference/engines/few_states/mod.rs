//! Whole sequences under models of up to eight states without a control ("Few states" in section 3
//! of the [formulas](crate::guide::formulas)), many steps in one kernel call: eight segments of the
//! sequence, one in each lane, or one state in each lane.
//!
//! The invariant ("Few states" in `limits`): every term of a sum is 0 or far from the ends of the
//! range of doubles. If that cannot be kept, or a sensor, an operator or an observation would cause
//! an error, a routine returns `None`, and the caller starts over step by step: steps can use
//! logarithms, and report errors.

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
use crate::transition::{Transition, constant_control};
use wayfix_kernels::limits::{
    self, LEAST_FACTOR, LEAST_IN_CHAIN, LIFT, MIDDLE_RANGE, exponent, power,
};
use wayfix_kernels::{ChainState, LANES, Packed, SmallModel};

/// A model in arrays of eight, padded by impossible states.
struct FewStatesModel {
    states: usize,
    columns: [Packed; LANES],
    rows: [Packed; LANES],
    prior: ChainState,
    /// True if there is a transition before the first observation.
    moves: bool,
}

impl FewStatesModel {
    /// Reads the matrix of an operator by a product for each state. Returns `None` if the model
    /// does not suit this engine, an entry is too small, or a column does not sum to one.
    fn new<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>) -> Option<Self> {
        let (control, states) = (control_of(hmm)?, hmm.states());
        let mut columns = [Packed::default(); LANES];
        let mut rows = columns;
        // By products, so that operators that cannot list their entries work too.
        let (mut unit, mut column) = (vec![0.0; states], vec![0.0; states]);
        for from in 0..states {
            // Lifted, so that an entry that is a product of small factors is not lost.
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

    /// Returns the model of the first N states, for segments.
    fn segment_model<const N: usize>(&self) -> SmallModel<N> {
        let first =
            |lines: &[Packed; LANES]| std::array::from_fn(|j| std::array::from_fn(|i| lines[j][i]));
        let columns: [[f64; N]; N] = first(&self.columns);
        // `least`: the smallest likelihood whose product with the smallest entry is allowed.
        let entries = columns.as_flattened().iter().copied().filter(|a| *a > 0.0);
        SmallModel {
            columns,
            rows: first(&self.rows),
            least: limits::LEAST_SEGMENT_PRODUCT / entries.fold(1.0, f64::min),
        }
    }

    /// Calls `take(true)`, for segments, if the sequence suits them, and otherwise, or if that
    /// fails, `take(false)`, for a chain.
    fn in_segments_or_steps(
        &self,
        steps: usize,
        mut take: impl FnMut(bool) -> Option<f64>,
    ) -> Option<f64> {
        // Segments are checked only after every four steps, and so need a narrower range. What
        // fails there may succeed in a chain.
        let in_segments = choice::for_sequence(self.states, steps) == Engine::Segments;
        in_segments.then(|| take(true)).flatten().or_else(|| take(false))
    }
}

/// Scales a vector back to the middle range. Returns `None` if its values are too far apart, or all
/// 0.
fn rescale(x: &mut ChainState) -> Option<()> {
    let sum: f64 = x.values.iter().sum();
    if !(MIDDLE_RANGE[0]..=MIDDLE_RANGE[1]).contains(&sum) {
        // Nothing is left, or a NaN or an infinity has come in.
        if !sum.is_normal() {
            return None;
        }
        // By a power of two, which is exact.
        let by = exponent(sum);
        x.values.iter_mut().for_each(|x| *x *= power(-by));
        x.exponent += by;
    }
    x.values.iter().all(|x| *x == 0.0 || *x >= LEAST_IN_CHAIN).then_some(())
}

/// Returns the control of the operator if the model suits this engine. (`choice` has decided on the
/// numbers of states and steps.)
fn control_of<A: Transition, B: Likelihood>(hmm: &Hmm<A, B>) -> Option<&'static A::Control> {
    let control = constant_control::<A>()?;
    hmm.transition().check_control(control).ok()?;
    // With evidence, columns do not sum to one; this is left to single steps.
    hmm.transition().evidence(control).is_none().then_some(control)
}
