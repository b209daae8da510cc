//! Cleaning of a network: cut to a box, largest strongly connected part, dead ends dropped (the
//! 2-core of the undirected network), each with a report, and sequences of them.
//!
//! Every operation maps old nodes to new ones and rebuilds the network from the edges that are
//! left, with their pairs of directions and forbidden turns. [Contraction](super::contract) and
//! [merging](super::merge) have files of their own.

use std::fmt;

use super::builder::{EdgeOptions, NetworkBuilder};
use super::road_network::{NONE, RoadNetwork};
use crate::NetworkError;
use wayfix::internal::{Number, components};
use wayfix::map::{Coordinates, Place, Position};

/// One way to clean a network.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Cleaning<P = Position> {
    /// [Cut to the box](RoadNetwork::within) between two opposite corners.
    Within([P; 2]),
    /// Only the [largest part](RoadNetwork::largest_component) whose nodes can all reach one
    /// another is kept.
    LargestComponent,
    /// [Dead ends](RoadNetwork::without_dead_ends) are dropped.
    DeadEnds,
    /// Nodes that roads only pass through are [contracted](RoadNetwork::contracted).
    Contraction,
    /// Intersections are [merged](RoadNetwork::merged).
    Merging {
        /// Radius.
        metres: f64,
    },
}

/// Counts of a network before and after a step of cleaning.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CleaningStep<P = Position> {
    /// Operation of the step.
    pub operation: Cleaning<P>,
    /// Numbers of nodes before and after.
    pub nodes: [usize; 2],
    /// Numbers of edges before and after.
    pub edges: [usize; 2],
    /// Numbers of forbidden turns before and after. A turn is lost with one of its edges, or with a
    /// contracted node where only going back was forbidden.
    pub forbidden_turns: [usize; 2],
}

impl<P> CleaningStep<P> {
    pub(super) fn of(
        operation: Cleaning<P>,
        before: &RoadNetwork<P>,
        after: &RoadNetwork<P>,
    ) -> Self {
        let both = [before, after];
        Self {
            operation,
            nodes: both.map(|network| network.nodes().len()),
            edges: both.map(|network| network.edges().len()),
            forbidden_turns: both.map(|network| network.forbidden_turns().len()),
        }
    }
}

/// Prints the operation and the counts in one line, forbidden turns only if there were any.
impl<P> fmt::Display for CleaningStep<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.operation {
            Cleaning::Within(_) => write!(f, "cut to a box")?,
            Cleaning::LargestComponent => write!(f, "largest part")?,
            Cleaning::DeadEnds => write!(f, "dead ends dropped")?,
            Cleaning::Contraction => write!(f, "contracted")?,
            Cleaning::Merging { metres } => write!(f, "merged within {metres} m")?,
        }
        let Self { nodes, edges, forbidden_turns: turns, .. } = self;
        write!(f, ": {} → {} nodes, {} → {} edges", nodes[0], nodes[1], edges[0], edges[1])?;
        if turns[0] > 0 {
            write!(f, ", {} → {} forbidden turns", turns[0], turns[1])?;
        }
        Ok(())
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Cleans a network by a sequence of operations. Returns the counts of each.
    ///
    /// A good order is: cut to a box, keep the largest part, drop dead ends, contract, merge, and
    /// contract again, since merging may leave nodes that roads only pass through.
    ///
    /// ```
    /// use wayfix_roads::{Cleaning, NetworkBuilder};
    /// use wayfix::map::{PlanePosition, RoadClass};
    ///
    /// // Two carriageways of a road, 20 m apart, cross a street.
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 200.0, 0.0), (3, 200.0, 20.0), (4, 0.0, 20.0), (5, 200.0, 300.0)] {
    ///     builder.node(id, PlanePosition { x, y })?;
    /// }
    /// builder.one_way(1, 2, RoadClass::Main)?;
    /// builder.one_way(3, 4, RoadClass::Main)?;
    /// builder.both_ways(1, 4, RoadClass::Main)?;
    /// builder.both_ways(2, 3, RoadClass::Street)?;
    /// builder.both_ways(3, 5, RoadClass::Street)?;
    ///
    /// let (network, steps) = builder.build()?.cleaned(&[Cleaning::Merging { metres: 30.0 }])?;
    /// assert_eq!(network.nodes().len(), 3);
    /// assert_eq!(steps[0].to_string(), "merged within 30 m: 5 → 3 nodes, 8 → 4 edges");
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`NetworkError::EmptyBox`] and [`NetworkError::Parameter`], as [`within`](Self::within) and
    /// [`merged`](Self::merged).
    pub fn cleaned(
        self,
        operations: &[Cleaning<P>],
    ) -> Result<(Self, Vec<CleaningStep<P>>), NetworkError> {
        let (mut network, mut steps) = (self, Vec::new());
        for operation in operations {
            let (cleaned, step) = match *operation {
                Cleaning::Within(corners) => network.within(corners)?,
                Cleaning::LargestComponent => network.largest_component(),
                Cleaning::DeadEnds => network.without_dead_ends(),
                Cleaning::Contraction => network.contracted(),
                Cleaning::Merging { metres } => network.merged(metres)?,
            };
            network = cleaned;
            steps.push(step);
        }
        Ok((network, steps))
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Nodes in the box between two opposite corners, borders included, and the edges between them
    /// with their forbidden turns. A box cannot cross the antimeridian. O(nodes + edges).
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{PlanePosition, RoadClass};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x) in [(1, 0.0), (2, 100.0), (3, 200.0)] {
    ///     builder.node(id, PlanePosition { x, y: 0.0 })?;
    /// }
    /// builder.both_ways(1, 2, RoadClass::Street)?;
    /// builder.both_ways(2, 3, RoadClass::Street)?;
    /// let network = builder.build()?;
    ///
    /// let corners = [PlanePosition { x: 150.0, y: 10.0 }, PlanePosition { x: -10.0, y: -10.0 }];
    /// let (west, step) = network.within(corners)?;
    /// assert_eq!(west.nodes().len(), 2);
    /// assert_eq!(step.to_string(), "cut to a box: 3 → 2 nodes, 4 → 2 edges");
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`NetworkError::EmptyBox`] if no node lies in the box.
    pub fn within(&self, corners: [P; 2]) -> Result<(Self, CleaningStep<P>), NetworkError> {
        let [a, b] = corners.map(P::values);
        let (low, high) = ([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]);
        // `min` and `max` skip NaN, but a box with NaN must be empty.
        let numbers = a.iter().chain(&b).all(|value| !value.is_nan());
        let inside = |n: usize| {
            let values = self.nodes()[n].position.values();
            numbers && (0..2).all(|i| (low[i]..=high[i]).contains(&values[i]))
        };
        let (nodes, target) = self.selected(inside);
        if nodes.is_empty() {
            // The error tells where the nodes are: swapped axes or another projection show at once.
            let mut extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
            for values in self.nodes().iter().map(|node| node.position.values()) {
                for i in 0..2 {
                    extent[0][i] = extent[0][i].min(values[i]);
                    extent[1][i] = extent[1][i].max(values[i]);
                }
            }
            let (asked, extent) = (in_words::<P>([a, b]), in_words::<P>(extent));
            return Err(NetworkError::EmptyBox { asked, extent });
        }
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::Within(corners), self, &network);
        Ok((network, step))
    }
}

/// Ranges of both axes.
fn in_words<P: Coordinates>([a, b]: [[f64; 2]; 2]) -> String {
    let [(first, _), (second, _)] = P::AXES;
    let ([a, c], [b, d]) = (a.map(Number), b.map(Number));
    format!("{first} {a} to {b} and {second} {c} to {d}")
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Largest part whose nodes can all reach one another, with its edges and their forbidden
    /// turns; among equally large ones, the one with the lowest node.
    ///
    /// Forbidden turns don't count here; because of them, some nodes may still be out of reach.
    /// O(nodes + edges), by Tarjan (1972), without recursion.
    #[must_use]
    pub fn largest_component(&self) -> (Self, CleaningStep<P>) {
        let component =
            components(self.nodes().len(), |n| self.edges_from(n).map(|e| self.edges[e].to));
        let mut sizes = vec![0_usize; self.nodes().len()];
        component.iter().for_each(|&c| sizes[c as usize] += 1);
        let mut largest = component[0];
        // Strictly larger, in the order of the nodes: a tie goes to the part met first.
        for &c in &component {
            if sizes[c as usize] > sizes[largest as usize] {
                largest = c;
            }
        }
        let (nodes, target) = self.selected(|n| component[n] == largest);
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::LargestComponent, self, &network);
        (network, step)
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Network without dead ends: nodes with at most one neighbour are dropped, then those that are
    /// left with at most one, and so on. If the network has no ring of three or more nodes, its
    /// first node stays. O(nodes + edges).
    #[must_use]
    pub fn without_dead_ends(&self) -> (Self, CleaningStep<P>) {
        let mut neighbors = vec![Vec::new(); self.nodes().len()];
        for edge in self.edges.iter().filter(|edge| edge.from != edge.to) {
            neighbors[edge.from].push(edge.to);
            neighbors[edge.to].push(edge.from);
        }
        for list in &mut neighbors {
            list.sort_unstable();
            // Neighbours count, not edges: a two-way road or two carriageways to one node are still
            // a dead end.
            list.dedup();
        }
        let mut degree: Vec<usize> = neighbors.iter().map(Vec::len).collect();
        let mut kept = vec![true; self.nodes().len()];
        let mut ends: Vec<usize> = (0..self.nodes().len()).filter(|&n| degree[n] <= 1).collect();
        while let Some(n) = ends.pop() {
            // A node whose degree falls from 1 to 0 comes up twice.
            if !std::mem::take(&mut kept[n]) {
                continue;
            }
            for &other in neighbors[n].iter().filter(|&&other| kept[other]) {
                degree[other] -= 1;
                if degree[other] <= 1 {
                    ends.push(other);
                }
            }
        }
        // A network needs a node.
        let none = !kept.contains(&true);
        let (nodes, target) = self.selected(|n| kept[n] || (none && n == 0));
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::DeadEnds, self, &network);
        (network, step)
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Network of new nodes, with the wanted edges whose ends both have a new node.
    ///
    /// `target` gives the new node of each old one, or `NONE`. Edges keep their lengths, or get the
    /// straight distance between their new ends if that is longer.
    pub(super) fn mapped(
        &self,
        nodes: Vec<Place<P>>,
        target: &[u32],
        wanted: impl Fn(usize) -> bool,
    ) -> Self {
        let mut builder = NetworkBuilder::of_checked(nodes);
        let mut number = vec![NONE; self.edges.len()];
        for (e, edge) in self.edges.iter().enumerate() {
            let ends = [edge.from, edge.to].map(|node| target[node]);
            if ends.contains(&NONE) || !wanted(e) {
                continue;
            }
            let ends = ends.map(|end| end as usize);
            let [start, end] = ends.map(|end| builder.position(end));
            // An edge between unmoved ends keeps its length even if that is below the straight
            // distance, as in files with rounded lengths.
            let moved = [start, end] != [edge.from, edge.to].map(|n| self.nodes()[n].position);
            let straight = if moved { start.metres_to(end) } else { 0.0 };
            let options = self.options(e, self.between(e).to_vec());
            number[e] = builder.checked_edge(ends, edge.metres.max(straight), options) as u32;
        }
        self.carry_over(builder, &number, &number)
    }

    /// Wanted nodes, and for each old node its index among them, or `NONE`.
    pub(super) fn selected(&self, wanted: impl Fn(usize) -> bool) -> (Vec<Place<P>>, Vec<u32>) {
        let (mut nodes, mut target) = (Vec::new(), vec![NONE; self.nodes().len()]);
        for (n, node) in self.nodes().iter().enumerate().filter(|&(n, _)| wanted(n)) {
            target[n] = nodes.len() as u32;
            nodes.push(node.clone());
        }
        (nodes, target)
    }

    /// Finishes a network, carrying over the pairs of directions and forbidden turns of this one.
    ///
    /// `first` gives the number of the new edge that starts with an old one, `last` that of the new
    /// edge that ends with it, or `NONE`.
    pub(super) fn carry_over(
        &self,
        mut builder: NetworkBuilder<P>,
        first: &[u32],
        last: &[u32],
    ) -> Self {
        for e in (0..self.edges.len()).filter(|&e| last[e] != NONE) {
            let back = self.reverse(e).map_or(NONE, |back| first[back]);
            // Each pair once. The reverse of the new edge that ends with e starts with the reverse
            // of e.
            if back != NONE && last[e] < back {
                builder.pair(last[e] as usize, back as usize);
            }
        }
        // A turn leads from the end of one edge to the start of the next; inside a contracted edge
        // there are no turns left.
        for (edge, next) in self.forbidden_turns() {
            let pair = (last[edge], first[next]);
            if pair.0 != NONE && pair.1 != NONE {
                builder.forbid(pair.0 as usize, pair.1 as usize);
            }
        }
        builder.finish()
    }

    /// Options of an edge, without its length, on a new line.
    pub(super) fn options(&self, edge: usize, between: Vec<P>) -> EdgeOptions<P> {
        let edge = &self.edges[edge];
        let (class, speed, roundabout) = (edge.class, edge.speed, edge.roundabout);
        EdgeOptions { class, metres: None, speed, roundabout, between }
    }

    /// Inner points of the line of an edge.
    pub(super) fn between(&self, edge: usize) -> &[P] {
        let shape = self.shape(edge);
        &shape[1..shape.len() - 1]
    }
}
