//! Labels of a search for shortest ways (Dijkstra, 1959): of places on a map, of edges in a
//! network.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Labels and queue of a search. They keep their memory from one search to the next.
#[derive(Debug, Clone, Default)]
pub struct Search<T> {
    labels: Vec<Label<T>>,
    /// Number of the search; labels of another number are those of an earlier one.
    number: u32,
    /// Vertices by the bits of their costs: those of non-negative doubles have the order of the
    /// values. Of equal costs by a rank.
    queue: BinaryHeap<Reverse<(u64, u32, u32)>>,
}

/// Best way to a vertex so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct Label<T> {
    search: u32,
    /// The vertex before; the start itself for a start.
    pub before: u32,
    is_settled: bool,
    pub cost: f64,
    /// Measures of the way.
    pub way: T,
}

impl<T: Copy + Default> Search<T> {
    /// Starts a search among so many vertices, or more.
    pub fn start(&mut self, vertices: usize) {
        self.labels.resize(vertices.max(self.labels.len()), Label::default());
        if self.number == u32::MAX {
            self.labels.fill(Label::default());
            self.number = 0;
        }
        self.number += 1;
        self.queue.clear();
    }

    /// Offers a way to a vertex, of which the rank is given, by another one. It replaces a longer
    /// one; of equally long ones the first stays, or with `lowest` that by the vertex with the lowest
    /// number.
    #[inline]
    pub fn offer(
        &mut self,
        (to, rank): (usize, u32),
        before: usize,
        cost: f64,
        way: T,
        lowest: bool,
    ) {
        if to >= self.labels.len() {
            self.labels.resize(to + 1, Label::default());
        }
        let (label, before) = (&mut self.labels[to], before as u32);
        let is_known = label.search == self.number;
        let is_tie_won = lowest && cost == label.cost && before < label.before;
        if is_known && (label.is_settled || (label.cost <= cost && !is_tie_won)) {
            return;
        }
        *label = Label { search: self.number, before, is_settled: false, cost, way };
        self.queue.push(Reverse((cost.to_bits(), rank, to as u32)));
    }

    /// Settles the nearest vertex that is left, to which no shorter way can be found.
    #[inline]
    pub fn settle(&mut self) -> Option<(usize, Label<T>)> {
        while let Some(Reverse((.., vertex))) = self.queue.pop() {
            let label = &mut self.labels[vertex as usize];
            // A vertex is in the queue once for each better way that was found.
            if !std::mem::replace(&mut label.is_settled, true) {
                return Some((vertex as usize, *label));
            }
        }
        None
    }

    /// Label of a vertex that was settled in the last search.
    pub fn settled(&self, vertex: usize) -> Option<&Label<T>> {
        self.labels.get(vertex).filter(|label| label.search == self.number && label.is_settled)
    }

    /// Label of a vertex that the last search met.
    pub fn met(&self, vertex: usize) -> Option<&Label<T>> {
        self.labels.get(vertex).filter(|label| label.search == self.number)
    }
}
