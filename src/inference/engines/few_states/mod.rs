//! Whole sequences under models of up to eight states without a control ("Few states" in section 3
//! of the [formulas](crate::guide::formulas)), many steps in one kernel call: eight segments of the
//! sequence, one in each lane, or one state in each lane.
//!
//! The invariant ("Few states" in `limits`): every term of a sum is 0 or far from the ends of the
//! range of doubles. If that cannot be kept, or a sensor, an operator or an observation would cause
//! an error, a routine returns `None`, and the caller starts over step by step: steps can use
//! logarithms, and report errors.
//!
//! Segments have products P_s = B(y_l) A … B(y_f) A, through which vectors go: x forward, r
//! backward. Each column of a product has an exponent of its own. Columns are added with a common
//! one, and only if they are close enough for nothing to be lost.

mod forward_backward;
mod likelihoods;
mod viterbi;

use super::choice;
use super::choice::Engine;
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::transition::{Transition, constant_control};
use wayfix_kernels::limits::{
    LARGEST_EXPONENT_GAP, LEAST_FACTOR, LEAST_IN_CHAIN, LIFT, MIDDLE_RANGE, exponent, power,
};
use wayfix_kernels::{
    ChainState, Eight, LANES, Packed, Scaled, SmallModel, SumProduct, limits, multiply_segments,
    pack, unpack,
};

pub(crate) use self::forward_backward::{filter, log_likelihood, smooth};
pub(crate) use self::viterbi::viterbi;

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
        // Columns come from products with unit vectors, so operators that cannot list their entries
        // also work.
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

/// Products of eight segments.
pub(crate) struct SegmentProducts<const N: usize>([Scaled<N>; N]);

impl<const N: usize> SegmentProducts<N> {
    /// Computes the products; `None` if the range of a column is too wide.
    pub(crate) fn new(model: &SmallModel<N>, likelihoods: &[[Packed; N]]) -> Option<Self> {
        multiply_segments(SumProduct, model, likelihoods).map(Self)
    }

    /// Takes x through all segments, x ← P_s x. Returns x at the start of each.
    pub(crate) fn forward(&self, x: &mut ChainState) -> Option<[Eight; N]> {
        let mut starts = [[0.0; LANES]; N];
        for segment in 0..LANES {
            (0..N).for_each(|i| starts[i][segment] = x.values[i]);
            // A column that has no weight in x, or that is 0, may have any exponent, so it must not
            // count for the largest exponent.
            let used =
                |j: usize| x.values[j] > 0.0 && self.0[j].values.iter().any(|x| x[segment] > 0.0);
            let (by, powers) = self.powers(segment, std::array::from_fn(used))?;
            let mut out = [0.0; LANES];
            for (j, column) in self.0.iter().enumerate() {
                let weight = x.values[j] * powers[j];
                (0..N).for_each(|i| out[i] += weight * column.values[i][segment]);
            }
            *x = ChainState { values: out, exponent: x.exponent + by };
            rescale(x)?;
        }
        Some(starts)
    }

    /// Takes r through all segments from the last, r ← P_s' r. Returns r at the end of each.
    pub(crate) fn backward(&self, r: &mut ChainState) -> Option<[Eight; N]> {
        let mut ends = [[0.0; LANES]; N];
        for segment in (0..LANES).rev() {
            (0..N).for_each(|i| ends[i][segment] = r.values[i]);
            let mut out = [0.0; LANES];
            // Element j of P_s' r is the product of column j with r.
            for (out, column) in out.iter_mut().zip(&self.0) {
                (0..N).for_each(|i| *out += column.values[i][segment] * r.values[i]);
            }
            let (by, powers) = self.powers(segment, std::array::from_fn(|j| out[j] > 0.0))?;
            (0..N).for_each(|j| out[j] *= powers[j]);
            *r = ChainState { values: out, exponent: r.exponent + by };
            rescale(r)?;
        }
        Some(ends)
    }

    /// Returns the largest exponent of the columns in use, and the factor that brings each of them
    /// to it, 0 for the others. `None` if none is in use, or one would be lost next to another.
    #[inline]
    fn powers(&self, segment: usize, used: [bool; N]) -> Option<(i64, [f64; N])> {
        let exponents: [f64; N] = std::array::from_fn(|j| self.0[j].exponents[segment]);
        let mut largest = f64::NEG_INFINITY;
        for j in 0..N {
            largest = if used[j] && exponents[j] > largest { exponents[j] } else { largest };
        }
        let mut powers = used.map(f64::from);
        for j in 0..N {
            // Columns are added at the largest exponent. A column more than 2^400 below it could
            // lose digits that later likelihoods make significant again.
            let below = largest - exponents[j];
            if below != 0.0 && used[j] {
                if below > LARGEST_EXPONENT_GAP {
                    return None;
                }
                powers[j] = power(-(below as i64));
            }
        }
        (largest > f64::NEG_INFINITY).then_some((largest as i64, powers))
    }
}

/// Packs eight segments, stored one after another in `values`.
pub(crate) fn pack_segments<const N: usize>(values: &[f64], out: &mut Vec<[Packed; N]>) {
    let length = values.len() / LANES;
    out.resize(length / N, [Packed::default(); N]);
    pack(std::array::from_fn(|l| &values[l * length..][..length]), out.as_flattened_mut());
}

/// Unpacks eight segments, to be stored one after another in `out`.
pub(crate) fn unpack_segments(from: &[Packed], out: &mut [f64]) {
    let mut parts = out.chunks_exact_mut(out.len() / LANES);
    unpack(from, std::array::from_fn(|_| parts.next().unwrap_or_default()));
}
