//! Directed road networks: places, edges with their lines, and forbidden turns; their nodes as a
//! map, and consistent flows on them.

use std::ops::Range;

use crate::NetworkError;
use wayfix::internal::{Places, balance};
use wayfix::map::{Coordinates, Place, Position, Road, RoadClass, RoadMap};

/// Directed edge of a network, from one node to another, with a line between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Index of the node where the edge starts.
    pub from: usize,
    /// Index of the node where it ends.
    pub to: usize,
    /// Class of the road.
    pub class: RoadClass,
    /// Length in metres, above 0.
    pub metres: f64,
    /// Posted speed in metres per second, if known.
    pub speed: Option<f64>,
    /// True for a part of a roundabout.
    pub roundabout: bool,
}

/// A directed road network: nodes, edges with their geometry, and forbidden turns.
///
/// Unlike a [`RoadMap`](wayfix::map::RoadMap), whose places are the states of a model, a network
/// keeps everything that a position along a road needs: the line of each edge, parallel edges and
/// loops, one-way streets, turn restrictions. It is built in code by a
/// [`NetworkBuilder`](crate::NetworkBuilder), or imported from files. Methods identify nodes
/// and edges by their index, from 0; edges are sorted by the node where they start, then by the one
/// where they end.
///
/// ```
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{Position, RoadClass};
///
/// let mut builder = NetworkBuilder::new();
/// for (id, longitude) in [(1, 149.12), (2, 149.13), (3, 149.14)] {
///     builder.node(id, Position { latitude: -35.28, longitude })?;
/// }
/// builder.both_ways(1, 2, RoadClass::Main)?;
/// builder.one_way(2, 3, RoadClass::Street)?;
/// let network = builder.build()?;
///
/// assert_eq!(network.edges().len(), 3);
/// let out = network.edge_between(0, 1).unwrap();
/// assert_eq!(network.edges()[out].metres.round(), 908.0);
/// assert_eq!(network.reverse(out), network.edge_between(1, 0));
/// // From edge 1 → 2: on to 3, or back.
/// let next: Vec<_> = network.next(out).map(|e| network.edges()[e].to).collect();
/// assert_eq!(next, [0, 2]);
/// # Ok::<(), wayfix_roads::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct RoadNetwork<P = Position> {
    pub(super) nodes: Places<P>,
    pub(super) edges: Vec<Edge>,
    /// Edges out of node i are `starts[i]..starts[i + 1]`.
    pub(super) starts: Vec<u32>,
    /// Points of edge e, including both ends, are `shape_starts[e]..shape_starts[e + 1]`.
    pub(super) points: Vec<P>,
    pub(super) shape_starts: Vec<u32>,
    /// The same road in the other direction, or `NONE`.
    pub(super) reverse: Vec<u32>,
    /// Forbidden pairs of edges, sorted.
    pub(super) forbidden: Vec<(u32, u32)>,
}

/// Marks an edge without a reverse, or a missing index.
pub(super) const NONE: u32 = u32::MAX;

impl<P> RoadNetwork<P> {
    /// Nodes, in the order they were added.
    #[must_use]
    pub fn nodes(&self) -> &[Place<P>] {
        &self.nodes.list
    }

    /// Edges, in the order of their ends.
    #[must_use]
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Index of the node with this id, or `None`.
    #[must_use]
    pub fn index_of_id(&self, id: u64) -> Option<usize> {
        self.nodes.index_of(id)
    }

    /// Edges that start at a node.
    ///
    /// # Panics
    ///
    /// If the node does not exist.
    #[must_use]
    pub fn edges_from(&self, node: usize) -> Range<usize> {
        self.starts[node] as usize..self.starts[node + 1] as usize
    }

    /// Shortest of the edges from one node to another, or `None`.
    #[must_use]
    pub fn edge_between(&self, from: usize, to: usize) -> Option<usize> {
        (from < self.nodes().len()).then_some(())?;
        let between = self.edges_from(from).filter(|&e| self.edges[e].to == to);
        between.min_by(|&a, &b| self.edges[a].metres.total_cmp(&self.edges[b].metres))
    }

    /// The same road in the other direction, or `None` for a one-way road.
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn reverse(&self, edge: usize) -> Option<usize> {
        let reverse = self.reverse[edge];
        (reverse != NONE).then_some(reverse as usize)
    }

    /// Edges that may follow an edge: those out of its end, including the way back, without
    /// forbidden turns.
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    pub fn next(&self, edge: usize) -> impl Iterator<Item = usize> {
        self.edges_from(self.edges[edge].to).filter(move |&next| self.may_turn(edge, next))
    }

    /// True unless the turn from one edge to the next is forbidden.
    #[must_use]
    pub fn may_turn(&self, edge: usize, next: usize) -> bool {
        // The common case of a network without restrictions needs no search.
        self.forbidden.is_empty()
            || self.forbidden.binary_search(&(edge as u32, next as u32)).is_err()
    }

    /// Forbidden turns, as pairs of edges, in ascending order.
    #[must_use]
    pub fn forbidden_turns(&self) -> impl ExactSizeIterator<Item = (usize, usize)> {
        self.forbidden.iter().map(|&(edge, next)| (edge as usize, next as usize))
    }

    /// Points of the line of an edge, including both ends.
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn shape(&self, edge: usize) -> &[P] {
        &self.points[self.shape_starts[edge] as usize..self.shape_starts[edge + 1] as usize]
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Map with the nodes as places, with the shortest of parallel edges and without loops.
    /// O((nodes + edges) log).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Map`] without nodes.
    pub fn to_map(&self) -> Result<RoadMap<P>, NetworkError> {
        let road = |edge: &Edge| {
            let [from, to] = [edge.from, edge.to].map(|node| self.nodes()[node].id);
            Road { from, to, class: edge.class, metres: edge.metres }
        };
        let cleaned = RoadMap::cleaned(self.nodes().iter().cloned(), self.edges().iter().map(road));
        Ok(cleaned?.0)
    }
}

impl<P> RoadNetwork<P> {
    /// Flow nearest to counts of traffic, one per edge, such that inflow equals outflow at each
    /// node. See [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Map`] with the errors of
    /// [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    pub fn consistent_flow(&self, counts: &[f64]) -> Result<Vec<f64>, NetworkError> {
        let ends: Vec<_> = self.edges().iter().map(|edge| [edge.from, edge.to]).collect();
        Ok(balance(self.nodes().len(), &ends, counts, |i| self.nodes()[i].id)?)
    }
}
