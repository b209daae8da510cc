//! Upper bounds on the probability of the best route that continues from a state.
//!
//! From a node, the routes whose next word is w have at most the probability B(w), the sum over
//! arcs without words of p · B'(w) with B' of the arc's end, plus, over the arcs whose first word
//! is w, the same sum with the best word that may follow. This bounds every route whose next word
//! is w: each of its paths is in one of the two sums, and the best word that may follow is at least
//! as probable as the one that the route has next. Paths of one route leave an edge at different
//! points; they are added up before the best word is taken, which keeps the bound tight.

use std::ops::Range;

use super::lattice::{Lattice, Share};

/// Largest number of next words of a node with bounds of their own.
const WORDS: usize = 12;

/// Bounds of all nodes.
#[derive(Debug, Default)]
pub(super) struct RouteBounds {
    nodes: Vec<Bound>,
    /// Next words in ascending order, with the excess of their bounds over that for any word.
    beyond: Vec<(u32, f64)>,
}

#[derive(Debug, Clone, Default)]
struct Bound {
    /// Bound for any word that is not listed.
    any: f64,
    best: f64,
    beyond: Range<u32>,
}

impl RouteBounds {
    /// Computes the bounds of all nodes, from the last to the first. O(arcs).
    pub(super) fn new(lattice: &Lattice) -> Self {
        let nodes = lattice.states.len();
        let mut bounds = Self { nodes: vec![Bound::default(); nodes], beyond: Vec::new() };
        let (mut shares, mut beyond) = (Vec::new(), Vec::new());
        // Arcs lead to higher nodes, whose bounds are there already.
        for node in (0..nodes).rev() {
            // Nothing follows the end: what arrives there is a whole route.
            let mut any = 1.0;
            beyond.clear();
            if node + 1 < nodes {
                shares.clear();
                shares.extend(lattice.arcs(node as u32).iter().map(|arc| arc.share(1.0)));
                any = bounds.spread(lattice, &mut shares, &mut beyond);
            }
            if beyond.len() > WORDS {
                beyond.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                // The largest excess that is dropped goes to the bound for any word, and comes off
                // the listed ones, which are at least as large: their bounds stay the same, and
                // those of dropped words can only grow.
                let most = beyond[WORDS].1;
                beyond.truncate(WORDS);
                beyond.iter_mut().for_each(|word| word.1 -= most);
                any += most;
                beyond.sort_unstable_by_key(|word| word.0);
            }
            let first = bounds.beyond.len() as u32;
            bounds.beyond.extend_from_slice(&beyond);
            let best = any + most_of(&beyond);
            let beyond = first..bounds.beyond.len() as u32;
            bounds.nodes[node] = Bound { any, best, beyond };
        }
        bounds
    }

    /// Bound on the routes that have these shares, whatever their next word. Sorts the shares.
    pub(super) fn of(&self, lattice: &Lattice, shares: &mut [Share]) -> f64 {
        if let [share] = shares {
            // The usual case on long roads. The words left on the arc of a single share are
            // certain, so the best at its end bounds it, whether or not it has arrived.
            return share.probability * self.nodes[share.to as usize].best;
        }
        let mut beyond = Vec::new();
        let any = self.spread(lattice, shares, &mut beyond);
        any + most_of(&beyond)
    }

    /// Computes the bound of shares for any next word, and the excess for some words.
    fn spread(&self, lattice: &Lattice, shares: &mut [Share], beyond: &mut Vec<(u32, f64)>) -> f64 {
        let mut any = 0.0;
        // Arrived shares first, then the others by their next word, for chunks of one word each.
        let next = |share: &Share| lattice.words[share.words[0] as usize];
        shares.sort_by_key(|share| if share.has_arrived() { (0, 0) } else { (1, next(share)) });
        let arrived = shares.partition_point(Share::has_arrived);
        let (arrived, on_the_way) = shares.split_at_mut(arrived);
        for share in arrived {
            let bound = &self.nodes[share.to as usize];
            // B(w) is linear in the shares: excesses of one word add up below.
            any += share.probability * bound.any;
            let words = &self.beyond[bound.beyond.start as usize..bound.beyond.end as usize];
            beyond.extend(words.iter().map(|(word, more)| (*word, share.probability * more)));
        }
        for shares in on_the_way.chunk_by_mut(|a, b| next(a) == next(b)) {
            // All paths with this word in common, one word further: their sum with the best next
            // word.
            let word = next(&shares[0]);
            shares.iter_mut().for_each(|share| share.words[0] += 1);
            beyond.push((word, self.of(lattice, shares)));
        }
        beyond.sort_by_key(|word| word.0);
        // `dedup_by` drops `next` if the closure is true, after its excess was added to the one
        // kept.
        beyond.dedup_by(|next, word| {
            let is_same = next.0 == word.0;
            word.1 += if is_same { next.1 } else { 0.0 };
            is_same
        });
        any
    }
}

fn most_of(beyond: &[(u32, f64)]) -> f64 {
    beyond.iter().fold(0.0, |most, word| f64::max(most, word.1))
}
