//! Networks made of parts of other networks, with their pairs of directions and forbidden turns.

use super::builder::{EdgeOptions, NetworkBuilder};
use super::road_network::{NONE, RoadNetwork};
use wayfix::map::{Coordinates, Place};

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
            // Each pair once. An edge that ends with e has, in reverse, one that starts with e's
            // reverse.
            if back != NONE && last[e] < back {
                builder.pair(last[e] as usize, back as usize);
            }
        }
        // A turn is taken at the end of one edge into the start of the next; inside a contracted
        // edge there is none left.
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
