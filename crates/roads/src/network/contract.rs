//! Contraction of nodes that roads only pass through.
//!
//! Every edge lies on exactly one chain of edges that runs from a kept node through passed ones to
//! a kept node; each chain becomes one edge. A ring of passed nodes alone has no kept node, so it
//! keeps its first.

use super::builder::NetworkBuilder;
use super::cleaning::{Cleaning, CleaningStep};
use super::road_network::{Edge, NONE, RoadNetwork};
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Network without the nodes that roads only pass through. Lines are kept, lengths added up.
    ///
    /// A node is passed through if it has two neighbours, joined through it by a one-way road or by
    /// one in [both directions](Self::reverse), if class, speed and roundabout do not change there,
    /// and if the turn is not forbidden. Dead ends stay. A ring that touches other roads at one
    /// node becomes a loop there; a ring that touches none keeps one node. The lengths of shortest
    /// paths between the remaining nodes do not change. O((nodes + edges) log).
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
    /// let (network, _) = builder.build()?.contracted();
    ///
    /// assert_eq!(network.nodes().len(), 2);
    /// assert_eq!(network.edges()[0].metres, 200.0);
    /// assert_eq!(network.shape(0)[1], PlanePosition { x: 100.0, y: 0.0 });
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    #[must_use]
    pub fn contracted(&self) -> (Self, CleaningStep<P>) {
        let mut passed = self.passed_through();
        let mut seen = vec![false; self.nodes().len()];
        // Nodes that no chain from a kept node visits lie on rings of passed nodes only. Each such
        // ring keeps its first node.
        for start in (0..self.nodes().len()).filter(|&n| !passed[n]).collect::<Vec<_>>() {
            self.edges_from(start)
                .for_each(|e| self.follow(e, &passed, |_, node| seen[node] = true));
        }
        for n in 0..self.nodes().len() {
            if passed[n] && !seen[n] {
                passed[n] = false;
                self.edges_from(n)
                    .for_each(|e| self.follow(e, &passed, |_, node| seen[node] = true));
            }
        }
        let (nodes, target) = self.selected(|n| !passed[n]);
        let mut builder = NetworkBuilder::of_checked(nodes);
        let mut first = vec![NONE; self.edges.len()];
        let mut last = first.clone();
        for (e, &Edge { from, .. }) in self.edges.iter().enumerate() {
            if passed[from] {
                continue;
            }
            let (mut metres, mut between, mut end) = (0.0, Vec::new(), e);
            self.follow(e, &passed, |edge, node| {
                metres += self.edges[edge].metres;
                between.extend_from_slice(self.between(edge));
                if passed[node] {
                    between.push(self.nodes()[node].position);
                }
                end = edge;
            });
            let ends = [from, self.edges[end].to].map(|node| target[node] as usize);
            let number = builder.checked_edge(ends, metres, self.options(e, between)) as u32;
            // Forbidden turns and pairs refer to the first and last old edge of the chain.
            (first[e], last[end]) = (number, number);
        }
        let network = self.carry_over(builder, &first, &last);
        let step = CleaningStep::of(Cleaning::Contraction, self, &network);
        (network, step)
    }

    /// Visits an edge and those that continue it through passed nodes, each with its end node.
    fn follow(&self, edge: usize, passed: &[bool], mut visit: impl FnMut(usize, usize)) {
        let mut edge = edge;
        loop {
            let Edge { from, to, .. } = self.edges[edge];
            visit(edge, to);
            // A passed node has two neighbours, so exactly one edge does not lead back to where
            // this one came from.
            let mut onward = self.edges_from(to).filter(|&next| self.edges[next].to != from);
            match onward.next() {
                Some(next) if passed[to] => edge = next,
                _ => return,
            }
        }
    }

    /// True for each node that roads only pass through.
    fn passed_through(&self) -> Vec<bool> {
        // The first two edges into each node; a node with more is not passed through.
        let mut into = vec![[NONE; 2]; self.nodes().len()];
        let mut degree = vec![0_usize; self.nodes().len()];
        for (e, edge) in self.edges.iter().enumerate() {
            if let Some(place) = into[edge.to].get_mut(degree[edge.to]) {
                *place = e as u32;
            }
            degree[edge.to] += 1;
        }
        let same_road = |edge: usize, next: usize| {
            let [a, b] = [edge, next].map(|e| &self.edges[e]);
            (a.class, a.speed, a.roundabout) == (b.class, b.speed, b.roundabout)
                && self.may_turn(edge, next)
        };
        let through = |n: usize| {
            let out = self.edges_from(n);
            let into: Vec<usize> =
                into[n][..degree[n].min(2)].iter().map(|&e| e as usize).collect();
            // One edge in and one out (a one-way road), or two of each (a two-way road).
            if degree[n] != out.len() || !matches!(degree[n], 1 | 2) {
                return false;
            }
            let mut neighbors: Vec<usize> = into.iter().map(|&e| self.edges[e].from).collect();
            neighbors.extend(out.clone().map(|e| self.edges[e].to));
            neighbors.sort_unstable();
            neighbors.dedup();
            // Two edges into the node must come from different neighbours, and the edges out must
            // be their reverses.
            let is_two_way_through = into.len() == 1
                || (self.edges[into[0]].from != self.edges[into[1]].from
                    && into
                        .iter()
                        .all(|&edge| self.reverse(edge).is_some_and(|back| out.contains(&back))));
            neighbors.len() == 2
                && is_two_way_through
                && !neighbors.contains(&n)
                && into.iter().all(|&edge| {
                    let from = self.edges[edge].from;
                    let mut onward = out.clone().filter(|&next| self.edges[next].to != from);
                    onward.next().is_some_and(|next| same_road(edge, next))
                })
        };
        (0..self.nodes().len()).map(through).collect()
    }
}
