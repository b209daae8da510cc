//! Distinct routes of a drive, with their probabilities.
//!
//! Rules determine which stretches a move adds to a route. They turn a path of states into a route,
//! and the posterior of a drive into a lattice whose arcs spell out edges. Many paths spell the
//! same route, so the best path is not the best route: a best-first search over the first words of
//! routes finds the most probable sequences of edges. A prefix stands for all routes that begin
//! with its words. Its bound is never below the probability of any of them, and exact for a whole
//! route, so, as in A*, a whole route that is taken from the queue is the best of all routes that
//! are left.
//!
//! **Bounds.** From a node, the routes whose next word is w have at most the probability B(w), the
//! sum over arcs without words of p · B'(w) with B' of the arc's end, plus, over the arcs whose
//! first word is w, the same sum with the best word that may follow. This bounds every route whose
//! next word is w: each of its paths is in one of the two sums, and the best word that may follow
//! is at least as probable as the one that the route has next. Paths of one route leave an edge at
//! different points; they are added up before the best word is taken, which keeps the bound tight.

mod lattice;
#[cfg(test)]
mod tests;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

use super::candidates::Candidate;
use super::route::route;
use super::step::MatchStep;
use super::{MatchError, MatchedDrive, Matcher, Stretches};
use lattice::{END, Lattice, Share};
use wayfix::map::Coordinates;

/// Most probable routes of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedRoutes<P> {
    /// Distinct routes, most probable first: edges in order and stretches off the road, with the
    /// probability of this sequence of edges, wherever the points lie along them. They begin and
    /// end where the most probable points along these edges do.
    pub routes: Vec<Stretches<P>>,
    /// Probability of all other routes together.
    pub remaining: f64,
    /// True if these are proven to be the most probable routes: as many as requested, or all there
    /// are. False if the search would have taken too long, so that more probable ones may be
    /// missing; the probability of each is exact in either case.
    pub is_exact: bool,
}

/// Number of moves that the search may visit, and more per route, before it heads straight for
/// likely routes.
const MOST_MOVES: usize = 1_000_000;
const MOVES_A_ROUTE: usize = 20_000;

impl<P: Coordinates> Matcher<P> {
    /// Finds the `count` most probable distinct routes of a drive that this matcher matched, in
    /// descending order, or all if there are fewer. The probability of a route is that of all ways
    /// to place the points along the same edges; it is exact but for moves below 1e-30, which are
    /// left out. Between two points, a vehicle takes the way of least cost, so only one of two ways
    /// of equal length is found.
    ///
    /// This is a best-first search over the first edges of routes, with a bound on the best
    /// continuation. It takes as long as the match, plus O(edges of a route) per route where little
    /// of the drive is in doubt. The time grows exponentially with the number of places of even
    /// odds; after 1,000,000 + 20,000 · `count` moves the search heads straight for likely routes,
    /// and [`is_exact`](RankedRoutes::is_exact) is false.
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{PlanePosition, RoadClass};
    /// use wayfix_roads::matching::{Matcher, TracePoint};
    ///
    /// // Two ways around a block, and a point nearer to one of them.
    /// let at = |x, y| PlanePosition { x, y };
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 100.0, 0.0), (3, 200.0, 30.0), (4, 200.0, -30.0),
    ///                    (5, 300.0, 0.0), (6, 400.0, 0.0)] {
    ///     builder.node(id, at(x, y))?;
    /// }
    /// for (from, to) in [(1, 2), (2, 3), (2, 4), (3, 5), (4, 5), (5, 6)] {
    ///     builder.one_way(from, to, RoadClass::Street)?;
    /// }
    /// let matcher = Matcher::new(builder.build()?);
    /// let points = [(0.0, 50.0, 0.0), (15.0, 200.0, 3.0), (30.0, 350.0, 0.0)]
    ///     .map(|(time, x, y)| TracePoint::new(time, at(x, y)));
    ///
    /// let drive = matcher.match_drive(&points)?;
    /// let found = matcher.routes(&drive, 2)?;
    /// let edges = |route: usize| -> Vec<_> {
    ///     found.routes[route].stretches.iter().map(|stretch| stretch.edge).collect()
    /// };
    /// assert_eq!(edges(0), [Some(0), Some(1), Some(3), Some(5)]);
    /// assert_eq!(edges(1), [Some(0), Some(2), Some(4), Some(5)]);
    /// assert!(found.routes[0].probability > found.routes[1].probability);
    /// assert!(found.is_exact && found.remaining < 0.1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MatchError::Network`] for a drive matched on another network.
    pub fn routes(
        &self,
        drive: &MatchedDrive<P>,
        count: usize,
    ) -> Result<RankedRoutes<P>, MatchError> {
        self.check_network(drive.network)?;
        let mut step = MatchStep::new(self, &self.model);
        let lattice = Lattice::new(&self.network, drive, &mut step);
        let most = MOVES_A_ROUTE.saturating_mul(count).saturating_add(MOST_MOVES);
        let found = RouteSearcher::new(&lattice).find(count, most);
        let sum: f64 = found.routes.iter().map(|route| route.1).sum();
        // The words give only edges. The places where the route begins, ends and turns are those of
        // its most probable states.
        let ranked = |(words, probability): (Vec<u32>, f64)| {
            let states: Vec<Candidate> = (lattice.best_states(&words).iter())
                .zip(&drive.states)
                .map(|(state, states)| states[*state as usize])
                .collect();
            let stretches = route(&self.network, &drive.points, &states, &mut step);
            Stretches { stretches, probabilities: Vec::new(), probability: probability.min(1.0) }
        };
        let routes = found.routes.into_iter().map(ranked).collect();
        Ok(RankedRoutes { routes, remaining: (1.0 - sum).max(0.0), is_exact: found.is_exact })
    }
}

/// Routes as sequences of words, with their probabilities.
struct Found {
    routes: Vec<(Vec<u32>, f64)>,
    /// True if no other route is more probable than any of these, and there are as many as
    /// requested or all there are.
    is_exact: bool,
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
struct RouteSearcher<'a> {
    lattice: &'a Lattice,
    bounds: RouteBounds,
    prefixes: Vec<Prefix>,
    /// Prefixes with the bits of their bounds, which have the order of the bounds, since these are
    /// not negative.
    open: BinaryHeap<(u64, Reverse<u32>)>,
    arcs_visited: usize,
    /// Probability at each node for the prefix being expanded; all zero in between.
    mass: Vec<f64>,
}

impl<'a> RouteSearcher<'a> {
    fn new(lattice: &'a Lattice) -> Self {
        let bounds = RouteBounds::new(lattice);
        let start = Share { to: 0, words: [0; 2], probability: 1.0 };
        let prefixes = vec![Prefix { before: 0, word: END, shares: vec![start] }];
        let open = BinaryHeap::from([(1_f64.to_bits(), Reverse(0))]);
        let mass = vec![0.0; lattice.states.len()];
        Self { lattice, bounds, prefixes, open, arcs_visited: 0, mass }
    }

    /// Finds the most probable routes, best first. After `most_arcs` arcs it heads straight for
    /// likely routes.
    fn find(mut self, count: usize, most_arcs: usize) -> Found {
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
                if self.arcs_visited >= most_arcs {
                    // Too many to prove an order: follow the best child down to a whole route.
                    is_exact = false;
                    let best = (0..children.len()).max_by_key(|child| children[*child]);
                    next = best.map(|best| children.swap_remove(best));
                }
                let open = |(bound, child)| (bound, Reverse(child));
                self.open.extend(children.into_iter().map(open));
            }
        }
        // Already in order if exact; routes found by following the best child are not.
        routes.sort_by(|a: &(Vec<u32>, f64), b| b.1.total_cmp(&a.1));
        Found { routes, is_exact }
    }

    /// Extends a prefix by each word that may follow. Returns the longer prefixes with their
    /// bounds.
    fn expand(&mut self, prefix: u32) -> Vec<(u64, u32)> {
        let mut next: Vec<(u32, Share)> = Vec::new();
        let mut nodes = BinaryHeap::new();
        let lattice = self.lattice;
        let advance =
            |mass: &mut [f64], nodes: &mut BinaryHeap<_>, next: &mut Vec<_>, share: Share| {
                if share.has_arrived() {
                    let mass = &mut mass[share.to as usize];
                    // A node enters the heap with its first probability, so it is there once.
                    if *mass == 0.0 && share.probability > 0.0 {
                        nodes.push(Reverse(share.to));
                    }
                    *mass += share.probability;
                } else {
                    let [word, end] = share.words;
                    next.push((
                        lattice.words[word as usize],
                        Share { words: [word + 1, end], ..share },
                    ));
                }
            };
        for share in std::mem::take(&mut self.prefixes[prefix as usize].shares) {
            advance(&mut self.mass, &mut nodes, &mut next, share);
        }
        // Arcs lead to higher nodes, so everything that reaches a node has arrived when its turn
        // comes. Taking the probability leaves a zero for the next prefix.
        while let Some(Reverse(node)) = nodes.pop() {
            let probability = std::mem::take(&mut self.mass[node as usize]);
            for arc in lattice.arcs(node) {
                advance(&mut self.mass, &mut nodes, &mut next, arc.share(probability));
            }
            self.arcs_visited += lattice.arcs(node).len();
        }
        next.sort_by_key(|next| next.0);
        let mut children = Vec::new();
        // One child per word, with the shares of all paths that spell it: this is where paths of
        // one route are added up.
        for same in next.chunk_by(|a, b| a.0 == b.0) {
            let shares: Vec<Share> = same.iter().map(|next| next.1).collect();
            // `of` changes the shares that it is given.
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

/// Largest number of next words of a node with bounds of their own.
const WORDS: usize = 12;

/// Bounds of all nodes.
#[derive(Debug, Default)]
struct RouteBounds {
    nodes: Vec<NodeBounds>,
    /// Next words in ascending order, with the excess of their bounds over that for any word.
    excess: Vec<(u32, f64)>,
}

#[derive(Debug, Clone, Default)]
struct NodeBounds {
    /// Bound for any word that is not listed.
    bound_any: f64,
    best: f64,
    excess: Range<u32>,
}

impl RouteBounds {
    /// Computes the bounds of all nodes, from the last to the first. O(arcs).
    fn new(lattice: &Lattice) -> Self {
        let nodes = lattice.states.len();
        let mut bounds = Self { nodes: vec![NodeBounds::default(); nodes], excess: Vec::new() };
        let (mut shares, mut excess) = (Vec::new(), Vec::new());
        // Arcs lead to higher nodes, whose bounds are already known.
        for node in (0..nodes).rev() {
            // Nothing follows the end: what arrives there is a whole route.
            let mut bound_any = 1.0;
            excess.clear();
            if node + 1 < nodes {
                shares.clear();
                shares.extend(lattice.arcs(node as u32).iter().map(|arc| arc.share(1.0)));
                bound_any = bounds.bound_by_word(lattice, &mut shares, &mut excess);
            }
            if excess.len() > WORDS {
                excess.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                // The largest excess that is dropped is added to the bound for any word, and
                // subtracted from the listed words, whose excess is at least as large. So the
                // bounds of listed words stay the same, and those of dropped words can only grow.
                let most = excess[WORDS].1;
                excess.truncate(WORDS);
                excess.iter_mut().for_each(|word| word.1 -= most);
                bound_any += most;
                excess.sort_unstable_by_key(|word| word.0);
            }
            let first = bounds.excess.len() as u32;
            bounds.excess.extend_from_slice(&excess);
            let best = bound_any + most_of(&excess);
            let excess = first..bounds.excess.len() as u32;
            bounds.nodes[node] = NodeBounds { bound_any, best, excess };
        }
        bounds
    }

    /// Bound on the routes that have these shares, whatever their next word. Sorts the shares.
    fn of(&self, lattice: &Lattice, shares: &mut [Share]) -> f64 {
        if let [share] = shares {
            // The usual case on long roads. The words left on the arc of a single share are
            // certain, so the best bound at the arc's end holds, whether or not the share has
            // arrived there.
            return share.probability * self.nodes[share.to as usize].best;
        }
        let mut excess = Vec::new();
        let bound_any = self.bound_by_word(lattice, shares, &mut excess);
        bound_any + most_of(&excess)
    }

    /// Computes the bound of shares for any next word, and the excess for some words.
    fn bound_by_word(
        &self,
        lattice: &Lattice,
        shares: &mut [Share],
        excess: &mut Vec<(u32, f64)>,
    ) -> f64 {
        let mut bound_any = 0.0;
        // Arrived shares first, then the others by their next word, for chunks of one word each.
        let next = |share: &Share| lattice.words[share.words[0] as usize];
        shares.sort_by_key(|share| if share.has_arrived() { (0, 0) } else { (1, next(share)) });
        let arrived = shares.partition_point(Share::has_arrived);
        let (arrived, on_the_way) = shares.split_at_mut(arrived);
        for share in arrived {
            let bound = &self.nodes[share.to as usize];
            // Bounds are linear in the shares, so the excesses of one word add up below.
            bound_any += share.probability * bound.bound_any;
            let words = &self.excess[bound.excess.start as usize..bound.excess.end as usize];
            excess.extend(words.iter().map(|(word, more)| (*word, share.probability * more)));
        }
        for shares in on_the_way.chunk_by_mut(|a, b| next(a) == next(b)) {
            // All paths with this word in common take it. What follows is bounded by the best next
            // word of them all.
            let word = next(&shares[0]);
            shares.iter_mut().for_each(|share| share.words[0] += 1);
            excess.push((word, self.of(lattice, shares)));
        }
        excess.sort_by_key(|word| word.0);
        // `dedup_by` drops `next` if the closure is true, after its excess was added to the one
        // kept.
        excess.dedup_by(|next, word| {
            let is_same = next.0 == word.0;
            word.1 += if is_same { next.1 } else { 0.0 };
            is_same
        });
        bound_any
    }
}

fn most_of(excess: &[(u32, f64)]) -> f64 {
    excess.iter().fold(0.0, |most, word| f64::max(most, word.1))
}
