//! Lower bounds of the length of a route, from the straight distance between its ends.
//!
//! An edge may be shorter than the straight line between its ends: lengths in files are rounded,
//! and some are wrong. Whatever the share r, an edge of l metres between ends s metres apart has at
//! least r s metres, but for the max(0, r s − l) that it lacks. A shortest route passes each edge
//! at most once, so that all its edges together lack at most D(r), the sum over the network, and
//! the sum of their s is at least the distance d between its ends. So it has at least r d − D(r)
//! metres.
//!
//! The best r for a distance d is the l / s up to which the edges of the network have d straight
//! metres in all: the bound is then the length of a route that consists of the worst edges.
//! Rounding spoils many edges of centimetres, which have few metres in all, so that r is near 1
//! even for short distances. For d = 0, r is the least l / s, and D(r) is 0.

/// Straight distances in metres for which a bound is best.
const BEST_AT: [f64; 3] = [0.0, 100.0, 1000.0];

/// Bounds of the lengths of the shortest routes in a network.
#[derive(Debug, Clone, Copy)]
pub(super) struct LengthBound {
    /// Least length for each straight metre, r, and what all edges lack of it, D(r).
    lines: [[f64; 2]; BEST_AT.len()],
}

impl LengthBound {
    /// Bounds of a network, of whose edges the lengths and the straight distances are given.
    /// O(n log n) for the n edges that are shorter than straight.
    pub(super) fn new(edges: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut short: Vec<_> = edges.filter(|[metres, straight]| metres < straight).collect();
        short.sort_unstable_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        let line = |distance: f64| {
            let (mut lengths, mut straights) = (0.0, 0.0);
            for [metres, straight] in &short {
                if straights + straight > distance {
                    let share = metres / straight;
                    return [share, f64::max(share * straights - lengths, 0.0)];
                }
                lengths += metres;
                straights += straight;
            }
            [1.0, straights - lengths]
        };
        Self { lines: BEST_AT.map(line) }
    }

    /// Least length in metres of a route between places so many metres apart.
    #[inline]
    pub(super) fn at(&self, distance: f64) -> f64 {
        let bounds = self.lines.map(|[share, lacking]| share * distance - lacking);
        bounds.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_the_worst_edges() {
        let exact = LengthBound::new([[120.0, 120.0], [90.0, 70.0]].into_iter());
        assert_eq!([0.0, 1.0, 5000.0].map(|metres| exact.at(metres)), [0.0, 1.0, 5000.0]);
        // A thousand edges of 3 cm that were rounded down to 2 cm, and one of half its distance.
        let rounded = std::iter::repeat_n([0.02, 0.03], 1000);
        let edges = rounded.chain([[40.0, 80.0], [1e4, 1e4]]);
        let bound = LengthBound::new(edges);
        for (distance, expected) in [(40.0, 20.0), (95.0, 50.0), (110.0, 60.0), (5000.0, 4950.0)] {
            assert!((bound.at(distance) - expected).abs() < 1e-9, "{distance}");
        }
    }
}
