//! Positions along the line of an edge: projection onto it, and points at a distance along it.
//!
//! Lines are measured in the plane, where their length may differ from that of the edge. Both are
//! related by one factor per edge, so metres along an edge are shares of its length.

use super::index::{NearEdge, direction};
use super::road_network::RoadNetwork;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Nearest point of an edge to a position, with the metres along the edge scaled to its
    /// length. O(points of the edge).
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn project(&self, edge: usize, position: P) -> NearEdge {
        let position = position.to_plane();
        // Squared distance, length of the line up to the point, the point, and its piece.
        let mut best = (f64::INFINITY, 0.0, [0.0; 2], [0.0; 2]);
        let mut before = 0.0;
        let mut points = P::unwrap(self.shape(edge).iter().copied());
        let mut a = points.next().unwrap_or_default();
        for b in points {
            let [px, py] = P::wrapped(position, a);
            let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
            let squared = dx * dx + dy * dy;
            let share = ((px - a[0]) * dx + (py - a[1]) * dy) / squared;
            // A piece without length has no direction: its share is NaN, which fails the
            // comparison.
            let share = if share > 0.0 { share.min(1.0) } else { 0.0 };
            let at = [a[0] + share * dx, a[1] + share * dy];
            let off = (px - at[0]).powi(2) + (py - at[1]).powi(2);
            let length = squared.sqrt();
            // Strictly nearer, so the first of equally near pieces stays.
            if off < best.0 {
                best = (off, before + share * length, at, [dx, dy]);
            }
            before += length;
            a = b;
        }
        let (off, along, point, piece) = best;
        let scale = P::scale(point);
        let metres = self.edges()[edge].metres;
        // `before` is now the length of the whole line. Rounding can make `along` slightly exceed
        // it.
        let share = if before > 0.0 { (along / before).min(1.0) } else { 0.0 };
        let metres_off = off.sqrt() * scale;
        // At a bend inside the edge, the position counts as beside the edge: only past its two ends
        // can it be beyond it.
        let is_end = share <= 0.0 || share >= 1.0;
        let (direction, _) = direction(piece);
        let [px, py] = P::wrapped(position, point);
        let straight = (px - point[0]) * direction[0] + (py - point[1]) * direction[1];
        let beyond = if is_end { straight * scale } else { 0.0 };
        // The offset has a part along the last piece and one across: Pythagoras.
        let across = (metres_off * metres_off - beyond * beyond).max(0.0).sqrt();
        let metres_along = share * metres;
        NearEdge { edge, metres_along, metres_off, across, beyond, point, piece }
    }

    /// Position `metres` along an edge, clamped to its length. O(points of the edge).
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn position_along(&self, edge: usize, metres: f64) -> P {
        let share = (metres / self.edges()[edge].metres).clamp(0.0, 1.0);
        let length = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
        let between = |a: [f64; 2], b: [f64; 2], share: f64| {
            P::from_plane([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])])
        };
        let end = || self.nodes()[self.edges()[edge].to].position;
        // Most lines have two points, which need no allocation.
        if let [a, b] = self.shape(edge) {
            let a = a.to_plane();
            let b = P::wrapped(b.to_plane(), a);
            let total = length(a, b);
            let left = share * total;
            // False for NaN.
            let is_on = total > 0.0 && left <= total;
            return if is_on { between(a, b, left / total) } else { end() };
        }
        let points: Vec<[f64; 2]> = P::unwrap(self.shape(edge).iter().copied()).collect();
        let total: f64 = points.windows(2).map(|pair| length(pair[0], pair[1])).sum();
        let mut left = share * total;
        for pair in points.windows(2) {
            let piece = length(pair[0], pair[1]);
            if left <= piece && piece > 0.0 {
                return between(pair[0], pair[1], left / piece);
            }
            // NaN is never on a piece either, and ends up at the end.
            left -= piece;
        }
        end()
    }

    /// Part of the line of an edge between two distances along it in metres, including both ends;
    /// `to` is at least `from`. O(points of the edge).
    ///
    /// # Panics
    ///
    /// If the edge does not exist.
    #[must_use]
    pub fn line_between(&self, edge: usize, from: f64, to: f64) -> Vec<P> {
        let points = self.shape(edge);
        let length = |pair: &[P]| {
            let a = pair[0].to_plane();
            let b = P::wrapped(pair[1].to_plane(), a);
            (b[0] - a[0]).hypot(b[1] - a[1])
        };
        let total: f64 = points.windows(2).map(length).sum();
        // Metres of the edge per unit of the plane along its line.
        let scale = if total > 0.0 { self.edges()[edge].metres / total } else { 0.0 };
        let mut line = vec![self.position_along(edge, from)];
        let mut along = 0.0;
        // Inner points only: the ends of the part are added as positions along the edge.
        for pair in points.windows(2).take(points.len().saturating_sub(2)) {
            along += length(pair) * scale;
            if from < along && along < to {
                line.push(pair[1]);
            }
        }
        line.push(self.position_along(edge, to));
        line
    }
}
