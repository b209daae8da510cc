//! The two recursions: forward, x_k = B(y_k) A x_{k-1}, and backward,
//! r_{k-1} = A' B(y_k) r_k, scaled by powers of two, which is exact, and only
//! now and then.

use super::{LEAST_FACTOR, exponent, filled_up, power};
use crate::kernels::segments::Few;

/// After so many calm steps the scale is looked at.
pub(super) const UNLOOKED: usize = 4;
/// Steps are calm if the least likelihood times the least entry, of those above
/// 0, is at least this. Others are looked at one by one.
const CALM: f64 = power(-50);
/// Scales are kept in this range. Within [`UNLOOKED`] steps, of likelihoods up
/// to 2^16, they do not come near the end of that of a double.
const SCALES: std::ops::RangeInclusive<f64> = power(-40)..=power(40);
/// Where a value above 0 is below this, the chain ends. So between two looks
/// all stay above 2^-500, and the products of two chains are normal doubles.
pub(super) const LEAST: f64 = power(-300);

/// A in arrays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrix<const N: usize> {
    columns: [[f64; N]; N],
    rows: [[f64; N]; N],
    /// Steps with likelihoods of at least this, or 0, are calm.
    calm: f64,
}

impl<const N: usize> Matrix<N> {
    /// From the entries, column after column.
    pub(super) fn new(entries: &[f64], states: usize) -> Option<Self> {
        let mut columns = [[0.0; N]; N];
        for (column, entries) in columns.iter_mut().zip(entries.chunks_exact(states)) {
            *column = filled_up(entries, 0.0)?;
        }
        let mut rows = columns;
        (0..N).for_each(|i| (0..N).for_each(|j| rows[i][j] = columns[j][i]));
        let above_0 = columns.as_flattened().iter().copied().filter(|a| *a > 0.0);
        Some(Self { columns, rows, calm: CALM / above_0.fold(1.0, f64::min) })
    }

    /// How many steps with these likelihoods may be taken without a look; `None`
    /// if a likelihood is too small.
    #[inline(always)]
    pub(super) fn unlooked(&self, diagonals: [&[[f64; N]]; 2]) -> Option<usize> {
        let none_below =
            |least| diagonals.iter().all(|rows| none_between_0_and(least, rows.as_flattened()));
        if none_below(self.calm) {
            return Some(UNLOOKED);
        }
        none_below(LEAST_FACTOR).then_some(1)
    }

    /// The same where the least likelihood above 0 is known.
    pub(super) fn unlooked_from(&self, least: f64) -> Option<usize> {
        if least >= self.calm {
            return Some(UNLOOKED);
        }
        (least >= LEAST_FACTOR).then_some(1)
    }

    /// For eight segments at a time.
    pub(super) fn few(&self, unlooked: usize) -> Few<'_, N> {
        Few { columns: &self.columns, rows: &self.rows, unlooked }
    }

    /// B(y) A x.
    #[inline(always)]
    pub(super) fn ahead(&self, b: &[f64; N], x: &[f64; N]) -> [f64; N] {
        times(b, &product(&self.columns, x))
    }

    /// A' B(y) x.
    #[inline(always)]
    pub(super) fn back(&self, b: &[f64; N], x: &[f64; N]) -> [f64; N] {
        product(&self.rows, &times(b, x))
    }
}

/// A vector of one of the recursions, times 2^exponent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chain<const N: usize> {
    pub(super) values: [f64; N],
    pub(super) exponent: i64,
}

impl<const N: usize> Chain<N> {
    pub(super) fn new(values: [f64; N]) -> Option<Self> {
        let mut chain = Self { values, exponent: 0 };
        chain.look()?;
        Some(chain)
    }

    /// Looks at the scale. `None` if the range has become too wide, or nothing
    /// is left.
    #[inline(always)]
    pub(super) fn look(&mut self) -> Option<()> {
        let mut largest = 0.0;
        self.values.iter().for_each(|&x| largest = if x > largest { x } else { largest });
        if !SCALES.contains(&largest) {
            if largest == 0.0 {
                return None;
            }
            let by = exponent(largest);
            self.values.iter_mut().for_each(|x| *x *= power(-by));
            self.exponent += by;
        }
        none_between_0_and(LEAST, &self.values).then_some(())
    }
}

/// Whether each value is 0, or at least so much.
#[inline(always)]
pub(super) fn none_between_0_and(least: f64, values: &[f64]) -> bool {
    let mut found = false;
    values.iter().for_each(|x| found |= *x < least && *x > 0.0);
    !found
}

/// Σ_j a_j x_j.
#[inline(always)]
fn product<const N: usize>(lines: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    let mut out = lines[0];
    out.iter_mut().for_each(|a| *a *= x[0]);
    for j in 1..N {
        for i in 0..N {
            out[i] += lines[j][i] * x[j];
        }
    }
    out
}

/// x ∘ y.
#[inline(always)]
pub(super) fn times<const N: usize>(x: &[f64; N], y: &[f64; N]) -> [f64; N] {
    let mut out = *x;
    out.iter_mut().zip(y).for_each(|(out, y)| *out *= y);
    out
}
