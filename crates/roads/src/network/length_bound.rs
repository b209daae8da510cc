//! Lower bounds on the length of a route, from the straight distance between its ends.
//!
//! An edge may be shorter than the straight line between its ends: lengths in files are rounded,
//! and some are wrong. For any share r, call max(0, r s − l) the deficit of an edge of l metres
//! between ends s metres apart: the edge has at least r s metres less its deficit. A shortest route
//! uses each edge at most once, so the deficits of its edges sum to at most D(r), that of the whole
//! network; and the sum of their s is at least the distance d between its ends. So it has at least
//! r d − D(r) metres.
//!
//! The best r for a distance d is the largest l / s among the worst edges that add up to d straight
//! metres: the bound is then the length of a route made of the worst edges. Rounding affects mostly
//! edges of centimetres, which have few metres in all, so r is near 1 even for short distances. For
//! d = 0, r is the least l / s, and D(r) is 0.

/// Straight distances in metres for which the bound is tightest.
const BEST_AT: [f64; 3] = [0.0, 100.0, 1000.0];

/// Lower bounds on the lengths of the shortest routes in a network.
#[derive(Debug, Clone, Copy)]
pub(super) struct LengthBound {
    /// Least length per straight metre, r, and the deficit of all edges, D(r).
    lines: [[f64; 2]; BEST_AT.len()],
}

impl LengthBound {
    /// Bounds of a network, given the length and straight distance of each edge. O(n log n) for the
    /// n edges that are shorter than straight.
    pub(super) fn new(edges: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut short: Vec<_> = edges.filter(|[metres, straight]| metres < straight).collect();
        short.sort_unstable_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        let line = |distance: f64| {
            let (mut lengths, mut straights) = (0.0, 0.0);
            for [metres, straight] in &short {
                // With r the share of this edge, exactly the worse edges before it have a deficit:
                // r Σ s − Σ l.
                if straights + straight > distance {
                    let share = metres / straight;
                    return [share, f64::max(share * straights - lengths, 0.0)];
                }
                lengths += metres;
                straights += straight;
            }
            // All short edges together are less than the distance: r = 1.
            [1.0, straights - lengths]
        };
        Self { lines: BEST_AT.map(line) }
    }

    /// Least length in metres of a route between places `distance` metres apart.
    #[inline]
    pub(super) fn at(&self, distance: f64) -> f64 {
        let bounds = self.lines.map(|[share, lacking]| share * distance - lacking);
        // Each line is a bound for every distance, so the largest is one.
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
