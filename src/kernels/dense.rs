//! Products with a dense matrix that is stored by columns.
//!
//! Each sum runs over the columns (or down them) in their order, however many are
//! taken at a time: results do not depend on the sizes of blocks.

use super::aligned::Aligned;
use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::total;

/// How many columns are gone through side by side.
const COLUMNS: usize = 8;

/// A matrix of n × n by columns, each of them filled up with 0 to eights on whole
/// cache lines.
#[derive(Debug, Clone)]
pub(crate) struct Dense {
    states: usize,
    values: Aligned,
}

impl Dense {
    /// All 0.
    pub(crate) fn new(states: usize) -> Self {
        let values = Aligned::new(states.next_multiple_of(LANES) * states, 0.0);
        Self { states, values }
    }

    pub(crate) fn states(&self) -> usize {
        self.states
    }

    /// What is between the beginnings of columns.
    pub(crate) fn stride(&self) -> usize {
        self.states.next_multiple_of(LANES)
    }

    /// All columns, with what fills them up.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    pub(crate) fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.stride()..][..self.states]
    }

    pub(crate) fn column_mut(&mut self, j: usize) -> &mut [f64] {
        let start = j * self.stride();
        &mut self.values[start..start + self.states]
    }

    /// `out = A x`.
    pub(crate) fn multiply(&self, x: &[f64], out: &mut [f64]) {
        run(Multiply { matrix: self, x, out });
    }

    /// `out = A' x`.
    pub(crate) fn multiply_transpose(&self, x: &[f64], out: &mut [f64]) {
        run(MultiplyTranspose { matrix: self, x, out });
    }

    /// So many columns from the first on, in eights.
    #[inline(always)]
    fn columns<const C: usize>(&self, first: usize) -> [&[Eight]; C] {
        let eights = self.states.div_ceil(LANES);
        let columns = &self.values.as_chunks().0[first * eights..(first + C) * eights];
        std::array::from_fn(|c| &columns[c * eights..(c + 1) * eights])
    }
}

struct Multiply<'a> {
    matrix: &'a Dense,
    x: &'a [f64],
    out: &'a mut [f64],
}

impl Kernel for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { matrix, x, out } = self;
        assert!(x.len() == matrix.states && out.len() == matrix.states, "one value per state");
        out.fill(0.0);
        let (xs, rest) = x.as_chunks::<COLUMNS>();
        for (number, x) in xs.iter().enumerate() {
            add(lanes, matrix.columns(number * COLUMNS), x, out);
        }
        let from = xs.len() * COLUMNS;
        let (halves, rest) = rest.as_chunks::<{ COLUMNS / 2 }>();
        for x in halves {
            add(lanes, matrix.columns(from), x, out);
        }
        let from = x.len() - rest.len();
        for (number, x) in rest.iter().enumerate() {
            add(lanes, matrix.columns(from + number), &[*x], out);
        }
    }
}

/// Adds columns, each times its x.
#[inline(always)]
fn add<L: Lanes, const C: usize>(lanes: L, columns: [&[Eight]; C], x: &[f64; C], out: &mut [f64]) {
    let x: [L::V; C] = std::array::from_fn(|c| lanes.splat(x[c]));
    let (outs, rest) = out.as_chunks_mut::<LANES>();
    let whole: [&[Eight]; C] = std::array::from_fn(|c| &columns[c][..outs.len()]);
    for (number, out) in outs.iter_mut().enumerate() {
        let mut sum = lanes.load(out);
        for c in 0..C {
            sum = lanes.add(sum, lanes.mul(lanes.load(&whole[c][number]), x[c]));
        }
        lanes.store(sum, out);
    }
    if !rest.is_empty() {
        let mut sum = lanes.load_part(rest);
        for c in 0..C {
            sum = lanes.add(sum, lanes.mul(lanes.load(&columns[c][outs.len()]), x[c]));
        }
        lanes.store_part(sum, rest);
    }
}

struct MultiplyTranspose<'a> {
    matrix: &'a Dense,
    x: &'a [f64],
    out: &'a mut [f64],
}

impl Kernel for MultiplyTranspose<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { matrix, x, out } = self;
        assert!(x.len() == matrix.states && out.len() == matrix.states, "one value per state");
        let (outs, rest) = out.as_chunks_mut::<COLUMNS>();
        for (number, out) in outs.iter_mut().enumerate() {
            *out = dots(lanes, matrix.columns(number * COLUMNS), x);
        }
        let from = outs.len() * COLUMNS;
        for (number, out) in rest.iter_mut().enumerate() {
            [*out] = dots(lanes, matrix.columns(from + number), x);
        }
    }
}

/// The dot products of columns with x.
#[inline(always)]
fn dots<L: Lanes, const C: usize>(lanes: L, columns: [&[Eight]; C], x: &[f64]) -> [f64; C] {
    let (xs, rest) = x.as_chunks::<LANES>();
    let whole: [&[Eight]; C] = std::array::from_fn(|c| &columns[c][..xs.len()]);
    let mut sums = [lanes.splat(0.0); C];
    for (number, x) in xs.iter().enumerate() {
        let x = lanes.load(x);
        for c in 0..C {
            sums[c] = lanes.add(sums[c], lanes.mul(lanes.load(&whole[c][number]), x));
        }
    }
    if !rest.is_empty() {
        let x = lanes.load_part(rest);
        for c in 0..C {
            sums[c] = lanes.add(sums[c], lanes.mul(lanes.load(&columns[c][xs.len()]), x));
        }
    }
    std::array::from_fn(|c| total(lanes.to_array(sums[c])))
}

#[cfg(test)]
mod tests {
    use super::super::lanes::{Isa, run_on};
    use super::*;

    const ALL: [Isa; 3] = [Isa::Plain, Isa::Avx2, Isa::Avx512];

    fn values(count: usize, factor: f64) -> Vec<f64> {
        (1..=count).map(|i| (i as f64 * factor).fract()).collect()
    }

    fn sizes() -> impl Iterator<Item = usize> {
        (1..=40).chain([63, 64, 65, 100, 105, 131])
    }

    #[test]
    fn products_are_sums_in_order_on_every_instruction_set() {
        for n in sizes() {
            let (a, x) = (values(n * n, 0.618_033_988_7), values(n, 0.414_213_562_3));
            let (mut sums, mut backs) = (vec![0.0; n], vec![0.0; n]);
            for j in 0..n {
                for i in 0..n {
                    sums[i] += a[j * n + i] * x[j];
                    backs[j] += a[j * n + i] * x[i];
                }
            }
            let mut matrix = Dense::new(n);
            (0..n).for_each(|j| matrix.column_mut(j).copy_from_slice(&a[j * n..(j + 1) * n]));
            let (matrix, x) = (&matrix, &x[..]);
            let mut firsts: Option<Vec<f64>> = None;
            for isa in ALL {
                // Overwrites what was there, NaN too.
                let mut out = vec![f64::NAN; n];
                run_on(isa, Multiply { matrix, x, out: &mut out });
                assert_eq!(out, sums, "{n} on {isa:?}");
                run_on(isa, MultiplyTranspose { matrix, x, out: &mut out });
                let close = |(out, back): (&f64, &f64)| (out - back).abs() <= 1e-13 * back;
                assert!(out.iter().zip(&backs).all(close), "{n} on {isa:?}");
                assert_eq!(&out, firsts.get_or_insert(out.clone()), "{n} on {isa:?}");
            }
        }
    }
}
