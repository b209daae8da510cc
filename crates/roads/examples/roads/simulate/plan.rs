//! Routes of simulated drives: the fastest ones to random roads, with U-turns and car parks.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use wayfix::map::RoadClass;
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::Stretch;

use super::{Movable, Scenario};

/// Longest drive to a destination in seconds.
const LONGEST: f64 = 900.0;

/// Metres from a road to a car park, and metres driven there along the road's direction.
const DEPTH: std::ops::Range<f64> = 30.0..60.0;
const CRAWL: std::ops::Range<f64> = 5.0..30.0;

/// Speed off the road in metres per second.
pub(super) const OFF_ROAD: f64 = 3.0;

/// Free speed on an edge in metres per second.
pub(super) fn speed<P: Movable>(network: &RoadNetwork<P>, edge: usize) -> f64 {
    let edge = network.edges()[edge];
    edge.speed.map_or(0.0, |speed| 0.9 * speed).max(match edge.class {
        _ if edge.speed.is_some() => 2.0,
        _ if edge.roundabout => 7.0,
        RoadClass::Main => 20.0,
        RoadClass::Arterial => 15.0,
        RoadClass::Collector => 12.0,
        RoadClass::Street => 9.0,
    })
}

/// Draws a route: parts of edges, and straight lines off the road.
pub(super) fn plan<P: Movable>(
    network: &RoadNetwork<P>,
    scenario: &Scenario,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Stretch<P>>> {
    let count = network.edges().len();
    (count > 0).then_some(())?;
    // A random edge, entered anywhere in its first four fifths.
    let from = rng.random_range(0..count);
    let enter = rng.random_range(0.0..0.8);
    let mut route = fastest(network, from, enter, rng)?;
    if rng.random_bool(scenario.u_turns) {
        turn_back(network, &mut route, rng);
    }
    if rng.random_bool(scenario.car_parks) {
        park(network, &mut route, rng);
    }
    Some(route)
}

/// Part of an edge.
fn part<P: Movable>(network: &RoadNetwork<P>, edge: usize, enter: f64, exit: f64) -> Stretch<P> {
    let ends = [enter, exit].map(|along| network.position_along(edge, along));
    Stretch { edge: Some(edge), enter, exit, ends }
}

/// Fastest route from a share of an edge to a random edge at least a minute away.
fn fastest<P: Movable>(
    network: &RoadNetwork<P>,
    from: usize,
    share: f64,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Stretch<P>>> {
    let edges = network.edges();
    let mut best = vec![(f64::INFINITY, usize::MAX); edges.len()];
    let mut settled = Vec::new();
    let mut queue = BinaryHeap::from([Reverse((0, from))]);
    best[from].0 = 0.0;
    while let Some(Reverse((bits, edge))) = queue.pop() {
        let seconds = f64::from_bits(bits);
        // An outdated entry of the queue: Dijkstra (1959). Bits of non-negative doubles have their
        // order.
        if seconds > best[edge].0 {
            continue;
        }
        settled.push(edge);
        let after = seconds + edges[edge].metres / speed(network, edge);
        if after > LONGEST {
            continue;
        }
        let back = network.reverse(edge);
        // Back only at dead ends.
        let is_end = network.next(edge).all(|next| Some(next) == back);
        for next in network.next(edge).filter(|next| is_end || Some(*next) != back) {
            if after < best[next].0 {
                best[next] = (after, edge);
                queue.push(Reverse((after.to_bits(), next)));
            }
        }
    }
    let longest = settled.last().map_or(0.0, |&edge| best[edge].0);
    // Edges are settled in the order of their times, so the last is the farthest. Destinations are
    // the farther ones, so that drives are not mostly short.
    let least = (0.4 * longest).max(60.0);
    let ends: Vec<usize> = settled.into_iter().filter(|&edge| best[edge].0 >= least).collect();
    (!ends.is_empty()).then_some(())?;
    let mut route = vec![ends[rng.random_range(0..ends.len())]];
    while let Some(&edge) = route.last()
        && edge != from
    {
        route.push(best[edge].1);
    }
    // All edges are driven as a whole but the first.
    let whole = |edge: usize| part(network, edge, 0.0, edges[edge].metres);
    let mut route: Vec<_> = route.into_iter().rev().map(whole).collect();
    let metres = edges[from].metres;
    route[0] = part(network, from, share * metres, metres);
    Some(route)
}

/// Turns back on the way, in the middle of a road or at its end, and continues to another
/// destination.
fn turn_back<P: Movable>(
    network: &RoadNetwork<P>,
    route: &mut Vec<Stretch<P>>,
    rng: &mut ChaCha8Rng,
) {
    let number = rng.random_range(0..route.len());
    let Some(edge) = route[number].edge else { return };
    let Some(back) = network.reverse(edge) else { return };
    let mut share = 1.0;
    if number > 0 && rng.random_bool(0.5) {
        // In the middle, where the network has no turn; at the end, it must allow one.
        share = rng.random_range(0.2..0.8);
    } else if network.next(edge).all(|next| next != back) {
        return;
    }
    if let Some(other) = fastest(network, back, 1.0 - share, rng) {
        route.truncate(number + 1);
        let enter = route[number].enter;
        route[number] = part(network, edge, enter, share * network.edges()[edge].metres);
        route.extend(other);
    }
}

/// Leaves the road for a car park away from other roads, crawls there, and returns to where it left
/// the road.
fn park<P: Movable>(network: &RoadNetwork<P>, route: &mut Vec<Stretch<P>>, rng: &mut ChaCha8Rng) {
    for _ in 0..20 {
        let number = rng.random_range(0..route.len());
        let Stretch { edge: Some(edge), enter, exit, .. } = route[number] else { continue };
        let is_end = number == 0 || number + 1 == route.len();
        let gate = enter + rng.random_range(0.2..0.8) * (exit - enter);
        let [before, at, after] =
            [gate - 1.0, gate, gate + 1.0].map(|along| network.position_along(edge, along));
        let [x, y] = after.offset_from(before);
        let metres = x.hypot(y);
        let depth = rng.random_range(DEPTH);
        let across = if rng.random_bool(0.5) { depth } else { -depth } / metres;
        let crawl = rng.random_range(CRAWL) / metres;
        let first = at.moved([-across * y, across * x]);
        let second = first.moved([crawl * x, crawl * y]);
        // All roads are at least 0.8 of the depth away from both ends, so that off the road is the
        // only right answer there.
        let is_clear = |place: P| {
            let mut edges = 0..network.edges().len();
            edges.all(|edge| network.project(edge, place).metres_off >= 0.8 * depth)
        };
        if is_end || metres == 0.0 || !is_clear(first) || !is_clear(second) {
            continue;
        }
        let ends = [[at, first], [first, second], [second, at]];
        let off_road = ends.map(|[from, to]| Stretch {
            edge: None,
            enter: 0.0,
            exit: from.metres_to(to),
            ends: [from, to],
        });
        let mut stay = vec![part(network, edge, enter, gate)];
        stay.extend(off_road);
        stay.push(part(network, edge, gate, exit));
        route.splice(number..=number, stay);
        return;
    }
}
