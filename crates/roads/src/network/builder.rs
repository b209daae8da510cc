//! Step-by-step construction of a network, and its final order.
//!
//! Edges get numbers in the order of adding. [`NetworkBuilder::finish`] sorts them by their ends,
//! so that the edges out of a node are a range, and renumbers pairs and forbidden turns.

use super::road_network::{Edge, NONE, RoadNetwork};
use crate::NetworkError;
use wayfix::internal::{Places, check_position};
use wayfix::map::Place;
use wayfix::map::{Coordinates, MapError, Position, RoadClass};

/// Longest edge in metres: sums of all edges stay finite.
pub(crate) const LONGEST_ROAD: f64 = 1e12;
/// Highest posted speed in metres per second.
pub(crate) const FASTEST_ROAD: f64 = 1e9;

/// Builder of a [`RoadNetwork`]: nodes, then edges, then forbidden turns. Each is checked as it is
/// added, so that a reader of files can name the line.
#[derive(Debug, Clone)]
pub struct NetworkBuilder<P = Position> {
    nodes: Places<P>,
    edges: Vec<NewEdge<P>>,
    forbidden: Vec<(usize, usize)>,
}

/// An edge with the inner points of its line.
#[derive(Debug, Clone)]
struct NewEdge<P> {
    edge: Edge,
    between: Vec<P>,
    /// Number of the edge that was added for the other direction.
    reverse: Option<usize>,
}

impl<P: Coordinates> Default for NetworkBuilder<P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<P: Coordinates> NetworkBuilder<P> {
    /// Creates an empty builder.
    #[must_use]
    pub fn new() -> Self {
        Self { nodes: Places::default(), edges: Vec::new(), forbidden: Vec::new() }
    }

    /// Adds a node without a name. Returns its index.
    ///
    /// # Errors
    ///
    /// As [`place`](Self::place).
    pub fn node(&mut self, id: u64, position: P) -> Result<usize, NetworkError> {
        self.place(Place { id, position, name: String::new() })
    }

    /// Adds a node. Returns its index.
    ///
    /// # Errors
    ///
    /// [`MapError::Coordinate`] for a position that is not on Earth (or in the plane), and
    /// [`MapError::DuplicatePlace`] for an id that was given before.
    pub fn place(&mut self, place: Place<P>) -> Result<usize, NetworkError> {
        Ok(self.nodes.add(place)?)
    }

    /// Adds a straight one-way edge between two nodes, by their ids. Returns the number of the
    /// edge, for [`forbid`](Self::forbid).
    ///
    /// # Errors
    ///
    /// As [`edge`](Self::edge).
    pub fn one_way(&mut self, from: u64, to: u64, class: RoadClass) -> Result<usize, NetworkError> {
        self.edge(from, to, EdgeOptions::of(class))
    }

    /// Adds a straight edge in each direction. Returns the number of the first; the second has the
    /// next one.
    ///
    /// # Errors
    ///
    /// As [`edge`](Self::edge).
    pub fn both_ways(
        &mut self,
        from: u64,
        to: u64,
        class: RoadClass,
    ) -> Result<usize, NetworkError> {
        let there = self.edge(from, to, EdgeOptions::of(class))?;
        let back = self.edge(to, from, EdgeOptions::of(class))?;
        self.pair(there, back);
        Ok(there)
    }

    /// Adds an edge between two nodes, by their ids. Returns its number, in the order of adding.
    ///
    /// # Errors
    ///
    /// [`MapError::UnknownPlace`] for a node that was not added, [`MapError::Coordinate`] for a
    /// point that is not on Earth (or in the plane), [`NetworkError::Length`] for a length that is
    /// not above 0 or is above 1e12, and [`NetworkError::Speed`] for a speed that is not above 0 or
    /// is above 1e9.
    pub fn edge(
        &mut self,
        from: u64,
        to: u64,
        options: EdgeOptions<P>,
    ) -> Result<usize, NetworkError> {
        let ends = self.nodes.ends(from, to)?;
        options.between.iter().try_for_each(|&point| check_position(from, point))?;
        let metres = options.metres.unwrap_or_else(|| {
            let [start, end] = ends.map(|end| self.nodes.list[end].position);
            let mut before = start;
            let between = options.between.iter().copied().chain([end]);
            between.map(|point| std::mem::replace(&mut before, point).metres_to(point)).sum()
        });
        if !(metres > 0.0 && metres <= LONGEST_ROAD) {
            return Err(NetworkError::Length { from, to, length: metres });
        }
        if let Some(speed) = options.speed
            && !(speed > 0.0 && speed <= FASTEST_ROAD)
        {
            return Err(NetworkError::Speed { from, to, speed });
        }
        Ok(self.checked_edge(ends, metres, options))
    }

    /// Adds an edge between two nodes, by their indices. The caller has checked all numbers.
    pub(super) fn checked_edge(
        &mut self,
        ends: [usize; 2],
        metres: f64,
        options: EdgeOptions<P>,
    ) -> usize {
        let EdgeOptions { class, speed, roundabout, between, .. } = options;
        let edge = Edge { from: ends[0], to: ends[1], class, metres, speed, roundabout };
        self.edges.push(NewEdge { edge, between, reverse: None });
        self.edges.len() - 1
    }

    /// Returns a builder of nodes whose ids and positions the caller has checked.
    pub(super) fn of_checked(nodes: Vec<Place<P>>) -> Self {
        Self { nodes: Places::of_checked(nodes), ..Self::new() }
    }

    /// Position of a node.
    pub(super) fn position(&self, node: usize) -> P {
        self.nodes.list[node].position
    }

    /// Declares two edges to be the two directions of one road. Otherwise [`build`](Self::build)
    /// pairs edges between the same nodes in opposite directions whose lengths differ by at most
    /// 1%.
    ///
    /// # Panics
    ///
    /// If either edge does not exist, or if the two don't lead between the same nodes in opposite
    /// directions.
    pub fn pair(&mut self, edge: usize, back: usize) {
        let [there, other] = [edge, back].map(|edge| self.edges[edge].edge);
        let opposite = (there.from, there.to) == (other.to, other.from);
        assert!(opposite, "edges {edge} and {back} are not opposite");
        // Former partners of either edge lose it, so that pairs stay mutual.
        let before = [edge, back].map(|edge| self.edges[edge].reverse);
        before.into_iter().flatten().for_each(|old| self.edges[old].reverse = None);
        self.edges[edge].reverse = Some(back);
        self.edges[back].reverse = Some(edge);
    }

    /// Forbids the turn from one edge to the next, by their numbers.
    ///
    /// # Panics
    ///
    /// If either edge does not exist.
    pub fn forbid(&mut self, edge: usize, next: usize) {
        let edges = self.edges.len();
        assert!(edge < edges && next < edges, "no turn from {edge} to {next} of {edges} edges");
        self.forbidden.push((edge, next));
    }

    /// Straight distance between two nodes, by their ids; `None` for a node and itself.
    #[cfg(feature = "csv")]
    pub(crate) fn metres_between(&self, from: u64, to: u64) -> Result<Option<f64>, NetworkError> {
        let ends = self.nodes.ends(from, to)?;
        Ok((from != to).then(|| self.nodes.straight(ends)))
    }

    /// Number of nodes added.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes.list.len()
    }

    /// Number of edges added.
    #[must_use]
    pub fn edges(&self) -> usize {
        self.edges.len()
    }

    /// Builds the network. O((nodes + edges) log).
    ///
    /// # Errors
    ///
    /// [`MapError::Empty`] without nodes.
    pub fn build(self) -> Result<RoadNetwork<P>, NetworkError> {
        if self.nodes.list.is_empty() {
            return Err(MapError::Empty.into());
        }
        Ok(self.finish())
    }

    /// Builds the network, which has at least one node.
    pub(super) fn finish(self) -> RoadNetwork<P> {
        let Self { nodes, edges: added, forbidden } = self;
        let mut order: Vec<u32> = (0..added.len() as u32).collect();
        // A stable sort: parallel edges stay in the order of adding.
        order.sort_by_key(|&e| (added[e as usize].edge.from, added[e as usize].edge.to));
        let mut number = vec![0; added.len()];
        order.iter().zip(0..).for_each(|(&e, index)| number[e as usize] = index);
        let edges: Vec<Edge> = order.iter().map(|&e| added[e as usize].edge).collect();
        // Sorted by their starts, so the edges out of a node begin where earlier nodes end.
        let start = |node: usize| edges.partition_point(|edge| edge.from < node) as u32;
        let starts = (0..=nodes.list.len()).map(start).collect();
        let (mut points, mut shape_starts) = (Vec::new(), vec![0]);
        for &e in &order {
            let NewEdge { edge, between, .. } = &added[e as usize];
            points.push(nodes.list[edge.from].position);
            points.extend_from_slice(between);
            points.push(nodes.list[edge.to].position);
            shape_starts.push(points.len() as u32);
        }
        let declared = |&e: &u32| added[e as usize].reverse.map_or(NONE, |back| number[back]);
        let reverse = order.iter().map(declared).collect();
        let mut forbidden: Vec<(u32, u32)> =
            forbidden.iter().map(|&(edge, next)| (number[edge], number[next])).collect();
        forbidden.sort_unstable();
        forbidden.dedup();
        let mut network =
            RoadNetwork { nodes, edges, starts, points, shape_starts, reverse, forbidden };
        network.find_reverses();
        network
    }
}

impl<P> RoadNetwork<P> {
    /// Pairs edges in opposite directions with about the same length.
    fn find_reverses(&mut self) {
        for e in 0..self.edges.len() {
            let Edge { from, to, metres, .. } = self.edges[e];
            if self.reverse[e] != NONE || from == to {
                continue;
            }
            let difference = |&other: &usize| (self.edges[other].metres - metres).abs();
            // The edges out of a node are sorted by their ends: a binary search keeps a node with
            // many edges from taking quadratic time.
            let all = self.edges_from(to);
            let start = all.start + self.edges[all.clone()].partition_point(|e| e.to < from);
            // Of parallel edges back, the one whose length is nearest is the other direction.
            let nearest = (start..all.end)
                .take_while(|&other| self.edges[other].to == from)
                .filter(|&other| self.reverse[other] == NONE)
                .min_by(|a, b| difference(a).total_cmp(&difference(b)))
                .filter(|other| difference(other) <= 0.01 * metres);
            if let Some(other) = nearest {
                (self.reverse[e], self.reverse[other]) = (other as u32, e as u32);
            }
        }
    }
}

/// Options of a new edge: everything but its ends.
///
/// ```
/// use wayfix_roads::EdgeOptions;
/// use wayfix::map::{Position, RoadClass};
///
/// let options: EdgeOptions<Position> = EdgeOptions::of(RoadClass::Street).with_metres(120.0);
/// assert!(options.between.is_empty());
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EdgeOptions<P = Position> {
    /// Class of the road.
    pub class: RoadClass,
    /// Length in metres; `None` for that of the line.
    pub metres: Option<f64>,
    /// Posted speed in metres per second, if known.
    pub speed: Option<f64>,
    /// True for a part of a roundabout.
    pub roundabout: bool,
    /// Points of the line between the ends; none if it is straight.
    pub between: Vec<P>,
}

impl<P> EdgeOptions<P> {
    /// Returns a straight road of a class.
    #[must_use]
    pub fn of(class: RoadClass) -> Self {
        Self { class, metres: None, speed: None, roundabout: false, between: Vec::new() }
    }

    /// Sets the length in metres; `None` for that of the line.
    #[must_use]
    pub fn with_metres(self, metres: impl Into<Option<f64>>) -> Self {
        Self { metres: metres.into(), ..self }
    }

    /// Sets the posted speed in metres per second; `None` if it is unknown.
    #[must_use]
    pub fn with_speed(self, speed: impl Into<Option<f64>>) -> Self {
        Self { speed: speed.into(), ..self }
    }

    /// Makes the edge a part of a roundabout, or not.
    #[must_use]
    pub fn with_roundabout(self, roundabout: bool) -> Self {
        Self { roundabout, ..self }
    }

    /// Sets the points of the line between the ends.
    #[must_use]
    pub fn with_between(self, between: Vec<P>) -> Self {
        Self { between, ..self }
    }
}
