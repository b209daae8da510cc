//! The connected route through one state per point, built by the rules of its moves.

use super::rules::{LEAST, Link, Part, RouteExtension, RouteRules, links};
use crate::RoadNetwork;
use crate::matching::candidates::{Candidate, OFF_ROAD};
use crate::matching::step::MatchStep;
use crate::matching::{Stretch, TracePoint};
use wayfix::map::Coordinates;

/// Connected route through one state per point.
pub(in crate::matching) fn route<P: Coordinates>(
    network: &RoadNetwork<P>,
    points: &[TracePoint<P>],
    path: &[Candidate],
    step: &mut MatchStep<'_, P>,
) -> Vec<Stretch<P>> {
    let (rules, mut route, mut added) =
        (RouteRules(network), Vec::new(), RouteExtension::default());
    let mut mode = RouteRules::<P>::start(&path[0], &mut added);
    rules.extend(&mut route, [&points[0]; 2], &added);
    for (pair, points) in path.windows(2).zip(points.windows(2)) {
        let ([from, to], points) = ([&pair[0], &pair[1]], [&points[0], &points[1]]);
        let on_road = if to.is_off_road() { &[][..] } else { &pair[1..] };
        let link = links(from, on_road, points, step).pop().unwrap_or(Link::SameEdge);
        added = RouteExtension::default();
        mode = rules.go(mode, [from, to], &link, &mut added);
        rules.extend(&mut route, points, &added);
    }
    added = RouteExtension::default();
    RouteRules::<P>::finish(mode, &path[path.len() - 1], &mut added);
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
            // After a U-turn, the reverse edge is entered where the stretch before ends. Both edges
            // may differ in length, so at the end of one the other starts at 0.
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
