//! Cleaning of a network in steps, each with a report.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use crate::NetworkError;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Cleans a network by a sequence of operations. Returns the counts of each.
    ///
    /// A good order is: cut to a box, keep the largest part, drop dead ends, contract, merge, and
    /// contract again, since merging may leave nodes that roads only pass through.
    ///
    /// ```
    /// use wayfix_roads::{Cleaning, NetworkBuilder};
    /// use wayfix::map::{PlanePosition, RoadClass};
    ///
    /// // Two carriageways of a road, 20 m apart, cross a street.
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 200.0, 0.0), (3, 200.0, 20.0), (4, 0.0, 20.0), (5, 200.0, 300.0)] {
    ///     builder.node(id, PlanePosition { x, y })?;
    /// }
    /// builder.one_way(1, 2, RoadClass::Main)?;
    /// builder.one_way(3, 4, RoadClass::Main)?;
    /// builder.both_ways(1, 4, RoadClass::Main)?;
    /// builder.both_ways(2, 3, RoadClass::Street)?;
    /// builder.both_ways(3, 5, RoadClass::Street)?;
    ///
    /// let (network, steps) = builder.build()?.cleaned(&[Cleaning::Merging { metres: 30.0 }])?;
    /// assert_eq!(network.nodes().len(), 3);
    /// assert_eq!(steps[0].to_string(), "merged within 30 m: 5 → 3 nodes, 8 → 4 edges");
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`NetworkError::EmptyBox`] and [`NetworkError::Parameter`], as [`within`](Self::within) and
    /// [`merged`](Self::merged).
    pub fn cleaned(
        self,
        operations: &[Cleaning<P>],
    ) -> Result<(Self, Vec<CleaningStep<P>>), NetworkError> {
        let (mut network, mut steps) = (self, Vec::new());
        for operation in operations {
            let (cleaned, step) = match *operation {
                Cleaning::Within(corners) => network.within(corners)?,
                Cleaning::LargestComponent => network.largest_component(),
                Cleaning::DeadEnds => network.without_dead_ends(),
                Cleaning::Contraction => network.contracted(),
                Cleaning::Merging { metres } => network.merged(metres)?,
            };
            network = cleaned;
            steps.push(step);
        }
        Ok((network, steps))
    }
}
