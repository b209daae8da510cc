//! Products of eight segments, P_s = B(y_l) A … B(y_f) A ("Few states" in section 3 of the
//! [formulas](crate::guide::formulas)), and vectors on their way through them: x forward, r
//! backward.
//!
//! Each column of a product has an exponent of its own. Columns are added with a common one, and
//! only if they are close enough for nothing to be lost.

use super::rescale;
use wayfix_kernels::limits::{LARGEST_EXPONENT_GAP, power};
use wayfix_kernels::{
    ChainState, Eight, LANES, Packed, Scaled, SmallModel, SumProduct, multiply_segments,
};
use wayfix_kernels::{pack, unpack};

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
            // A column that has no weight in x, or that is 0, may have any exponent, and must not
            // count for the largest.
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
            // Columns are added with the largest exponent. One that is more than 2^400 below could
            // lose digits that a later likelihood may bring up again.
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
