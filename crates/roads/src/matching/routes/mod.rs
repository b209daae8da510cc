//! Distinct routes of a drive, with their probabilities.
//!
//! Rules determine which stretches a move adds to a route. They turn a path of states into a route,
//! and the posterior of a drive into a lattice whose arcs spell out edges. Many paths spell the
//! same route, so the best path is not the best route: a best-first search over the first edges of
//! routes, guided by upper bounds, finds the most probable sequences of edges.

mod bounds;
mod lattice;
mod path;
mod rules;
mod search;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::candidates::Candidate;
use super::step::MatchStep;
use super::{MatchError, MatchedDrive, Matcher, Stretches};
use lattice::{END, Lattice};
pub(super) use path::route;
use search::RouteSearcher;
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
        // The words give only edges. Where the route begins, ends and turns is that of its most
        // probable states.
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

impl Lattice {
    /// Most probable states of a route, one per step, given its words. Ties go to the lowest node.
    fn best_states(&self, route: &[u32]) -> Vec<u32> {
        let mut words = route.to_vec();
        words.push(END);
        // Viterbi over pairs of a node and the number of words spelled so far: for each pair of a
        // step, the probability of the best way and the pair before.
        let mut steps = vec![BTreeMap::from([((0_u32, 0_usize), (1.0_f64, (0_u32, 0_usize)))])];
        let end = ((self.states.len() - 1) as u32, words.len());
        while steps.last().is_some_and(|step| !step.is_empty() && !step.contains_key(&end)) {
            let mut next = BTreeMap::new();
            let before = &steps[steps.len() - 1];
            // Divided by the largest of the step: products over a long drive would underflow, and
            // only ratios matter.
            let scale = before.values().map(|way| way.0).fold(0.0, f64::max);
            for (&(node, done), way) in before {
                for arc in self.arcs(node) {
                    let said = &self.words[arc.words[0] as usize..arc.words[1] as usize];
                    // Only arcs that spell the next words of this route.
                    if !words[done..].starts_with(said) {
                        continue;
                    }
                    let probability = way.0 / scale * arc.probability;
                    let best =
                        next.entry((arc.to, done + said.len())).or_insert((0.0, (node, done)));
                    // Strictly: pairs ascend by node, so a tie keeps the lowest.
                    if probability > best.0 {
                        *best = (probability, (node, done));
                    }
                }
            }
            // A pair whose ratio to the best underflowed could only lead to 0 / 0.
            next.retain(|_, way| way.0 > 0.0);
            steps.push(next);
        }
        let (mut states, mut at) = (Vec::new(), end);
        for step in steps.iter().skip(1).rev() {
            let Some(way) = step.get(&at) else { break };
            at = way.1;
            states.push(self.states[at.0 as usize]);
        }
        // The last is the start.
        states.pop();
        states.reverse();
        states
    }
}
