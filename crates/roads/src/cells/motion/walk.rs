//! Entries of A = Σ w_k M^k, by walks over the edges. Arrivals leave a heap by their distance, so
//! that all arrivals at an edge after the same number of cells are added up before it is left.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::{CellTransition, Travel};

/// Arrival of a walk at an edge: the cells of the walk before the nearest cell of the edge, and the
/// probability. Ordered for a heap: fewer cells come first.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    /// Counted from the nearest cell of the edge where the walk starts.
    distance: usize,
    edge: u32,
    p: f64,
}

impl Arrival {
    fn key(&self) -> (usize, u32) {
        (self.distance, self.edge)
    }
}

impl PartialEq for Arrival {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Arrival {}

impl PartialOrd for Arrival {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Arrival {
    fn cmp(&self, other: &Self) -> Ordering {
        other.key().cmp(&self.key())
    }
}

impl CellTransition {
    /// Lists the entries out of a cell, in ascending order.
    pub(super) fn ahead(
        &self,
        travel: &Travel,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let edge = self.layout.edge(from);
        let is_end = usize::from(self.stays_at_end(edge));
        let travel = travel.clone();
        // Most steps end on the same edge. The last cell of an end edge collects tails, so it is
        // left to the walk.
        let near = from + travel.last() + is_end <= self.layout.last(edge);
        let cells = if near { travel.first()..travel.last() + 1 } else { 0..0 };
        let far = if near { Vec::new() } else { self.walk(&travel, from, true) };
        let near = cells.map(move |cells| (from + cells, travel.exactly(cells)));
        near.chain(far).filter(|entry| entry.1 > 0.0)
    }

    /// Lists the entries into a cell, in ascending order.
    pub(super) fn behind(
        &self,
        travel: &Travel,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let edge = self.layout.edge(to);
        let is_end = to == self.layout.last(edge) && self.stays_at_end(edge);
        let travel = travel.clone();
        let near = !is_end && to - self.layout.first(edge) >= travel.last();
        let cells = if near { travel.first()..travel.last() + 1 } else { 0..0 };
        let far = if near { Vec::new() } else { self.walk(&travel, to, false) };
        let near = cells.rev().map(move |cells| (to - cells, travel.exactly(cells)));
        near.chain(far).filter(|entry| entry.1 > 0.0)
    }

    /// Walks over the edges in order of distance, so that all arrivals at an edge after the same
    /// number of cells become one. Lists the cells reached, each once, in ascending order.
    fn walk(&self, travel: &Travel, start: usize, ahead: bool) -> Vec<(usize, f64)> {
        let edge = self.layout.edge(start);
        // The walk counts from the nearest cell of its first edge; the start is `before` cells
        // farther.
        let before =
            if ahead { start - self.layout.first(edge) } else { self.layout.last(edge) - start };
        // A vehicle that stays at an end may have driven any number of cells from there on, so the
        // weights of an end are tails, and those of no cells count too.
        let into_end = !ahead && before == 0 && self.stays_at_end(edge);
        let first = before + if into_end { 0 } else { travel.first() };
        let last = before + travel.last();
        let mut heap = BinaryHeap::new();
        heap.push(Arrival { distance: 0, edge: edge as u32, p: 1.0 });
        let mut found = Vec::new();
        while let Some(Arrival { distance, edge, mut p }) = heap.pop() {
            // Lengths are at least one cell, so no later arrival has this key: merging here is
            // final.
            while let Some(same) = heap.peek().filter(|other| other.key() == (distance, edge)) {
                p += same.p;
                heap.pop();
            }
            let edge = edge as usize;
            let cells = self.layout.cells(edge);
            let out_of_end = ahead && self.stays_at_end(edge);
            let farthest = (last + 1 - distance).min(cells.len());
            for number in first.saturating_sub(distance)..farthest {
                let driven = distance + number - before;
                let is_end = out_of_end && number + 1 == cells.len();
                if !is_end {
                    let cell = if ahead { cells.start + number } else { cells.end - 1 - number };
                    let weight =
                        if into_end { travel.at_least(driven) } else { travel.exactly(driven) };
                    found.push((cell, p * weight));
                }
            }
            // A vehicle that would drive on from an end is in its last cell: a tail of the weights.
            if out_of_end && farthest == cells.len() {
                let driven = (distance + cells.len() - 1).saturating_sub(before);
                found.push((cells.end - 1, p * travel.at_least(driven)));
            }
            let distance = distance + cells.len();
            if distance <= last {
                let turns = if ahead { self.next.of(edge) } else { self.before.of(edge) };
                let arrivals = turns.iter().map(|turn| (turn.0, p * turn.1));
                heap.extend(arrivals.map(|(edge, p)| Arrival { distance, edge, p }));
            }
        }
        // A walk may pass a cell several times, around a block, at several distances.
        found.sort_unstable_by_key(|entry| entry.0);
        found.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0.0 };
            same
        });
        found
    }
}
