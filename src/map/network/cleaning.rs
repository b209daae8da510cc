//! Cleaning of a network in steps, each with a report.

use std::fmt;

use super::RoadNetwork;
use crate::map::{Coordinates, MapError, Position};

/// Choice of the steps that clean a network, in the order of their fields; none by default.
///
/// ```
/// use wayfix::map::{Cleaning, NetworkBuilder, PlanePosition, RoadClass};
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
/// let cleaning = Cleaning { merge_metres: Some(30.0), ..Cleaning::default() };
/// let (network, steps) = builder.build()?.cleaned(&cleaning)?;
/// assert_eq!(network.nodes().len(), 3);
/// assert_eq!(steps[0].to_string(), "merged within 30 m: 5 → 3 nodes, 8 → 4 edges");
/// # Ok::<(), wayfix::map::MapError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Cleaning<P = Position> {
    /// Opposite corners of the box to [cut to](RoadNetwork::within).
    pub within: Option<[P; 2]>,
    /// True to keep only the [largest part](RoadNetwork::largest_component) in which each node can
    /// be reached.
    pub largest_component: bool,
    /// True to drop [dead ends](RoadNetwork::without_dead_ends).
    pub drop_dead_ends: bool,
    /// True to [contract](RoadNetwork::contracted) nodes that roads only pass through.
    pub contract: bool,
    /// Radius in which intersections are [merged](RoadNetwork::merged); contracted again after if
    /// they were before.
    pub merge_metres: Option<f64>,
}

impl<P> Default for Cleaning<P> {
    fn default() -> Self {
        Self {
            within: None,
            largest_component: false,
            drop_dead_ends: false,
            contract: false,
            merge_metres: None,
        }
    }
}

/// One way to clean a network.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum CleaningOperation {
    /// Cut to a box.
    Within,
    /// Largest strongly connected part.
    LargestComponent,
    /// Dead ends dropped.
    DeadEnds,
    /// Contraction of nodes that roads only pass through.
    Contraction,
    /// Merging of intersections.
    Merging {
        /// Radius.
        metres: f64,
    },
}

/// Counts of a network before and after a step of cleaning.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CleaningStep {
    /// Operation of the step.
    pub operation: CleaningOperation,
    /// Numbers of nodes before and after.
    pub nodes: [usize; 2],
    /// Numbers of edges before and after.
    pub edges: [usize; 2],
    /// Numbers of forbidden turns before and after. A turn is lost with one of its edges, or with a
    /// node where the only forbidden turn was that back.
    pub forbidden_turns: [usize; 2],
}

impl CleaningStep {
    pub(super) fn of<P>(
        operation: CleaningOperation,
        before: &RoadNetwork<P>,
        after: &RoadNetwork<P>,
    ) -> Self {
        let both = [before, after];
        Self {
            operation,
            nodes: both.map(|network| network.nodes.len()),
            edges: both.map(|network| network.edges.len()),
            forbidden_turns: both.map(|network| network.forbidden.len()),
        }
    }
}

/// Prints the operation and the counts in one line, forbidden turns only if there were any.
impl fmt::Display for CleaningStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.operation {
            CleaningOperation::Within => write!(f, "cut to a box")?,
            CleaningOperation::LargestComponent => write!(f, "largest part")?,
            CleaningOperation::DeadEnds => write!(f, "dead ends dropped")?,
            CleaningOperation::Contraction => write!(f, "contracted")?,
            CleaningOperation::Merging { metres } => write!(f, "merged within {metres} m")?,
        }
        let Self { nodes, edges, forbidden_turns: turns, .. } = self;
        write!(f, ": {} → {} nodes, {} → {} edges", nodes[0], nodes[1], edges[0], edges[1])?;
        if turns[0] > 0 {
            write!(f, ", {} → {} forbidden turns", turns[0], turns[1])?;
        }
        Ok(())
    }
}

impl<P: Coordinates> RoadNetwork<P> {
    /// Cleans a network in the chosen steps. Returns the counts of each.
    ///
    /// # Errors
    ///
    /// [`MapError::EmptyBox`] and [`MapError::Parameter`], as [`within`](Self::within) and
    /// [`merged`](Self::merged).
    pub fn cleaned(self, cleaning: &Cleaning<P>) -> Result<(Self, Vec<CleaningStep>), MapError> {
        let (mut network, mut steps) = (self, Vec::new());
        let mut take = |network: &mut Self, (cleaned, step): (Self, CleaningStep)| {
            *network = cleaned;
            steps.push(step);
        };
        if let Some(corners) = cleaning.within {
            let cut = network.within(corners)?;
            take(&mut network, cut);
        }
        if cleaning.largest_component {
            let largest = network.largest_component();
            take(&mut network, largest);
        }
        if cleaning.drop_dead_ends {
            let open = network.without_dead_ends();
            take(&mut network, open);
        }
        if cleaning.contract {
            let contracted = network.contracted();
            take(&mut network, contracted);
        }
        if let Some(metres) = cleaning.merge_metres {
            let merged = network.merged(metres)?;
            take(&mut network, merged);
            if cleaning.contract {
                let contracted = network.contracted();
                take(&mut network, contracted);
            }
        }
        Ok((network, steps))
    }
}
