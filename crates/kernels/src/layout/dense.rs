//! Products with a dense matrix that is stored by columns.
//!
//! These are A x and A' x of formulas 2 and 3 of the guide. Each sum runs over the columns (or down
//! a column) in order, however many are taken at a time: results do not depend on the sizes of
//! blocks. Padding is never stored to a result, and is multiplied only by 0.

use crate::simd::{Eight, LANES, Simd, kernels, total};
use crate::vector::Aligned;

/// Number of columns taken side by side.
const COLUMNS: usize = 8;

/// A matrix of n × n by columns, each padded to whole cache lines.
#[derive(Debug, Clone)]
pub struct Dense {
    states: usize,
    values: Aligned,
}

impl Dense {
    /// Fills a matrix, and its padding, with one value.
    pub fn filled(states: usize, value: f64) -> Self {
        let values = Aligned::new(states.next_multiple_of(LANES) * states, value);
        Self { states, values }
    }

    pub fn states(&self) -> usize {
        self.states
    }

    /// Distance between the beginnings of columns.
    pub fn stride(&self) -> usize {
        self.states.next_multiple_of(LANES)
    }

    /// All columns, with their padding.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    pub fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.stride()..][..self.states]
    }

    pub fn column_mut(&mut self, j: usize) -> &mut [f64] {
        let start = j * self.stride();
        &mut self.values[start..start + self.states]
    }

    /// `out = A x`.
    pub fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert!(x.len() == self.states && out.len() == self.states, "one value per state");
        // Columns are added to `out`, eight at a time: n / 8 passes over it instead of n.
        out.fill(0.0);
        multiply(self, x, out);
    }

    /// `out = A' x`.
    pub fn multiply_transpose(&self, x: &[f64], out: &mut [f64]) {
        multiply_transpose(self, x, out);
    }

    /// Takes the first columns, in blocks.
    #[inline(always)]
    fn columns<const C: usize>(&self, first: usize) -> [&[Eight]; C] {
        let eights = self.states.div_ceil(LANES);
        // Strides are multiples of eight, so a column with its padding is whole blocks.
        let columns = &self.values.as_chunks().0[first * eights..(first + C) * eights];
        std::array::from_fn(|c| &columns[c * eights..(c + 1) * eights])
    }
}

kernels! {
    fn multiply = add_columns<'a>(matrix: &'a Dense, x: &'a [f64], out: &'a mut [f64]) -> ();
    fn multiply_transpose = all_dots<'a>(matrix: &'a Dense, x: &'a [f64], out: &'a mut [f64]) -> ();
}

#[inline(always)]
fn add_columns<S: Simd>(s: S, matrix: &Dense, x: &[f64], out: &mut [f64]) {
    let (eights, rest) = x.as_chunks::<COLUMNS>();
    for (number, x) in eights.iter().enumerate() {
        add(s, matrix.columns(number * COLUMNS), x, out);
    }
    // Up to seven columns are left: four of them side by side, the others one by one.
    let first = eights.len() * COLUMNS;
    let (halves, rest) = rest.as_chunks::<{ COLUMNS / 2 }>();
    for x in halves {
        add(s, matrix.columns(first), x, out);
    }
    let first = x.len() - rest.len();
    for (number, x) in rest.iter().enumerate() {
        add(s, matrix.columns(first + number), &[*x], out);
    }
}

/// Adds columns, each times its x.
#[inline(always)]
fn add<S: Simd, const C: usize>(s: S, columns: [&[Eight]; C], x: &[f64; C], out: &mut [f64]) {
    let x: [S::V; C] = std::array::from_fn(|c| s.splat(x[c]));
    let (blocks, rest) = out.as_chunks_mut();
    // Slices as long as the loop: no index check remains in it.
    let whole: [&[Eight]; C] = std::array::from_fn(|c| &columns[c][..blocks.len()]);
    for (number, block) in blocks.iter_mut().enumerate() {
        let mut sum = s.load(block);
        // Add to one sum, column by column: with several partial sums, the rounding would depend
        // on C.
        for c in 0..C {
            sum = s.add(sum, s.mul(s.load(&whole[c][number]), x[c]));
        }
        s.store(sum, block);
    }
    // The block after the whole ones ends in padding, which `store_partial` leaves out.
    if !rest.is_empty() {
        let mut sum = s.load_partial(rest);
        for c in 0..C {
            sum = s.add(sum, s.mul(s.load(&columns[c][whole[c].len()]), x[c]));
        }
        s.store_partial(sum, rest);
    }
}

#[inline(always)]
fn all_dots<S: Simd>(s: S, matrix: &Dense, x: &[f64], out: &mut [f64]) {
    assert!(x.len() == matrix.states && out.len() == matrix.states, "one value per state");
    let (outs, rest) = out.as_chunks_mut::<COLUMNS>();
    for (number, out) in outs.iter_mut().enumerate() {
        *out = dots(s, matrix.columns(number * COLUMNS), x);
    }
    let first = outs.len() * COLUMNS;
    for (number, out) in rest.iter_mut().enumerate() {
        [*out] = dots(s, matrix.columns(first + number), x);
    }
}

/// Dot products of columns with x.
#[inline(always)]
fn dots<S: Simd, const C: usize>(s: S, columns: [&[Eight]; C], x: &[f64]) -> [f64; C] {
    let (xs, rest) = x.as_chunks::<LANES>();
    let whole: [&[Eight]; C] = std::array::from_fn(|c| &columns[c][..xs.len()]);
    // C sums that do not wait for each other share each load of x.
    let mut sums = [s.splat(0.0); C];
    for (number, x) in xs.iter().enumerate() {
        let x = s.load(x);
        for c in 0..C {
            sums[c] = s.add(sums[c], s.mul(s.load(&whole[c][number]), x));
        }
    }
    // x is 0 beyond its end: padding adds nothing, as it is finite.
    if !rest.is_empty() {
        let x = s.load_partial(rest);
        for c in 0..C {
            sums[c] = s.add(sums[c], s.mul(s.load(&columns[c][xs.len()]), x));
        }
    }
    std::array::from_fn(|c| total(s.to_array(sums[c])))
}
