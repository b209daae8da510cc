//! Best-first search for the most probable routes, over prefixes of their words.
//!
//! A prefix stands for all routes that begin with its words. Its bound is never below the
//! probability of any of them, and exact for a whole route, so, as in A*, a whole route that is
//! taken from the queue is the best of all routes that are left.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::bounds::RouteBounds;
use super::lattice::{END, Lattice, Share};

/// Routes as sequences of words, with their probabilities.
pub(super) struct Found {
    pub(super) routes: Vec<(Vec<u32>, f64)>,
    /// True if no other route is more probable than any of these, and there are as many as
    /// requested or all there are.
    pub(super) is_exact: bool,
}

/// First words of routes, as a link to the prefix that is one word shorter.
struct Prefix {
    /// Number of the prefix without the last word.
    before: u32,
    word: u32,
    /// Parts of the probability that have just spelled the last word.
    shares: Vec<Share>,
}

/// Search for the routes of a lattice.
pub(super) struct RouteSearcher<'a> {
    lattice: &'a Lattice,
    bounds: RouteBounds,
    prefixes: Vec<Prefix>,
    /// Prefixes with the bits of their bounds, which have the order of the bounds, since these are
    /// not negative.
    open: BinaryHeap<(u64, Reverse<u32>)>,
    arcs: usize,
    /// Probability at each node for the prefix being expanded; all zero in between.
    at: Vec<f64>,
}

impl<'a> RouteSearcher<'a> {
    pub(super) fn new(lattice: &'a Lattice) -> Self {
        let bounds = RouteBounds::new(lattice);
        let start = Share { to: 0, words: [0; 2], probability: 1.0 };
        let prefixes = vec![Prefix { before: 0, word: END, shares: vec![start] }];
        let open = BinaryHeap::from([(1_f64.to_bits(), Reverse(0))]);
        let at = vec![0.0; lattice.states.len()];
        Self { lattice, bounds, prefixes, open, arcs: 0, at }
    }

    /// Finds the most probable routes, best first. After `most_arcs` arcs it heads straight for
    /// likely routes.
    pub(super) fn find(mut self, count: usize, most_arcs: usize) -> Found {
        let (mut routes, mut is_exact) = (Vec::new(), true);
        while routes.len() < count
            && let Some((bound, Reverse(prefix))) = self.open.pop()
        {
            let mut next = Some((bound, prefix));
            while let Some((bound, prefix)) = next.take() {
                if prefix > 0 && self.prefixes[prefix as usize].word == END {
                    routes.push((self.words(prefix), f64::from_bits(bound)));
                    break;
                }
                // A prefix leaves the queue once, and its shares are moved on to its children.
                let mut children = self.expand(prefix);
                if self.arcs >= most_arcs {
                    // Too many to prove an order: follow the best child down to a whole route.
                    is_exact = false;
                    let best = (0..children.len()).max_by_key(|child| children[*child]);
                    next = best.map(|best| children.swap_remove(best));
                }
                let open = |(bound, child)| (bound, Reverse(child));
                self.open.extend(children.into_iter().map(open));
            }
        }
        // Already in order if exact; routes found by diving are not.
        routes.sort_by(|a: &(Vec<u32>, f64), b| b.1.total_cmp(&a.1));
        Found { routes, is_exact }
    }

    /// Extends a prefix by each word that may follow. Returns the longer prefixes with their
    /// bounds.
    fn expand(&mut self, prefix: u32) -> Vec<(u64, u32)> {
        let mut next: Vec<(u32, Share)> = Vec::new();
        let mut nodes = BinaryHeap::new();
        let lattice = self.lattice;
        let go = |at: &mut [f64], nodes: &mut BinaryHeap<_>, next: &mut Vec<_>, share: Share| {
            if share.has_arrived() {
                let at = &mut at[share.to as usize];
                // A node enters the heap with its first probability, so it is there once.
                if *at == 0.0 && share.probability > 0.0 {
                    nodes.push(Reverse(share.to));
                }
                *at += share.probability;
            } else {
                let [word, end] = share.words;
                next.push((
                    lattice.words[word as usize],
                    Share { words: [word + 1, end], ..share },
                ));
            }
        };
        for share in std::mem::take(&mut self.prefixes[prefix as usize].shares) {
            go(&mut self.at, &mut nodes, &mut next, share);
        }
        // Arcs lead to higher nodes, so everything that reaches a node has arrived when its turn
        // comes. Taking the probability leaves a zero for the next prefix.
        while let Some(Reverse(node)) = nodes.pop() {
            let probability = std::mem::take(&mut self.at[node as usize]);
            for arc in lattice.arcs(node) {
                go(&mut self.at, &mut nodes, &mut next, arc.share(probability));
            }
            self.arcs += lattice.arcs(node).len();
        }
        next.sort_by_key(|next| next.0);
        let mut children = Vec::new();
        // One child per word, with the shares of all paths that spell it: this is where paths of
        // one route are added up.
        for same in next.chunk_by(|a, b| a.0 == b.0) {
            let shares: Vec<Share> = same.iter().map(|next| next.1).collect();
            // The bound advances the shares that it is given.
            let bound = self.bounds.of(lattice, &mut shares.clone());
            if bound > 0.0 {
                let child = self.prefixes.len() as u32;
                self.prefixes.push(Prefix { before: prefix, word: same[0].0, shares });
                children.push((bound.to_bits(), child));
            }
        }
        children
    }

    /// Words of a whole route, without END.
    fn words(&self, route: u32) -> Vec<u32> {
        let mut words = Vec::new();
        let mut prefix = self.prefixes[route as usize].before;
        while prefix > 0 {
            let Prefix { before, word, .. } = self.prefixes[prefix as usize];
            words.push(word);
            prefix = before;
        }
        words.reverse();
        words
    }
}
