//! Labels and queue of a search for shortest paths (Dijkstra, 1959), over the places of a map or
//! the edges of a network.
//!
//! Costs are never negative, so a vertex that is taken from the queue has its final cost. Labels
//! carry the number of their search, so that starting a new one takes O(1) rather than O(vertices).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Labels and queue of a search, whose memory is reused by the next one.
#[derive(Debug, Clone, Default)]
pub struct Search<T> {
    labels: Vec<Label<T>>,
    /// Number of the current search; labels with another number belong to earlier ones.
    number: u32,
    /// Vertices by the bits of their costs, which for non-negative doubles have the order of the
    /// values, then by a rank.
    queue: BinaryHeap<Reverse<(u64, u32, u32)>>,
}

/// Best path to a vertex so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct Label<T> {
    search: u32,
    /// The vertex before; the start itself for a start.
    pub before: u32,
    is_settled: bool,
    pub cost: f64,
    /// Measures of the path.
    pub way: T,
}

impl<T: Copy + Default> Search<T> {
    /// Starts a search among at least `vertices` vertices.
    pub fn start(&mut self, vertices: usize) {
        self.labels.resize(vertices.max(self.labels.len()), Label::default());
        // Before numbers repeat, labels of old searches are erased.
        if self.number == u32::MAX {
            self.labels.fill(Label::default());
            self.number = 0;
        }
        self.number += 1;
        self.queue.clear();
    }

    /// Offers a path to a vertex, given its rank, by way of another vertex. It replaces a longer
    /// path; of equally long ones the first is kept, or with `lowest` the one by the vertex with
    /// the lowest number.
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
        // The old entry stays in the queue and is skipped when its turn comes: cheaper than finding
        // it.
        *label = Label { search: self.number, before, is_settled: false, cost, way };
        self.queue.push(Reverse((cost.to_bits(), rank, to as u32)));
    }

    /// Settles the nearest vertex left, whose path cannot become shorter.
    #[inline]
    pub fn settle(&mut self) -> Option<(usize, Label<T>)> {
        while let Some(Reverse((.., vertex))) = self.queue.pop() {
            let label = &mut self.labels[vertex as usize];
            // A vertex is in the queue once for each improvement; the first is the best.
            if !std::mem::replace(&mut label.is_settled, true) {
                return Some((vertex as usize, *label));
            }
        }
        None
    }

    /// Label of a vertex that the last search settled.
    #[must_use]
    pub fn settled(&self, vertex: usize) -> Option<&Label<T>> {
        self.labels.get(vertex).filter(|label| label.search == self.number && label.is_settled)
    }

    /// Label of a vertex that the last search met.
    #[must_use]
    pub fn met(&self, vertex: usize) -> Option<&Label<T>> {
        self.labels.get(vertex).filter(|label| label.search == self.number)
    }
}
