//! Max-products with a dense matrix of logarithms, eight rows at a time: formula 7 of the guide.
//!
//! Each maximum runs over the columns in ascending order, and keeps the first of several that attain
//! it: ties go to the lowest state.

use super::product::RowSums;
use crate::log2::log2_in_place;
use crate::semiring::MaxPlus;
use crate::simd::{Eight, LANES, Simd, kernels, store, store_indices};
use crate::vector::Aligned;

/// Logarithms of a dense matrix, in panels of eight rows, each of them by columns.
#[derive(Debug, Clone)]
pub struct Panels {
    states: usize,
    /// Panel g begins at 8 g n; −∞ beyond the last row.
    values: Aligned,
}

impl Panels {
    /// Takes the logarithms, to base 2 as decoders add them, of entries at (to, from).
    pub fn log2(states: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        // Rows beyond the last are 0, a probability, so their logarithms are −∞.
        let mut values = Aligned::new(states.next_multiple_of(LANES) * states, 0.0);
        for j in 0..states {
            for i in 0..states {
                values[(i / LANES * states + j) * LANES + i % LANES] = entry(i, j);
            }
        }
        log2_in_place(&mut values);
        Self { states, values }
    }

    /// `out[i]` = max over j of log2 A\[i, j\] + `x[j]`, and `from[i]` the lowest j that attains it.
    pub fn maximize(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        maximize(self, x, out, from);
    }
}

kernels! {
    fn maximize = maximize_rows<'a>(
        matrix: &'a Panels, x: &'a [f64], out: &'a mut [f64], from: &'a mut [u32],
    ) -> ();
}

#[inline(always)]
fn maximize_rows<S: Simd>(
    s: S,
    Panels { states, values }: &Panels,
    x: &[f64],
    out: &mut [f64],
    from: &mut [u32],
) {
    let n = *states;
    assert!(x.len() == n && out.len() == n && from.len() == n, "one value per state");
    let mut rows = PanelRows { panels: values.as_chunks().0, x, out, from, first: 0 };
    // Each call takes what the previous one has left, so at most one panel is taken alone.
    rows.maximize::<S, 4>(s);
    rows.maximize::<S, 2>(s);
    rows.maximize::<S, 1>(s);
}

/// Rows that are left, beginning with panel `first`.
struct PanelRows<'a> {
    panels: &'a [Eight],
    x: &'a [f64],
    out: &'a mut [f64],
    from: &'a mut [u32],
    first: usize,
}

impl PanelRows<'_> {
    /// Takes P panels side by side, while P are left: a single one would wait for each maximum.
    #[inline(always)]
    fn maximize<S: Simd, const P: usize>(&mut self, s: S) {
        let n = self.x.len();
        while (self.first + P) * n <= self.panels.len() {
            let panels: [&[Eight]; P] =
                std::array::from_fn(|p| &self.panels[(self.first + p) * n..][..n]);
            // P maxima and their indices: with eight panels they would not stay in registers.
            let mut sums = [MaxPlus.zero(s); P];
            for (j, &x) in self.x.iter().enumerate() {
                let (x, index) = (s.splat(x), s.load_indices(&[j as u32; LANES]));
                for p in 0..P {
                    MaxPlus.add(s, &mut sums[p], s.load(&panels[p][j]), x, index);
                }
            }
            let (mut out, mut from) = (self.out.as_chunks_mut(), self.from.as_chunks_mut());
            for (p, sum) in sums.into_iter().enumerate() {
                store(s, &mut out, self.first + p, sum.value);
                store_indices(s, &mut from, self.first + p, sum.index);
            }
            self.first += P;
        }
    }
}
