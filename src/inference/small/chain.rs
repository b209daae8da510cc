//! The two recursions: forward, x_k = B(y_k) A x_{k-1}, and backward,
//! r_{k-1} = A' B(y_k) r_k, scaled by powers of two, which is exact, and only
//! now and then.

use super::{exponent, power};

/// After so many steps the scale is looked at.
pub(super) const UNLOOKED: usize = 8;
/// Scales are kept in this range. Within [`UNLOOKED`] steps of likelihoods up
/// to 2^16 nothing comes near the end of the range of a double.
const SCALES: std::ops::RangeInclusive<f64> = power(-100)..=power(100);
/// Below this, products of two chains and of two factors might underflow.
const LEAST: f64 = power(-400);

/// A in arrays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrix<const N: usize> {
    columns: [[f64; N]; N],
    rows: [[f64; N]; N],
}

impl<const N: usize> Matrix<N> {
    /// From n² entries, column after column.
    pub(super) fn new(entries: &[f64]) -> Option<Self> {
        let columns: [[f64; N]; N] = entries.as_chunks().0.try_into().ok()?;
        let mut rows = columns;
        (0..N).for_each(|i| (0..N).for_each(|j| rows[i][j] = columns[j][i]));
        Some(Self { columns, rows })
    }

    /// B(y) A x.
    #[inline]
    pub(super) fn ahead(&self, b: &[f64; N], x: &[f64; N]) -> [f64; N] {
        times(b, &product(&self.columns, x))
    }

    /// A' B(y) x.
    #[inline]
    pub(super) fn back(&self, b: &[f64; N], x: &[f64; N]) -> [f64; N] {
        product(&self.rows, &times(b, x))
    }
}

/// A vector of one of the recursions, times 2^exponent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chain<const N: usize> {
    pub(super) values: [f64; N],
    pub(super) exponent: i64,
    /// Whether values have come too near to the end of the range of a double.
    wide: bool,
}

impl<const N: usize> Chain<N> {
    pub(super) fn new(values: [f64; N]) -> Self {
        let mut chain = Self { values, exponent: 0, wide: false };
        chain.set(values);
        chain
    }

    /// Takes the next value.
    #[inline]
    pub(super) fn set(&mut self, values: [f64; N]) {
        let mut wide = false;
        values.iter().for_each(|x| wide |= *x < LEAST && *x > 0.0);
        (self.values, self.wide) = (values, self.wide | wide);
    }

    /// Looks at the scale. `None` if the range has become too wide, or nothing
    /// is left.
    #[inline]
    pub(super) fn look(&mut self) -> Option<()> {
        let largest = self.values.iter().fold(0.0, |a: f64, &b| if b > a { b } else { a });
        if self.wide || largest == 0.0 {
            return None;
        }
        if !SCALES.contains(&largest) {
            let by = exponent(largest);
            self.values.iter_mut().for_each(|x| *x *= power(-by));
            self.exponent += by;
        }
        Some(())
    }
}

/// Σ_j a_j x_j.
#[inline]
fn product<const N: usize>(lines: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    let mut out = lines[0].map(|a| a * x[0]);
    for j in 1..N {
        for i in 0..N {
            out[i] += lines[j][i] * x[j];
        }
    }
    out
}

/// x ∘ y.
#[inline]
pub(super) fn times<const N: usize>(x: &[f64; N], y: &[f64; N]) -> [f64; N] {
    let mut out = *x;
    out.iter_mut().zip(y).for_each(|(out, y)| *out *= y);
    out
}
