//! The connected route through one state per point, by rules of its moves such that no stretch has
//! zero length.
//!
//! An edge enters the route with the first metre driven on it, not with the first state on it. So a
//! position at the very end of an edge, or at the place of a U-turn, leaves no stretch of 0 m. What
//! has been driven so far is kept in a [`RouteEnd`], which depends on the previous one and the move
//! alone: so the lattice of all routes can carry it in its nodes.

use crate::RoadNetwork;
use crate::matching::candidates::{Candidate, OFF_ROAD};
use crate::matching::moves::WayKind;
use crate::matching::step::MatchStep;
use crate::matching::{Stretch, TracePoint};
use wayfix::map::Coordinates;

/// Metres up to which a stretch counts as having no length.
pub(super) const LEAST: f64 = 1e-3;

/// Relation of a state's edge to the end of the route that leads to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RouteEnd {
    /// The last stretch is on the edge, or off the road.
    Driven,
    /// Nothing has been driven on a road since the start or the last stretch off the road.
    Fresh { after_off_road: bool },
    /// The last stretch is on the edge `after`, and nothing has been driven on the state's edge. If
    /// `turned`, the vehicle entered the reverse edge and turned there at once.
    Waiting { after: u32, turned: bool },
}

/// Way of a move between two states on roads.
#[derive(Debug, Clone)]
pub(super) enum Link {
    SameEdge,
    /// A U-turn on the way.
    Turn,
    /// Edges in order, including those of both states.
    Edges(Vec<usize>),
}

/// Part of an edge that a move adds, or a stretch off the road.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub(super) edge: u32,
    pub(super) enter: f64,
    pub(super) exit: f64,
}

/// Parts that a move adds, and where the stretch before them ends at least.
#[derive(Debug, Clone, Default)]
pub(super) struct RouteExtension {
    pub(super) extend: Option<f64>,
    /// True if the last stretch is off the road, and ends at the second point.
    pub(super) from_off_road: bool,
    pub(super) parts: Vec<Part>,
}

impl RouteExtension {
    fn push(&mut self, edge: usize, enter: f64, exit: f64) {
        self.parts.push(Part { edge: edge as u32, enter, exit });
    }

    fn off_road(&mut self) {
        self.parts.push(Part { edge: OFF_ROAD, enter: 0.0, exit: 0.0 });
    }
}

/// Ways from a state to others on roads at the next point; none off the road.
pub(super) fn links<P: Coordinates>(
    from: &Candidate,
    to: &[Candidate],
    points: [&TracePoint<P>; 2],
    step: &mut MatchStep<'_, P>,
) -> Vec<Link> {
    // Nothing to search for: links from off the road are never read.
    if from.is_off_road() || to.is_empty() {
        return Vec::new();
    }
    let (ways, jitter) = step.ways(from, to, points);
    let link = |to: &Candidate| match ways.kind(from, to, jitter) {
        Some(WayKind::SameEdge) => Link::SameEdge,
        Some(WayKind::Turn) => Link::Turn,
        _ => Link::Edges(ways.search.route(from.edge as usize, to.edge as usize)),
    };
    to.iter().map(link).collect()
}

/// Rules by which moves add stretches, on a network.
#[derive(Debug)]
pub(super) struct RouteRules<'a, P>(pub(super) &'a RoadNetwork<P>);

impl<P: Coordinates> RouteRules<'_, P> {
    /// Begins a route.
    pub(super) fn start(state: &Candidate, added: &mut RouteExtension) -> RouteEnd {
        if !state.is_off_road() {
            return RouteEnd::Fresh { after_off_road: false };
        }
        added.off_road();
        RouteEnd::Driven
    }

    /// Ends a route. The route of a vehicle that was stationary throughout has one stretch without
    /// length.
    pub(super) fn finish(end: RouteEnd, state: &Candidate, added: &mut RouteExtension) {
        if end == (RouteEnd::Fresh { after_off_road: false }) {
            added.push(state.edge as usize, state.along, state.along);
        }
    }

    /// Moves from a state to the next. `link` is only read if both are on roads.
    pub(super) fn advance(
        &self,
        end: RouteEnd,
        [from, to]: [&Candidate; 2],
        link: &Link,
        added: &mut RouteExtension,
    ) -> RouteEnd {
        added.from_off_road = from.is_off_road();
        match (from.is_off_road(), to.is_off_road()) {
            (true, true) => RouteEnd::Driven,
            (true, false) => RouteEnd::Fresh { after_off_road: true },
            (false, true) => {
                // A single point on a road between two off it does not interrupt the stretch off
                // the road.
                if end == (RouteEnd::Fresh { after_off_road: true }) {
                    added.from_off_road = true;
                } else {
                    added.off_road();
                }
                RouteEnd::Driven
            }
            (false, false) => match link {
                Link::SameEdge => self.same_edge(end, from, to, added),
                Link::Turn => self.turn(end, from, to, added),
                Link::Edges(edges) => self.edges(end, from, to, edges, added),
            },
        }
    }

    pub(super) fn length(&self, edge: usize) -> f64 {
        self.0.edges()[edge].metres
    }

    /// True if the edge before was left by a U-turn for this one.
    fn is_u_turn_of(&self, edge: usize, after: u32) -> bool {
        self.0.reverse(edge) == Some(after as usize)
    }

    fn same_edge(
        &self,
        end: RouteEnd,
        from: &Candidate,
        to: &Candidate,
        added: &mut RouteExtension,
    ) -> RouteEnd {
        let edge = from.edge as usize;
        match end {
            RouteEnd::Driven => added.extend = Some(to.along),
            RouteEnd::Fresh { .. } | RouteEnd::Waiting { turned: false, .. }
                if to.along > from.along + LEAST =>
            {
                // A vehicle that came over the start of the edge enters at 0; a fresh one, or one
                // after a U-turn, where the state was.
                let at_start = matches!(end, RouteEnd::Waiting { after, .. } if !self.is_u_turn_of(edge, after));
                added.push(edge, if at_start { 0.0 } else { from.along }, to.along);
                return RouteEnd::Driven;
            }
            RouteEnd::Waiting { after, turned: false } if self.is_u_turn_of(edge, after) => {
                // Further back on this edge means that the turn came later, further along the
                // reverse one.
                added.extend = Some(self.length(after as usize) - to.along);
            }
            RouteEnd::Waiting { turned: true, .. } if to.along < self.length(edge) - LEAST => {
                return self.turned_later(to, added);
            }
            RouteEnd::Fresh { .. } | RouteEnd::Waiting { .. } => {}
        }
        end
    }

    /// The vehicle went some way into the reverse of a state's edge, and turned.
    fn turned_later(&self, to: &Candidate, added: &mut RouteExtension) -> RouteEnd {
        let Some(reverse) = self.0.reverse(to.edge as usize) else { return RouteEnd::Driven };
        added.push(reverse, 0.0, (self.length(reverse) - to.along).max(0.0));
        RouteEnd::Waiting { after: reverse as u32, turned: false }
    }

    fn turn(
        &self,
        end: RouteEnd,
        from: &Candidate,
        to: &Candidate,
        added: &mut RouteExtension,
    ) -> RouteEnd {
        let [edge, next] = [from.edge as usize, to.edge as usize];
        // The place of the previous state, measured along the reverse edge.
        let here = (self.length(next) - from.along).max(0.0);
        let moves = to.along > here + LEAST;
        match end {
            RouteEnd::Driven | RouteEnd::Fresh { .. } if moves => added.push(next, here, to.along),
            RouteEnd::Driven => {
                added.extend = Some(self.length(edge) - to.along);
                return RouteEnd::Waiting { after: from.edge, turned: false };
            }
            RouteEnd::Fresh { .. } => return end,
            RouteEnd::Waiting { after, turned: false } if after == to.edge => {
                added.extend = Some(to.along);
            }
            RouteEnd::Waiting { turned: true, .. } if to.along > LEAST => {
                added.push(next, 0.0, to.along);
            }
            RouteEnd::Waiting { after, turned: true } => {
                return RouteEnd::Waiting { after, turned: false };
            }
            RouteEnd::Waiting { .. } if to.along < self.length(next) - LEAST => {
                return self.turned_later(to, added);
            }
            RouteEnd::Waiting { after, .. } => return RouteEnd::Waiting { after, turned: true },
        }
        RouteEnd::Driven
    }

    fn edges(
        &self,
        end: RouteEnd,
        from: &Candidate,
        to: &Candidate,
        edges: &[usize],
        added: &mut RouteExtension,
    ) -> RouteEnd {
        // `edges` has at least the edges of both states, since the same search found the ways of
        // the trellis.
        let [_, between @ .., next] = edges else { return end };
        let (edge, first) = (from.edge as usize, *between.first().unwrap_or(next));
        let length = self.length(edge);
        let at_end = from.along >= length - LEAST;
        // The edge of the last stretch, if there is one; needed if `to` is at the very start of its
        // edge.
        let mut last = Some(from.edge);
        match end {
            RouteEnd::Driven => added.extend = Some(length),
            RouteEnd::Fresh { .. } if at_end => last = None,
            RouteEnd::Fresh { .. } => added.push(edge, from.along, length),
            RouteEnd::Waiting { after, turned: false } if self.is_u_turn_of(edge, after) => {
                added.push(edge, from.along, length);
            }
            RouteEnd::Waiting { turned: false, .. } if !at_end => added.push(edge, 0.0, length),
            RouteEnd::Waiting { after, .. } if self.connects(after as usize, first) => {
                last = Some(after);
            }
            // Without this edge, two allowed turns would become a forbidden one. So the edge stays
            // in the route, with hardly any length.
            RouteEnd::Waiting { turned, .. } => {
                if let Some(reverse) = self.0.reverse(edge).filter(|_| turned) {
                    added.push(reverse, 0.0, 0.0);
                }
                added.push(edge, if turned { length } else { 0.0 }, length);
            }
        }
        for &edge in between {
            added.push(edge, 0.0, self.length(edge));
            last = Some(edge as u32);
        }
        if to.along > LEAST {
            added.push(*next, 0.0, to.along);
            return RouteEnd::Driven;
        }
        last.map_or(end, |after| RouteEnd::Waiting { after, turned: false })
    }

    fn connects(&self, edge: usize, next: usize) -> bool {
        let edges = self.0.edges();
        edges[edge].to == edges[next].from && self.0.may_turn(edge, next)
    }
}

/// Connected route through one state per point.
pub(in crate::matching) fn route<P: Coordinates>(
    network: &RoadNetwork<P>,
    points: &[TracePoint<P>],
    path: &[Candidate],
    step: &mut MatchStep<'_, P>,
) -> Vec<Stretch<P>> {
    let (rules, mut route, mut added) =
        (RouteRules(network), Vec::new(), RouteExtension::default());
    let mut end = RouteRules::<P>::start(&path[0], &mut added);
    rules.extend(&mut route, [&points[0]; 2], &added);
    for (pair, points) in path.windows(2).zip(points.windows(2)) {
        let ([from, to], points) = ([&pair[0], &pair[1]], [&points[0], &points[1]]);
        let on_road = if to.is_off_road() { &[][..] } else { &pair[1..] };
        let link = links(from, on_road, points, step).pop().unwrap_or(Link::SameEdge);
        added = RouteExtension::default();
        end = rules.advance(end, [from, to], &link, &mut added);
        rules.extend(&mut route, points, &added);
    }
    added = RouteExtension::default();
    RouteRules::<P>::finish(end, &path[path.len() - 1], &mut added);
    rules.extend(&mut route, [&points[points.len() - 1]; 2], &added);
    route
}

impl<P: Coordinates> RouteRules<'_, P> {
    /// Metres along an edge, snapped to its end if what is left would be no stretch.
    fn up_to_end(&self, edge: usize, along: f64) -> f64 {
        let length = self.length(edge);
        if along >= length - LEAST { length } else { along }
    }

    /// Extends a route by what a move between two points adds.
    fn extend(
        &self,
        route: &mut Vec<Stretch<P>>,
        [from, to]: [&TracePoint<P>; 2],
        added: &RouteExtension,
    ) {
        if let Some(last) = route.last_mut() {
            match (last.edge, added.extend) {
                (None, _) if added.from_off_road => {
                    last.ends[1] = to.position;
                    last.exit = last.ends[0].metres_to(to.position);
                }
                (Some(edge), Some(exit)) => {
                    // Positions jitter backwards; a route does not.
                    last.exit = last.exit.max(self.up_to_end(edge, exit));
                    last.ends[1] = self.0.position_along(edge, last.exit);
                }
                _ => {}
            }
        }
        for &Part { edge, mut enter, mut exit } in &added.parts {
            if edge == OFF_ROAD {
                let metres = from.position.metres_to(to.position);
                let ends = [from.position, to.position];
                route.push(Stretch { edge: None, enter: 0.0, exit: metres, ends });
                continue;
            }
            let edge = edge as usize;
            if exit > enter {
                exit = self.up_to_end(edge, exit);
            }
            // After a U-turn, the reverse edge is entered where the previous stretch ends. The two
            // edges may differ in length, so at the end of one the other starts at 0.
            if let Some((before, end)) =
                route.last().and_then(|last| last.edge.zip(Some(last.exit)))
                && self.0.reverse(edge) == Some(before)
            {
                let at_end = end >= self.length(before);
                let turn = if at_end { 0.0 } else { (self.length(edge) - end).max(0.0) };
                enter = turn.min(exit);
            }
            let ends = [enter, exit].map(|along| self.0.position_along(edge, along));
            route.push(Stretch { edge: Some(edge), enter, exit, ends });
        }
    }
}
