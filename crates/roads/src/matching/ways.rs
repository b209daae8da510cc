//! Ways along roads from a state to those of the next step.
//!
//! Only the cheapest way between two states counts, with U-turns and choices at junctions priced as
//! the detours that are as improbable. It has one of three shapes ([`WayKind`]): along one edge, by
//! a U-turn between the ends of an edge, or over the end of the first edge.

use super::MatchModel;
use super::candidates::{Candidate, metres_between};
use super::moves::{CHOICES, Interval};
use crate::{Reached, RoadNetwork, RouteCosts, RouteMeasures, RouteSearch};
use wayfix::map::Coordinates;

/// A way from one state to another along roads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    /// Length in metres; below 0 if the second point lies behind the first.
    pub(super) metres: f64,
    /// Detour in metres relative to the straight line between both points.
    pub(super) detour: f64,
    pub(super) u_turns: u32,
    /// Choices at junctions: the sum of −ln p(turn).
    pub(super) log_choices: f64,
    /// Metres along the first edge at which the second would start; `None` for a U-turn between.
    pub(super) starts: Option<f64>,
}

impl Way {
    /// True if the way stays on its edge.
    pub(super) fn is_same_edge(&self) -> bool {
        self.starts == Some(0.0)
    }
}

/// Kind of a way between two states on roads.
#[derive(Debug, Clone, Copy)]
pub(super) enum WayKind {
    SameEdge,
    /// A U-turn from an edge onto its reverse, between their ends.
    Turn,
    /// Over the end of the first edge, usually with other edges in between.
    Edges(Reached),
}

/// True if a state is so far behind another on its edge that the vehicle must have driven around
/// the block. Anything less is the jitter of positions.
fn is_behind(from: &Candidate, to: &Candidate, jitter: f64) -> bool {
    to.along - from.along < -6.0 * jitter
}

/// Finds the ways from one state to others.
pub(super) struct Ways<'a, P> {
    pub(super) network: &'a RoadNetwork<P>,
    pub(super) measures: &'a RouteMeasures,
    pub(super) search: &'a mut RouteSearch,
}

impl<P: Coordinates> Ways<'_, P> {
    /// Sets the states of the next point as targets.
    pub(super) fn set_targets(
        &mut self,
        to: &[Candidate],
        model: &MatchModel,
        interval: &Interval,
    ) {
        let edges = to.iter().filter(|to| !to.is_off_road()).map(|to| to.edge as usize);
        // The cheapest way is the most probable one: detours have density e^(−d / scale), so an
        // event of probability p costs −ln p times the scale in metres.
        let detour = interval.detour_scale(model);
        let costs = RouteCosts { u_turn: -model.u_turn.ln() * detour, choice: CHOICES * detour };
        self.search.set_targets(self.network, self.measures, edges, costs);
    }

    /// Searches from a state on a road for the targets.
    pub(super) fn search_from(&mut self, from: &Candidate, interval: &Interval) {
        let edge = from.edge as usize;
        let left = self.network.edges()[edge].metres - from.along;
        // The search counts metres from the end of the edge, so what is left of it comes off the
        // limit.
        self.search.run(self.network, self.measures, edge, interval.longest() - left);
    }

    /// Kind of the way between two states on roads after [`search_from`](Self::search_from); `None`
    /// if there is none.
    pub(super) fn kind(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<WayKind> {
        let [edge, next] = [from.edge as usize, to.edge as usize];
        if edge == next && !is_behind(from, to, jitter) {
            return Some(WayKind::SameEdge);
        }
        let reached = self.search.reached(next);
        // A U-turn between the ends, unless the route over the ends of the edges does without any.
        let is_turn = reached.is_none_or(|reached| reached.u_turns > 0);
        if is_turn && self.network.reverse(edge) == Some(next) {
            return Some(WayKind::Turn);
        }
        reached.map(WayKind::Edges)
    }

    /// Way between two states on roads; `None` if there is none.
    pub(super) fn way(&self, from: &Candidate, to: &Candidate, jitter: f64) -> Option<Way> {
        let short = |metres, u_turns, starts| Way {
            metres,
            detour: 0.0,
            u_turns,
            log_choices: 0.0,
            starts,
        };
        Some(match self.kind(from, to, jitter)? {
            WayKind::SameEdge => short(to.along - from.along, 0, Some(0.0)),
            WayKind::Turn => {
                let here = self.network.edges()[from.edge as usize].metres - from.along;
                // `here` is the start of the way as measured along the reverse edge.
                short((to.along - here).abs(), 1, None)
            }
            WayKind::Edges(reached) => self.along(from, to, reached),
        })
    }

    fn along(&self, from: &Candidate, to: &Candidate, reached: Reached) -> Way {
        let straight = metres_between::<P>(from.point, to.point);
        let [edge, next] = [from.edge as usize, to.edge as usize];
        let length = |edge: usize| self.network.edges()[edge].metres;
        let left = 1.0 - from.along / length(edge);
        let done = to.along / length(next);
        let metres = left * length(edge) + reached.metres + to.along;
        // The bends of a road are not a choice of the driver, so a detour is measured along the
        // chords of the edges.
        let straight_of = |edge| self.measures.straight_metres(edge);
        let chords = left * straight_of(edge) + reached.chords + done * straight_of(next);
        Way {
            metres,
            detour: (chords - straight).max(0.0),
            u_turns: reached.u_turns,
            log_choices: reached.log_choices,
            starts: Some(length(edge) + reached.metres),
        }
    }
}
