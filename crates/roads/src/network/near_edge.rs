//! An edge near a position.

use super::road_network::RoadNetwork;
use wayfix::map::Coordinates;

/// An edge near a position, with the nearest point of its line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearEdge {
    /// Index of the edge.
    pub edge: usize,
    /// Metres from the start of the edge to the nearest point, between 0 and its length.
    pub metres_along: f64,
    /// Metres between the position and the nearest point.
    pub metres_off: f64,
    /// Metres across: distance from the position to the edge, extended straight beyond its ends.
    pub across: f64,
    /// Metres by which the position is beyond the end of the extended edge; negative before its
    /// start, 0 beside the edge.
    pub beyond: f64,
    /// The nearest point in the plane of the network; near the antimeridian, on the side of the
    /// position.
    pub(crate) point: [f64; 2],
    /// Vector from the start to the end of the straight piece that contains the point, in the
    /// plane.
    pub(crate) piece: [f64; 2],
}

impl NearEdge {
    /// Nearest point, in the coordinates of the network.
    #[must_use]
    pub fn position<P: Coordinates>(&self, _: &RoadNetwork<P>) -> P {
        P::from_plane(self.point)
    }

    /// Direction of the road at the nearest point, in radians clockwise from north, from −π to π;
    /// in a plane, from the y-axis.
    #[must_use]
    pub fn heading(&self) -> f64 {
        let [dx, dy] = self.piece;
        dx.atan2(dy)
    }

    /// Unit vector of the road at the nearest point, in the plane; zero if the piece has no length.
    pub(crate) fn direction(&self) -> [f64; 2] {
        direction(self.piece).0
    }
}

/// Unit vector of a straight piece, zero if it has no length, and its length.
pub(super) fn direction([dx, dy]: [f64; 2]) -> ([f64; 2], f64) {
    let length = dx.hypot(dy);
    (if length > 0.0 { [dx / length, dy / length] } else { [0.0; 2] }, length)
}
