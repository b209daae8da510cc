//! Fingerprint of a network, which tells whether vehicles and drives belong to it.

use super::{MatchError, Matcher};
use crate::map::RoadNetwork;

/// Hash of the counts of a network, the ids of its nodes, and the ends and lengths of its edges.
/// O(nodes + edges). The same on all machines, since it is stored.
pub(super) fn fingerprint<P>(network: &RoadNetwork<P>) -> u64 {
    let counts = [network.nodes().len(), network.edges().len(), network.forbidden_turns().len()];
    let counts = counts.into_iter().map(|count| count as u64);
    let ids = network.nodes().iter().map(|node| node.id);
    let edges = network.edges().iter();
    let edges = edges.flat_map(|edge| [edge.from as u64, edge.to as u64, edge.metres.to_bits()]);
    counts.chain(ids).chain(edges).fold(0xcbf2_9ce4_8422_2325, |sum: u64, word| {
        // The shift brings high bits, where lengths differ, down to all others.
        let mixed = (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 32)
    })
}

impl<P> Matcher<P> {
    /// Checks the fingerprint of the network of a vehicle or drive.
    pub(super) fn check_network(&self, found: u64) -> Result<(), MatchError> {
        let expected = self.fingerprint;
        if found == expected { Ok(()) } else { Err(MatchError::Network { found, expected }) }
    }
}
