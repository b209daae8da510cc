//! Merging of intersections, by clustering their nodes, nearest pairs first.

use super::cleaning::{Cleaning, CleaningStep};
use super::road_network::{Edge, RoadNetwork};
use crate::NetworkError;
use wayfix::error::OutOfRange;
use wayfix::internal::wrapped;
use wayfix::map::{Coordinates, Place};

impl<P: Coordinates> RoadNetwork<P> {
    /// Network with intersections merged within a radius: where a dual carriageway crosses another,
    /// four nodes become one, at their mean position.
    ///
    /// Nodes joined by an edge are merged, nearest pair first, if they are at most `metres` apart
    /// and all nodes merged so far stay within `metres` of their mean. So chains of short roads do
    /// not collapse into one point, and a bridge is not merged with the road below. Edges inside a
    /// merged node are dropped, except those longer than twice the radius, which become loops. The
    /// others keep their lengths, but are at least as long as the straight line between their new
    /// ends. A merged node has the id of the first of its nodes. Nodes that could be reached still
    /// can. O(edges log) if the radius holds few nodes.
    ///
    /// [Contract](Self::contracted) the network before, so that only intersections are left to
    /// merge, and after, since merging may leave nodes that roads only pass through.
    ///
    /// # Errors
    ///
    /// [`NetworkError::Parameter`] for metres that are negative, infinite or NaN.
    pub fn merged(&self, metres: f64) -> Result<(Self, CleaningStep<P>), NetworkError> {
        if !(metres >= 0.0 && metres.is_finite()) {
            return Err(OutOfRange::new("the radius of merging", metres, "metres from 0").into());
        }
        let position = |node: usize| self.nodes()[node].position;
        let apart =
            self.edges.iter().map(|edge| (position(edge.from).metres_to(position(edge.to)), edge));
        let mut near: Vec<_> = apart.filter(|pair| pair.0 <= metres).collect();
        // A stable sort: equally near pairs stay in the order of the edges.
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut clusters = Clusters::of(self.nodes().iter().map(|node| node.position));
        near.iter().for_each(|(_, edge)| clusters.join(edge.from, edge.to, metres));

        let (mut nodes, mut target) = (Vec::new(), vec![0; self.nodes().len()]);
        for (n, node) in self.nodes().iter().enumerate() {
            let members = &clusters.members[clusters.cluster[n] as usize];
            // Members ascend, so each cluster gets its node at its lowest member, and new nodes
            // keep the order of the old ones.
            if members[0] as usize == n {
                nodes.push(Place { position: clusters.mean(members), ..node.clone() });
                let index = nodes.len() as u32 - 1;
                members.iter().for_each(|&member| target[member as usize] = index);
            }
        }
        // A longer edge inside a merged node is a real loop, such as a slip road, not a part of the
        // junction.
        let outside = |e: usize| {
            let Edge { from, to, metres: length, .. } = self.edges[e];
            from == to || target[from] != target[to] || length > 2.0 * metres
        };
        let network = self.mapped(nodes, &target, outside);
        let step = CleaningStep::of(Cleaning::Merging { metres }, self, &network);
        Ok((network, step))
    }
}

/// Disjoint sets of nodes, each near its mean.
struct Clusters<P> {
    positions: Vec<P>,
    /// Number of the set of each node.
    cluster: Vec<u32>,
    /// Nodes of each set, in ascending order.
    members: Vec<Vec<u32>>,
}

impl<P: Coordinates> Clusters<P> {
    /// Returns one set per node.
    fn of(positions: impl Iterator<Item = P>) -> Self {
        let positions: Vec<P> = positions.collect();
        let cluster: Vec<u32> = (0..positions.len() as u32).collect();
        let members = cluster.iter().map(|&node| vec![node]).collect();
        Self { positions, cluster, members }
    }

    /// Unites the sets of two nodes if all members stay within some metres of the new mean.
    fn join(&mut self, a: usize, b: usize, metres: f64) {
        let [a, b] = [a, b].map(|node| self.cluster[node] as usize);
        if a == b {
            return;
        }
        let mut united = [&self.members[a][..], &self.members[b]].concat();
        united.sort_unstable();
        let mean = self.mean(&united);
        let far = |&node: &u32| self.positions[node as usize].metres_to(mean) > metres;
        if !united.iter().any(far) {
            united.iter().for_each(|&node| self.cluster[node as usize] = a as u32);
            (self.members[a], self.members[b]) = (united, Vec::new());
        }
    }

    /// Mean position of nodes; for a single node its own position, to the bit.
    fn mean(&self, nodes: &[u32]) -> P {
        let first = self.positions[nodes[0] as usize];
        let values = nodes.iter().map(|&node| self.positions[node as usize].values());
        // Differences to the first node are averaged, so the mean of equal positions is exactly
        // that position, and the mean of longitudes on both sides of the antimeridian is near it.
        let from = first.values();
        let off = |v: [f64; 2], i: usize| wrapped(v[i], from[i], P::PERIODS[i]) - from[i];
        let sum = values.fold([0.0; 2], |sum, v| [0, 1].map(|i| sum[i] + off(v, i)));
        let mean = [0, 1].map(|i| from[i] + sum[i] / nodes.len() as f64);
        P::from_values([0, 1].map(|i| wrapped(mean[i], 0.0, P::PERIODS[i])))
    }
}
