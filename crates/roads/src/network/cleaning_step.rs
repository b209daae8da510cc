//! Operations that clean a network, and the report of each.

use std::fmt;

use super::road_network::RoadNetwork;
use wayfix::map::Position;

/// One way to clean a network.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Cleaning<P = Position> {
    /// [Cut to the box](RoadNetwork::within) between two opposite corners.
    Within([P; 2]),
    /// Only the [largest part](RoadNetwork::largest_component) in which every node can be reached
    /// is kept.
    LargestComponent,
    /// [Dead ends](RoadNetwork::without_dead_ends) are dropped.
    DeadEnds,
    /// Nodes that roads only pass through are [contracted](RoadNetwork::contracted).
    Contraction,
    /// Intersections are [merged](RoadNetwork::merged).
    Merging {
        /// Radius.
        metres: f64,
    },
}

/// Counts of a network before and after a step of cleaning.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CleaningStep<P = Position> {
    /// Operation of the step.
    pub operation: Cleaning<P>,
    /// Numbers of nodes before and after.
    pub nodes: [usize; 2],
    /// Numbers of edges before and after.
    pub edges: [usize; 2],
    /// Numbers of forbidden turns before and after. A turn is lost with one of its edges, or with a
    /// contracted node where only going back was forbidden.
    pub forbidden_turns: [usize; 2],
}

impl<P> CleaningStep<P> {
    pub(super) fn of(
        operation: Cleaning<P>,
        before: &RoadNetwork<P>,
        after: &RoadNetwork<P>,
    ) -> Self {
        let both = [before, after];
        Self {
            operation,
            nodes: both.map(|network| network.nodes().len()),
            edges: both.map(|network| network.edges().len()),
            forbidden_turns: both.map(|network| network.forbidden_turns().len()),
        }
    }
}

/// Prints the operation and the counts in one line, forbidden turns only if there were any.
impl<P> fmt::Display for CleaningStep<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.operation {
            Cleaning::Within(_) => write!(f, "cut to a box")?,
            Cleaning::LargestComponent => write!(f, "largest part")?,
            Cleaning::DeadEnds => write!(f, "dead ends dropped")?,
            Cleaning::Contraction => write!(f, "contracted")?,
            Cleaning::Merging { metres } => write!(f, "merged within {metres} m")?,
        }
        let Self { nodes, edges, forbidden_turns: turns, .. } = self;
        write!(f, ": {} → {} nodes, {} → {} edges", nodes[0], nodes[1], edges[0], edges[1])?;
        if turns[0] > 0 {
            write!(f, ", {} → {} forbidden turns", turns[0], turns[1])?;
        }
        Ok(())
    }
}
