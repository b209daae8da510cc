//! Part of a network in a box.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use crate::NetworkError;
use wayfix::internal::Number;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Nodes in the box between two opposite corners, borders included, and the edges between them
    /// with their forbidden turns. A box cannot cross the antimeridian. O(nodes + edges).
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
    /// let network = builder.build()?;
    ///
    /// let corners = [PlanePosition { x: 150.0, y: 10.0 }, PlanePosition { x: -10.0, y: -10.0 }];
    /// let (west, step) = network.within(corners)?;
    /// assert_eq!(west.nodes().len(), 2);
    /// assert_eq!(step.to_string(), "cut to a box: 3 → 2 nodes, 4 → 2 edges");
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`NetworkError::EmptyBox`] if no node lies in the box.
    pub fn within(&self, corners: [P; 2]) -> Result<(Self, CleaningStep<P>), NetworkError> {
        let [a, b] = corners.map(P::values);
        let (low, high) = ([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]);
        // `min` and `max` skip NaN, but a box with NaN must be empty.
        let numbers = a.iter().chain(&b).all(|value| !value.is_nan());
        let inside = |n: usize| {
            let values = self.nodes()[n].position.values();
            numbers && (0..2).all(|i| (low[i]..=high[i]).contains(&values[i]))
        };
        let (nodes, target) = self.selected(inside);
        if nodes.is_empty() {
            // The error tells where the nodes are: swapped axes or another projection show at once.
            let mut extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
            for values in self.nodes().iter().map(|node| node.position.values()) {
                for i in 0..2 {
                    extent[0][i] = extent[0][i].min(values[i]);
                    extent[1][i] = extent[1][i].max(values[i]);
                }
            }
            let (asked, extent) = (in_words::<P>([a, b]), in_words::<P>(extent));
            return Err(NetworkError::EmptyBox { asked, extent });
        }
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::Within(corners), self, &network);
        Ok((network, step))
    }
}

/// Ranges of both axes.
fn in_words<P: Coordinates>([a, b]: [[f64; 2]; 2]) -> String {
    let [(first, _), (second, _)] = P::AXES;
    let ([a, c], [b, d]) = (a.map(Number), b.map(Number));
    format!("{first} {a} to {b} and {second} {c} to {d}")
}
