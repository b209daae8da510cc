//! Stored operators with their states in another order: A\[order\[i\], order\[j\]\] becomes
//! A\[i, j\]. Values are moved, not computed, so that no check is needed.

use super::compressed::Compressed;
use super::{DenseTransition, SparseTransition, SwitchedTransition};
use crate::fixed::Fixed;
use crate::reorder::{self, ReorderStates};
use crate::transition::Transition;
use wayfix_kernels::Dense;

impl ReorderStates for DenseTransition {
    fn reordered(&self, order: &[usize]) -> Self {
        let mut matrix = Dense::filled(order.len(), 0.0);
        for (from, &old) in order.iter().enumerate() {
            let column = matrix.column_mut(from).iter_mut().zip(order);
            column.for_each(|(p, &to)| *p = self.get(to, old));
        }
        Self::from_valid(matrix)
    }
}

impl ReorderStates for SparseTransition {
    fn reordered(&self, order: &[usize]) -> Self {
        let new = reorder::positions(order);
        let entry = |(to, from, p): (usize, usize, f64)| (new[from] as u32, new[to] as u32, p);
        let entries: Vec<_> = self.triplets().map(entry).collect();
        // Each transpose sorts the indices of its lines.
        let unsorted = Compressed::new(self.states(), entries.iter().copied());
        let rows = unsorted.transposed();
        let columns = rows.transposed();
        Self::from_compressed(rows, columns)
    }
}

impl<A: ReorderStates + Transition> ReorderStates for SwitchedTransition<A> {
    fn reordered(&self, order: &[usize]) -> Self {
        Self { operators: self.operators.iter().map(|a| a.reordered(order)).collect() }
    }
}

impl<T: ReorderStates> ReorderStates for Fixed<T> {
    fn reordered(&self, order: &[usize]) -> Self {
        Self(self.0.reordered(order))
    }
}
