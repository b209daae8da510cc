//! The matcher: a network, an index of its edges, and a model of drives, with spare memory for
//! steps.

use super::moves::Move;
use super::receiver::{ByReception, EdgeEstimate};
use super::sighting::Sighting;
use super::{MatchError, MatchModel};
use crate::cells::{EdgeTurns, TurnWeights};
use crate::{EdgeIndex, NearEdge, RoadNetwork, RouteMeasures, RouteSearch};
use wayfix::internal::parallel::ScratchPool;
use wayfix::map::{Coordinates, Position};

/// Number of drives per thread that are being matched or whose results have not been taken yet.
pub(super) const DRIVES_AHEAD: usize = 4;

/// Matcher of vehicle positions to the roads of a network.
///
/// See the [module](super) for the model and an example. Threads can share a matcher. It keeps
/// working memory for the search of roads and routes: some 10 bytes per edge of the network, times
/// the largest number of threads that have used it at once.
#[derive(Debug, Clone)]
pub struct Matcher<P = Position> {
    pub(super) network: RoadNetwork<P>,
    pub(super) index: EdgeIndex,
    pub(super) measures: RouteMeasures,
    pub(super) model: MatchModel,
    /// Fingerprint of the network.
    pub(super) fingerprint: u64,
    /// Memory that no thread is using.
    pub(super) spare: ScratchPool<Memory>,
}

/// Working memory of a step.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) search: RouteSearch,
    pub(super) near: Vec<NearEdge>,
    /// Sightings of the states on roads, and the log-likelihoods of their headings.
    pub(super) sightings: Vec<Sighting>,
    pub(super) log_heading_likelihoods: Vec<f64>,
    /// Predicted places of the previous states.
    pub(super) places: Vec<EdgeEstimate>,
    /// Moves into each state.
    pub(super) entries: Vec<Vec<Entry>>,
    /// Moves of the last step, in the order of the trellis.
    pub(super) moves: Vec<Move>,
}

/// A move into a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Number of the previous state.
    pub(super) from: usize,
    pub(super) log: f64,
    pub(super) kind: Move,
    /// Probability that the position belongs to the road.
    pub(super) inlier: f64,
    /// Metres along the previous edge at which the edge of the state would start; `None` if it is
    /// not reached over its start.
    pub(super) starts: Option<f64>,
    /// Probabilities of the kinds of reception after the position.
    pub(super) shares: ByReception,
}

impl<P: Coordinates> Matcher<P> {
    /// Builds the index of a network, with the default model. O(points log).
    #[must_use]
    pub fn new(network: RoadNetwork<P>) -> Self {
        let index = EdgeIndex::new(&network);
        let prior = TurnWeights::default();
        let weight =
            |edge, next| prior.weight_of(&network, edge, next) * straight_on(&network, edge, next);
        let measures = RouteMeasures::with_turns(&network, weight);
        let (model, fingerprint) = (MatchModel::default(), fingerprint(&network));
        Self { network, index, measures, model, fingerprint, spare: ScratchPool::default() }
    }

    /// Replaces the model.
    ///
    /// # Errors
    ///
    /// [`MatchError::Parameter`] for a parameter out of range.
    pub fn with_model(self, model: MatchModel) -> Result<Self, MatchError> {
        model.check()?;
        Ok(Self { model, ..self })
    }

    /// Replaces the weights of turns at junctions by weights learned from drives or from traffic.
    /// The defaults follow from the classes of the roads and the angles.
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{PlanePosition, RoadClass};
    /// use wayfix_roads::matching::{Matcher, TracePoint};
    /// use wayfix_roads::cells::{EdgeTurns, TurnWeights};
    /// use wayfix::transition::MoveCounts;
    ///
    /// // Two ways from west to east, and a point in the middle between them.
    /// let at = |x, y| PlanePosition { x, y };
    /// let mut builder = NetworkBuilder::new();
    /// let nodes = [at(0.0, 0.0), at(100.0, 0.0), at(150.0, 9.0), at(150.0, -9.0), at(200.0, 0.0)];
    /// for (id, position) in (1..).zip(nodes) {
    ///     builder.node(id, position)?;
    /// }
    /// let [start, _, south] = [(1, 2), (2, 3), (2, 4)]
    ///     .map(|(from, to)| builder.one_way(from, to, RoadClass::Street).unwrap());
    /// builder.one_way(3, 5, RoadClass::Street)?;
    /// builder.one_way(4, 5, RoadClass::Street)?;
    /// let network = builder.build()?;
    /// let drive = [(0.0, 20.0), (10.0, 130.0)].map(|(time, x)| TracePoint::new(time, at(x, 0.0)));
    ///
    /// // A driver went south once, and the prior counts a twentieth of that.
    /// let counts = MoveCounts::of_path(&[start, south]);
    /// let turns = EdgeTurns::fit(&network, &counts, &TurnWeights::default(), 0.05)?;
    /// let matcher = Matcher::new(network);
    /// let p = |matcher: &Matcher<_>| -> Result<f64, wayfix_roads::matching::MatchError> {
    ///     let edges = matcher.match_drive(&drive)?.edges(1);
    ///     Ok(edges.iter().filter(|edge| edge.0 == south).map(|edge| edge.1).sum())
    /// };
    /// let before = p(&matcher)?;
    /// let after = p(&matcher.with_turns(&turns))?;
    /// assert!((before - 0.5).abs() < 0.02 && after > 0.8);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    ///
    /// If the network of the turns has fewer edges: they must be those of this network.
    #[must_use]
    pub fn with_turns(mut self, turns: &EdgeTurns) -> Self {
        let probability = |edge, next| turns.turn(edge, next);
        self.measures = RouteMeasures::with_turns(&self.network, probability);
        self
    }

    /// Network of the matcher.
    #[must_use]
    pub fn network(&self) -> &RoadNetwork<P> {
        &self.network
    }

    /// Model of drives.
    #[must_use]
    pub fn model(&self) -> &MatchModel {
        &self.model
    }

    /// Checks that a vehicle or drive comes from a network with this fingerprint.
    pub(super) fn check_network(&self, found: u64) -> Result<(), MatchError> {
        let expected = self.fingerprint;
        if found == expected { Ok(()) } else { Err(MatchError::Network { found, expected }) }
    }
}

/// Hash of the counts of a network, the ids of its nodes, and the ends and lengths of its edges.
/// O(nodes + edges). It is stored with vehicles, so it must be the same on all machines.
fn fingerprint<P>(network: &RoadNetwork<P>) -> u64 {
    let counts = [network.nodes().len(), network.edges().len(), network.forbidden_turns().len()];
    let counts = counts.into_iter().map(|count| count as u64);
    let ids = network.nodes().iter().map(|node| node.id);
    let edges = network.edges().iter();
    let edges = edges.flat_map(|edge| [edge.from as u64, edge.to as u64, edge.metres.to_bits()]);
    // The constants are the offset basis of FNV and the multiplier of Fibonacci hashing.
    counts.chain(ids).chain(edges).fold(0xcbf2_9ce4_8422_2325, |sum: u64, word| {
        // As doubles, lengths differ in their high bits, and a multiplication only moves bits up:
        // the shift brings them down.
        let mixed = (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 32)
    })
}

/// Relative traffic of a turn by its angle. At 1,301 junctions on 19 recorded drives, the
/// straightest way was taken 93% of the time where the next is 80° or more off, and 58% where it is
/// 5° off. The scale is the most probable one there, ignoring the traffic of the classes.
fn straight_on<P: Coordinates>(network: &RoadNetwork<P>, edge: usize, next: usize) -> f64 {
    /// Degrees over which traffic falls to 1/e, and the share of traffic at any angle.
    const SCALE: f64 = 25.0;
    const ANY: f64 = 0.05;
    let direction = |pair: [&P; 2]| {
        let [a, b] = pair.map(|position| position.to_plane());
        let b = P::wrapped(b, a);
        [b[0] - a[0], b[1] - a[1]]
    };
    let (line, next) = (network.shape(edge), network.shape(next));
    // Last piece of the edge and first piece of the next: the angle at the junction itself.
    let ([.., a, b], [c, d, ..]) = (line, next) else { return 1.0 };
    let ([x, y], [u, v]) = (direction([a, b]), direction([c, d]));
    // The angle between two directions by their cross and dot products, which needs no lengths.
    let degrees = (x * v - y * u).atan2(x * u + y * v).abs().to_degrees();
    (-degrees / SCALE).exp() + ANY
}
