//! Edges near a position, by a tree of bounding boxes of the straight pieces of their lines.
//!
//! The boxes are in the plane of `to_plane`, whose scale depends on the latitude: a query uses the
//! scale at the position, and each hit is measured again with the scale at its own nearest point.

use static_aabb2d_index::{Control, StaticAABB2DIndex, StaticAABB2DIndexBuilder};

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

/// Spatial index of the edges of a network, which finds those near a position without visiting the
/// others; edges across the antimeridian are found from both sides. Building takes O(points log)
/// time and 130 bytes per piece of a line.
///
/// ```
/// use wayfix_roads::{EdgeIndex, NetworkBuilder};
/// use wayfix::map::{Position, RoadClass};
///
/// let mut builder = NetworkBuilder::new();
/// for (id, longitude) in [(1, 149.12), (2, 149.13), (3, 149.14)] {
///     builder.node(id, Position { latitude: -35.28, longitude })?;
/// }
/// builder.one_way(1, 2, RoadClass::Main)?;
/// builder.both_ways(2, 3, RoadClass::Street)?;
/// let network = builder.build()?;
/// let index = EdgeIndex::new(&network);
///
/// // 22 m north of the street.
/// let here = Position { latitude: -35.2798, longitude: 149.132 };
/// let road = index.nearest(&network, here).expect("a road");
/// assert_eq!((road.edge, road.metres_off.round()), (1, 22.0));
/// assert!((road.position(&network).longitude - 149.132).abs() < 1e-9);
///
/// // All within 50 m: both directions.
/// let mut near = vec![];
/// index.near(&network, here, 50.0, &mut near);
/// assert_eq!([near[0].edge, near[1].edge], [1, 2]);
/// # Ok::<(), wayfix_roads::NetworkError>(())
/// ```
#[derive(Debug, Clone)]
pub struct EdgeIndex {
    tree: StaticAABB2DIndex<f64>,
    pieces: Vec<Piece>,
    /// True for edges without pieces: their line is that of their reverse, backwards.
    is_mirrored: Vec<bool>,
}

/// Piece of the line of an edge, in the plane.
#[derive(Debug, Clone, Copy)]
struct Piece {
    edge: u32,
    a: [f64; 2],
    b: [f64; 2],
    /// Metres along the edge at both ends.
    along: [f64; 2],
    /// True for the first and for the last piece of the edge.
    ends: [bool; 2],
}

impl EdgeIndex {
    /// Builds the index of a network.
    ///
    /// # Panics
    ///
    /// Never: each piece of a line has one box.
    #[must_use]
    pub fn new<P: Coordinates>(network: &RoadNetwork<P>) -> Self {
        let mut pieces = Vec::new();
        // Usually a reverse edge has the same line and is found together with the first, at half
        // the memory and time. Two carriageways between the same nodes differ.
        let mirrored = |edge: usize| {
            let reverse = network.reverse(edge).filter(|reverse| *reverse < edge);
            reverse.is_some_and(|other| {
                network.shape(edge).iter().eq(network.shape(other).iter().rev())
            })
        };
        let is_mirrored: Vec<bool> = (0..network.edges().len()).map(mirrored).collect();
        for (edge, road) in network.edges().iter().enumerate() {
            if is_mirrored[edge] {
                continue;
            }
            let points: Vec<_> = P::unwrap(network.shape(edge).iter().copied()).collect();
            let total: f64 = points.windows(2).map(length).sum();
            let (mut before, last) = (0.0, points.len().saturating_sub(2));
            for (number, pair) in points.windows(2).enumerate() {
                // The share is computed first: a line may be tiny while its road has any length,
                // and dividing the length of the road by that of the line could overflow.
                let share = if total > 0.0 { length(pair) / total } else { 0.0 };
                let after = (before + share * road.metres).min(road.metres);
                let along = [before, after];
                let ends = [number == 0, number == last];
                pieces.push(Piece { edge: edge as u32, a: pair[0], b: pair[1], along, ends });
                before = after;
            }
        }
        let mut builder = StaticAABB2DIndexBuilder::new(pieces.len());
        for Piece { a, b, .. } in &pieces {
            builder.add(a[0].min(b[0]), a[1].min(b[1]), a[0].max(b[0]), a[1].max(b[1]));
        }
        let tree = builder.build().expect("one box was added per piece, with ordered corners");
        Self { tree, pieces, is_mirrored }
    }

    /// Finds the edge nearest to a position, however far, and its nearest point. Ties, such as both
    /// directions of a road, go to the lowest edge. `None` without edges, and for a position that
    /// is not finite. Usually O(log + pieces nearer than the edge).
    ///
    /// Distances on Earth are compared in Mercator's projection: hundreds of kilometres off,
    /// another edge may be somewhat nearer.
    #[must_use]
    pub fn nearest<P: Coordinates>(&self, _: &RoadNetwork<P>, position: P) -> Option<NearEdge> {
        let [x, y] = position.to_plane();
        if !(x.is_finite() && y.is_finite()) {
            return None;
        }
        let mut best: Option<(f64, usize, f64)> = None;
        for turn in turns::<P>() {
            let point = [x + turn, y];
            let mut visit = |number: usize, box_squared: f64| {
                // Boxes come in the order of their distance, a lower bound for the pieces in them.
                // So no later box holds a nearer piece; one at an equal distance may still win a
                // tie.
                if best.is_some_and(|(least, ..)| box_squared > least * least) {
                    return Control::Break(());
                }
                let off = self.pieces[number].nearest(point, 1.0).metres_off;
                let edge = |number: usize| self.pieces[number].edge;
                if best.is_none_or(|(least, of, _)| (off, edge(number)) < (least, edge(of))) {
                    best = Some((off, number, turn));
                }
                Control::Continue
            };
            let _ = self.tree.visit_neighbors(point[0], y, &mut visit);
        }
        let (_, number, turn) = best?;
        // Measured again in metres, by the scale at the point that was found.
        let (piece, point) = (&self.pieces[number], [x + turn, y]);
        let near = piece.nearest(point, 1.0);
        Some(piece.nearest(point, P::scale(near.point)).turned_back(turn))
    }

    /// Finds the edges within some metres of a position, in ascending order and in both directions
    /// of a road. O(log + pieces found).
    pub fn near<P: Coordinates>(
        &self,
        network: &RoadNetwork<P>,
        position: P,
        metres: f64,
        out: &mut Vec<NearEdge>,
    ) {
        out.clear();
        let point = position.to_plane();
        let scale = P::scale(point);
        let reach = metres / scale;
        for turn in turns::<P>() {
            let [x, y] = [point[0] + turn, point[1]];
            let mut visit = |number: usize| {
                let near = self.pieces[number].nearest([x, y], scale);
                // The scale at the position is wrong for places far from it, as near a pole, so the
                // distance is measured again with the scale there.
                if near.metres_off <= metres {
                    let near = self.pieces[number].nearest([x, y], P::scale(near.point));
                    if near.metres_off <= metres {
                        out.push(near.turned_back(turn));
                    }
                }
            };
            self.tree.visit_query(x - reach, y - reach, x + reach, y + reach, &mut visit);
        }
        out.sort_unstable_by(|a, b| {
            (a.edge.cmp(&b.edge))
                .then(a.metres_off.total_cmp(&b.metres_off))
                .then(a.metres_along.total_cmp(&b.metres_along))
        });
        // An edge is found once for each of its pieces in reach: the nearest point stays.
        out.dedup_by_key(|near| near.edge);
        // The range is fixed before the first push, so only edges with pieces are mirrored.
        for number in 0..out.len() {
            let near = out[number];
            let reverse = network.reverse(near.edge).filter(|reverse| self.is_mirrored[*reverse]);
            if let Some(reverse) = reverse {
                let lengths = [near.edge, reverse].map(|edge| network.edges()[edge].metres);
                out.push(near.reversed(reverse, lengths));
            }
        }
        out.sort_unstable_by_key(|near| near.edge);
    }
}

/// Shifts along x under which a point of the plane stays at the same place on Earth: lines across
/// the antimeridian continue beyond it, where a position on its other side must be looked for.
fn turns<P: Coordinates>() -> impl Iterator<Item = f64> {
    [0.0, P::X_PERIOD, -P::X_PERIOD].into_iter().filter(|turn| turn.is_finite())
}

fn length(pair: &[[f64; 2]]) -> f64 {
    (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])
}

impl Piece {
    /// Point of the piece that is nearest to a point of the plane.
    fn nearest(&self, [x, y]: [f64; 2], scale: f64) -> NearEdge {
        let Self { a, b, along, ends, .. } = *self;
        let piece = [b[0] - a[0], b[1] - a[1]];
        let (direction, length) = direction(piece);
        // Dot product with the unit vector of the piece, 0 for one without a length.
        let straight = (x - a[0]) * direction[0] + (y - a[1]) * direction[1];
        let inside = straight.clamp(0.0, length);
        let share = if length > 0.0 { inside / length } else { 0.0 };
        let point = [a[0] + inside * direction[0], a[1] + inside * direction[1]];
        let off = (x - point[0]).hypot(y - point[1]) * scale;
        let before_start = straight < 0.0 && ends[0];
        let after_end = straight > length && ends[1];
        // At a bend inside the edge, the position counts as beside the edge: only past its two ends
        // can it be beyond it.
        let beyond = if before_start || after_end { (straight - inside) * scale } else { 0.0 };
        let across = (off * off - beyond * beyond).max(0.0).sqrt();
        NearEdge {
            edge: self.edge as usize,
            metres_along: along[0] + share * (along[1] - along[0]),
            metres_off: off,
            across,
            beyond,
            point,
            piece,
        }
    }
}

impl NearEdge {
    /// Returns the point shifted back by the turn of its query.
    fn turned_back(self, turn: f64) -> Self {
        Self { point: [self.point[0] - turn, self.point[1]], ..self }
    }

    /// Returns the same point on the reverse edge, given the lengths of both edges.
    fn reversed(self, edge: usize, [metres, reverse]: [f64; 2]) -> Self {
        let metres_along = ((1.0 - self.metres_along / metres) * reverse).max(0.0);
        let piece = self.piece.map(|x| -x);
        Self { edge, metres_along, beyond: -self.beyond, piece, ..self }
    }
}
