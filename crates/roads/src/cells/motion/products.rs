//! Products with A = Σ w_k M^k, by Horner's rule: one product with M for each cell of the distance.
//! All terms are at least 0, so nothing cancels.

use super::{CellTransition, Travel};
use wayfix::Transition;
use wayfix::internal::{buffers, check_slices};

impl CellTransition {
    /// Computes `out = M x`, one cell ahead.
    fn one_ahead(&self, x: &[f64], out: &mut [f64]) {
        // Cells are numbered along the edges. The shift is right but for the first cell of each
        // edge, which gets that of another edge and is overwritten by the turns.
        out[1..].copy_from_slice(&x[..x.len() - 1]);
        for edge in 0..self.layout.edge_count() {
            let arrivals = self.before.of(edge).iter();
            out[self.layout.first(edge)] =
                arrivals.map(|&(before, p)| p * x[self.layout.last(before as usize)]).sum();
        }
        // What would drive on from an end stays; nothing else arrives there but by the shift.
        if self.stay {
            for &edge in &self.ends {
                let last = self.layout.last(edge as usize);
                out[last] += x[last];
            }
        }
    }

    /// Computes `out = M' x`.
    fn one_behind(&self, x: &[f64], out: &mut [f64]) {
        // As above, with the last cell of each edge overwritten.
        out[..x.len() - 1].copy_from_slice(&x[1..]);
        for edge in 0..self.layout.edge_count() {
            let turns = self.next.of(edge).iter();
            out[self.layout.last(edge)] =
                turns.map(|&(next, p)| p * x[self.layout.first(next as usize)]).sum();
        }
        if self.stay {
            for &edge in &self.ends {
                let last = self.layout.last(edge as usize);
                out[last] = x[last];
            }
        }
    }

    /// Computes Σ w_k M^k x by Horner's rule, with M given as `one`.
    fn polynomial(
        &self,
        travel: &Travel,
        x: &[f64],
        out: &mut [f64],
        one: impl Fn(&Self, &[f64], &mut [f64]),
    ) {
        check_slices(self.states(), x, out);
        let set = |weight: f64, out: &mut [f64]| {
            out.iter_mut().zip(x).for_each(|(out, x)| *out = weight * x);
        };
        let last = travel.last();
        if last == 0 {
            return set(travel.exactly(0), out);
        }
        buffers::with(x.len(), |other| {
            // Products alternate between the two buffers; `last` of them end in `out`.
            let (mut from, mut to) =
                if last.is_multiple_of(2) { (out, &mut *other) } else { (&mut *other, out) };
            set(travel.exactly(last), from);
            // Invariant: `from` is Σ over k > cells of w_k M^(k − cells − 1) x.
            for cells in (0..last).rev() {
                one(self, from, to);
                let weight = travel.exactly(cells);
                if weight > 0.0 {
                    to.iter_mut().zip(x).for_each(|(out, x)| *out += weight * x);
                }
                (from, to) = (to, from);
            }
        });
    }

    pub(super) fn product(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.polynomial(travel, x, out, Self::one_ahead);
    }

    pub(super) fn transposed_product(&self, travel: &Travel, x: &[f64], out: &mut [f64]) {
        self.polynomial(travel, x, out, Self::one_behind);
    }
}
