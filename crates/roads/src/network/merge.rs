//! Merging of intersections.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::{Edge, RoadNetwork};
use wayfix::error::Parameter;
use wayfix::internal::turned;
use wayfix::map::{Coordinates, MapError, Place};

impl<P: Coordinates> RoadNetwork<P> {
    /// The same roads with intersections merged within a radius: where two carriageways cross a
    /// street, four nodes become one, at their mean position.
    ///
    /// Nodes that an edge joins are merged, the nearest first, if they are at most `metres` apart
    /// and if all merged ones stay within `metres` of their mean: chains of short roads are not
    /// drawn into one point, and a bridge is not merged with the road below. Edges inside are
    /// dropped, except those longer than twice the radius, which become loops. The others keep
    /// their lengths, but are at least as long as the straight line between their new ends. The
    /// merged node has the id of the first of its nodes. Nodes that could be reached
    /// stay so. O(edges log) if the radius holds few nodes.
    ///
    /// [Contract](Self::contracted) before: it leaves intersections where there were points of
    /// lines. And after: where roads that met are merged, nodes may be left that one passes
    /// through.
    ///
    /// # Errors
    ///
    /// [`MapError::Parameter`] for metres that are negative, infinite or NaN.
    pub fn merged(&self, metres: f64) -> Result<(Self, CleaningStep<P>), MapError> {
        if !(metres >= 0.0 && metres.is_finite()) {
            return Err(Parameter::new("the radius of merging", metres, "metres from 0").into());
        }
        let position = |node: usize| self.nodes()[node].position;
        let apart =
            self.edges.iter().map(|edge| (position(edge.from).metres_to(position(edge.to)), edge));
        let mut near: Vec<_> = apart.filter(|pair| pair.0 <= metres).collect();
        // Stable: equally near ones in the order of edges.
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut clusters = Clusters::of(self.nodes().iter().map(|node| node.position));
        near.iter().for_each(|(_, edge)| clusters.join(edge.from, edge.to, metres));

        let (mut nodes, mut target) = (Vec::new(), vec![0; self.nodes().len()]);
        for (n, node) in self.nodes().iter().enumerate() {
            let members = &clusters.members[clusters.cluster[n] as usize];
            if members[0] as usize == n {
                nodes.push(Place { position: clusters.mean(members), ..node.clone() });
                let index = nodes.len() as u32 - 1;
                members.iter().for_each(|&member| target[member as usize] = index);
            }
        }
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
    /// Returns a set of each node.
    fn of(positions: impl Iterator<Item = P>) -> Self {
        let positions: Vec<P> = positions.collect();
        let cluster: Vec<u32> = (0..positions.len() as u32).collect();
        let members = cluster.iter().map(|&node| vec![node]).collect();
        Self { positions, cluster, members }
    }

    /// Unites the sets of two nodes if all stay within so many metres of the mean.
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

    /// Mean position of nodes; that of one node alone is its own, to the last digit.
    fn mean(&self, nodes: &[u32]) -> P {
        let first = self.positions[nodes[0] as usize];
        let values = nodes.iter().map(|&node| self.positions[node as usize].values());
        // Sums of differences: equal positions have themselves as their mean.
        let from = first.values();
        let off = |v: [f64; 2], i: usize| turned(v[i], from[i], P::PERIODS[i]) - from[i];
        let sum = values.fold([0.0; 2], |sum, v| [0, 1].map(|i| sum[i] + off(v, i)));
        let mean = [0, 1].map(|i| from[i] + sum[i] / nodes.len() as f64);
        P::from_values([0, 1].map(|i| turned(mean[i], 0.0, P::PERIODS[i])))
    }
}
