//! Distinct routes of a drive, with their probabilities.

use super::candidates::Candidate;
use super::drive::{MatchedDrive, Stretch};
use super::moves::Move;
use super::{MatchError, MatchMemory, Matcher};
use crate::inference::log_sum;
use crate::map::Coordinates;

/// A route of a whole drive, with its probability.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedRoute<P> {
    /// Edges in order, and stretches off the road.
    pub stretches: Vec<Stretch<P>>,
    /// Probability of this sequence of edges, whatever the points along them.
    pub probability: f64,
}

/// Paths that are looked at for each route that is wanted: many differ in a point near a junction
/// alone.
const PATHS: usize = 32;

impl<P: Coordinates> Matcher<P> {
    /// Finds up to `count` distinct routes of a drive that this matcher matched, the most probable
    /// first. Their probabilities add up all ways to place the points along the same edges.
    ///
    /// Routes are those of the 32 · `count` most probable paths, so that for a long drive with many
    /// doubts a route may be missing. Ways between two points are known by their length: of two of
    /// equal length, each probability may count both. O(points · candidates² · count).
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # use wayfix::matching::{MatchMemory, Matcher, TracePoint};
    /// # let mut builder = NetworkBuilder::new();
    /// let at = |x, y| PlanePosition { x, y };
    /// // Two ways from west to east, 20 m apart.
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 100.0, 10.0), (3, 100.0, -10.0), (4, 200.0, 0.0), (5, 300.0, 0.0)] {
    ///     builder.node(id, at(x, y))?;
    /// }
    /// for (from, to) in [(1, 2), (2, 4), (1, 3), (3, 4), (4, 5)] {
    ///     builder.one_way(from, to, RoadClass::Street)?;
    /// }
    /// let (matcher, mut memory) = (Matcher::new(builder.build()?), MatchMemory::default());
    /// let drive = [(0.0, 5.0, 0.0), (10.0, 100.0, 2.0), (20.0, 250.0, 0.0)]
    ///     .map(|(time, x, y)| TracePoint::new(time, at(x, y)));
    /// let matched = matcher.match_drive(&drive, &mut memory)?;
    /// let routes = matcher.routes(&matched, 2, &mut memory)?;
    /// assert_eq!(routes.len(), 2);
    /// assert!(routes[0].probability > routes[1].probability && routes[1].probability > 0.1);
    /// assert_eq!(routes[0].stretches, matched.route());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MatchError::Network`] for a drive that a matcher of another network matched.
    pub fn routes(
        &self,
        drive: &MatchedDrive<P>,
        count: usize,
        memory: &mut MatchMemory,
    ) -> Result<Vec<RankedRoute<P>>, MatchError> {
        self.check_network(drive.network)?;
        let paths = drive.trellis.k_best(PATHS.saturating_mul(count))?;
        let mut routes: Vec<RankedRoute<P>> = Vec::new();
        for path in paths {
            let states: Vec<Candidate> =
                path.states().iter().zip(&drive.states).map(|(s, states)| states[*s]).collect();
            let stretches = self.route(&drive.points, &states, memory);
            if routes.iter().any(|known| edges(&known.stretches).eq(edges(&stretches))) {
                continue;
            }
            let edges: Vec<Option<usize>> = edges(&stretches).collect();
            let probability = self.probability(drive, &edges);
            routes.push(RankedRoute { stretches, probability });
        }
        routes.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        routes.truncate(count);
        Ok(routes)
    }

    /// Probability of a sequence of edges: a forward pass over the states on it.
    fn probability(&self, drive: &MatchedDrive<P>, route: &[Option<usize>]) -> f64 {
        // Metres from the start of the route to the start of each of its parts.
        let mut starts = vec![0.0];
        for edge in route {
            let metres = edge.map_or(0.0, |edge| self.network.edges()[edge].metres);
            starts.push(starts[starts.len() - 1] + metres);
        }
        let places = |state: &Candidate| {
            let edge = (!state.is_off_road()).then_some(state.edge as usize);
            (0..route.len()).filter(move |&at| route[at] == edge)
        };
        // For each state, the places of the route on its edge, with ln p.
        let mut before: Vec<Vec<(usize, f64)>> = Vec::new();
        let mut moves = drive.moves.iter();
        for (number, states) in drive.states.iter().enumerate() {
            let mut now: Vec<Vec<(usize, f64)>> = Vec::with_capacity(states.len());
            for (to, state) in states.iter().enumerate() {
                let log_likelihood = drive.trellis.log_likelihood(number + 1, to);
                let entries: Vec<_> = drive.trellis.moves(number + 1, to).collect();
                let moved: Vec<Option<&Move>> = match number {
                    0 => vec![None],
                    _ => entries.iter().map(|_| moves.next()).collect(),
                };
                let at_place = |at: usize| {
                    let mut terms = Vec::new();
                    for ((from, weight), moved) in entries.iter().zip(&moved) {
                        let Some(moved) = moved else {
                            let first = if at == 0 { *weight } else { f64::NEG_INFINITY };
                            terms.push(first);
                            continue;
                        };
                        let from_state = &drive.states[number - 1][*from];
                        for &(start, log) in &before[*from] {
                            let parts = &route[start..=at.max(start)];
                            let between = starts[at] - starts[start];
                            if at >= start
                                && self.follows(moved, [from_state, state], parts, between)
                            {
                                terms.push(log + weight);
                            }
                        }
                    }
                    (at, log_sum(terms.into_iter()) + log_likelihood)
                };
                let reached = places(state).map(at_place);
                now.push(reached.filter(|(_, log)| *log > f64::NEG_INFINITY).collect());
            }
            before = now;
        }
        let ends = before.iter().flatten().filter(|(at, _)| *at + 1 == route.len());
        let all: Vec<f64> = ends.map(|end| end.1).collect();
        (log_sum(all.into_iter()) - drive.log_likelihood()).exp().min(1.0)
    }

    /// True if a move goes along these parts of a route, the first and the last of which are those
    /// of the two states, so many metres apart.
    fn follows(
        &self,
        moved: &Move,
        [from, to]: [&Candidate; 2],
        parts: &[Option<usize>],
        between: f64,
    ) -> bool {
        match moved {
            // Off the road, or one part on.
            Move::OffRoad => parts.len() == 1 + usize::from(from.edge != to.edge),
            Move::Along { metres, .. } => {
                let same = (metres - (between + to.along - from.along)).abs() < 0.1;
                // A U-turn on the way leaves out the rest of the edge.
                let reverse = self.network.reverse(from.edge as usize);
                let turned = parts.len() == 2 && reverse == Some(to.edge as usize);
                parts.iter().all(Option::is_some) && (same || turned)
            }
        }
    }
}

fn edges<P>(stretches: &[Stretch<P>]) -> impl Iterator<Item = Option<usize>> {
    stretches.iter().map(|stretch| stretch.edge)
}
