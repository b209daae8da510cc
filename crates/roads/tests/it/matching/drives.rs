//! Routes of whole drives.

use proptest::prelude::*;
use wayfix::map::{PlanePosition, RoadClass};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::matching::{MatchedDrive, Matcher, TracePoint};

use super::city::{Network, Point, Scenario, at, city, id, normal, points, standing};
use crate::kit::{cases_of, rng};

/// Checks that a route is connected: each edge follows the one before by an allowed turn, or
/// continues after a stretch off the road; edges are left at their ends, except in U-turns on the
/// way.
pub(crate) fn is_connected(network: &Network, drive: &MatchedDrive<PlanePosition>) {
    let (route, edges) = (drive.route(), network.edges());
    for stretch in route {
        assert!(stretch.enter.is_finite() && stretch.exit.is_finite(), "{stretch:?}");
        assert!(stretch.exit >= stretch.enter - 1e-9, "{stretch:?}");
        let Some(edge) = stretch.edge else {
            assert_eq!(stretch.enter, 0.0);
            let straight = stretch.ends[0].metres_to(stretch.ends[1]);
            assert!((stretch.exit - straight).abs() <= 1e-9 * straight);
            continue;
        };
        assert!(stretch.enter >= 0.0 && stretch.exit <= edges[edge].metres + 1e-9);
        let ends = [stretch.enter, stretch.exit].map(|metres| network.position_along(edge, metres));
        assert_eq!(stretch.ends, ends);
    }
    for pair in route.windows(2) {
        let [Some(edge), Some(next)] = [pair[0].edge, pair[1].edge] else {
            assert!(pair[0].edge.is_some() || pair[1].edge.is_some(), "{pair:?}");
            continue;
        };
        let (exit, enter, length) = (pair[0].exit, pair[1].enter, edges[edge].metres);
        let at_end = exit == length && enter == 0.0;
        if !at_end {
            assert_eq!(network.reverse(edge), Some(next), "{pair:?}");
            // A U-turn where the edge before was left.
            let jump = (edges[next].metres - exit - enter).abs();
            assert!(jump <= 200.0 && enter > 0.0 || jump < 1e-6, "{pair:?}");
            continue;
        }
        let follows = network.next(edge).any(|other| other == next);
        assert!(follows || network.reverse(edge) == Some(next), "{pair:?}");
    }
    let on_road: f64 = route.iter().filter(|s| s.edge.is_some()).map(|s| s.exit - s.enter).sum();
    assert!((on_road - drive.metres()).abs() <= 1e-9 * on_road.max(1.0));
}

/// Edges of the route.
fn edges(drive: &MatchedDrive<PlanePosition>) -> Vec<Option<usize>> {
    drive.route().iter().map(|stretch| stretch.edge).collect()
}

fn u_turns(network: &Network, drive: &MatchedDrive<PlanePosition>) -> usize {
    let edges = edges(drive);
    let turns = |pair: &&[Option<usize>]| {
        pair[0].is_some_and(|edge| pair[1].is_some() && network.reverse(edge) == pair[1])
    };
    edges.windows(2).filter(turns).count()
}

fn matched(matcher: &Matcher<PlanePosition>, points: &[Point]) -> MatchedDrive<PlanePosition> {
    let drive = matcher.match_drive(points).unwrap();
    is_connected(matcher.network(), &drive);
    drive
}

/// Positions one second apart along lines, at a speed, with noise.
fn along(corners: &[(f64, f64)], speed: f64, sigma: f64, seed: u64) -> Vec<Point> {
    let mut rng = rng(seed);
    let (mut points, mut time) = (Vec::new(), 0.0);
    for pair in corners.windows(2) {
        let [(x, y), (to_x, to_y)] = [pair[0], pair[1]];
        let metres = (to_x - x).hypot(to_y - y);
        let mut done = 0.0;
        while done < metres {
            let share = done / metres;
            let position = at(
                x + share * (to_x - x) + sigma * normal(&mut rng),
                y + share * (to_y - y) + sigma * normal(&mut rng),
            );
            points.push(TracePoint::new(time, position));
            (time, done) = (time + 1.0, done + speed);
        }
    }
    points
}

proptest! {
    #![proptest_config(cases_of(150))]

    #[test]
    fn routes_are_connected(
        seed in any::<u64>(), seconds in 0.5..60.0, sigma in 1.0..40.0, outliers in 0.0..0.4,
        forbidden in proptest::collection::vec((0..400_usize, 0..4_usize), 0..60),
    ) {
        let open = city(10, 10, 130.0, |a, b| (a[0] * 7 + b[1] * 3) % 11 == 0);
        // The same network with some turns forbidden.
        let mut builder = NetworkBuilder::new();
        for node in open.nodes() {
            builder.node(node.id, node.position).unwrap();
        }
        for edge in open.edges() {
            let [from, to] = [edge.from, edge.to].map(|node| open.nodes()[node].id);
            builder.one_way(from, to, edge.class).unwrap();
        }
        for (edge, which) in forbidden {
            let edge = edge % open.edges().len();
            let next: Vec<_> = open.next(edge).filter(|&n| open.reverse(edge) != Some(n)).collect();
            if next.len() > 1 {
                builder.forbid(edge, next[which % next.len()]);
            }
        }
        let network = builder.build().unwrap();
        let scenario = Scenario { noise: sigma, every: seconds, outliers, ..Scenario::default() };
        // Driven regardless of forbidden turns.
        let points = points(&open, &scenario, 50, seed);
        matched(&Matcher::new(network), &points);
    }
}

/// A street of one-way edges is never driven the wrong way, whatever the positions say.
#[test]
fn one_way_streets_are_not_driven_against() {
    let mut builder = NetworkBuilder::new();
    for n in 0..6 {
        builder.node(n, at(100.0 * n as f64, 0.0)).unwrap();
    }
    for n in 0..5 {
        builder.one_way(n, n + 1, RoadClass::Street).unwrap();
    }
    let matcher = Matcher::new(builder.build().unwrap());
    let there = matched(&matcher, &along(&[(20.0, 0.0), (480.0, 0.0)], 12.0, 4.0, 1));
    assert_eq!(edges(&there), [Some(0), Some(1), Some(2), Some(3), Some(4)]);
    assert!((there.metres() - 455.0).abs() < 30.0, "{}", there.metres());
    let back = matched(&matcher, &along(&[(480.0, 0.0), (20.0, 0.0)], 12.0, 4.0, 2));
    let on_road = back.metres();
    assert!(on_road < 100.0, "{on_road}: {:?}", back.route());
    assert_eq!(u_turns(matcher.network(), &back), 0);
}

/// To the end of a cul-de-sac and back.
#[test]
fn a_u_turn_at_a_dead_end() {
    let mut builder = NetworkBuilder::new();
    for (n, (x, y)) in
        [(0.0, 0.0), (300.0, 0.0), (600.0, 0.0), (300.0, 400.0)].into_iter().enumerate()
    {
        builder.node(n as u64, at(x, y)).unwrap();
    }
    for (from, to) in [(0, 1), (1, 2), (1, 3)] {
        builder.both_ways(from, to, RoadClass::Street).unwrap();
    }
    let network = builder.build().unwrap();
    let edge = |from, to| network.edge_between(from, to);
    let expected = [edge(0, 1), edge(1, 3), edge(3, 1), edge(1, 2)];
    let corners = [(20.0, 0.0), (300.0, 0.0), (300.0, 396.0), (300.0, 0.0), (580.0, 0.0)];
    let matcher = Matcher::new(network);
    for seed in 0..10 {
        let drive = matched(&matcher, &along(&corners, 10.0, 5.0, seed));
        assert_eq!(edges(&drive), expected, "{seed}");
        assert!((drive.metres() - 1360.0).abs() < 60.0, "{}", drive.metres());
    }
}

/// The streets within 300 m by 300 m are missing from the map.
#[test]
fn missing_streets_are_driven_off_road() {
    let gone = |node: [usize; 2]| (8..=14).contains(&node[0]) && (3..=17).contains(&node[1]);
    let network = city(22, 21, 100.0, |a, b| gone(a) || gone(b));
    let matcher = Matcher::new(network);
    let (mut right, mut count) = (0, 0);
    for seed in 0..8 {
        let points = along(&[(120.0, 1000.0), (1980.0, 1000.0)], 12.0, 5.0, seed);
        let drive = matched(&matcher, &points);
        let off: Vec<_> = drive.route().iter().filter(|s| s.edge.is_none()).collect();
        assert_eq!(off.len(), 1, "{seed}: {:?}", drive.route());
        // From 700 to 1500.
        let [start, end] = off[0].ends;
        assert!((start.x - 700.0).abs() < 80.0 && (end.x - 1500.0).abs() < 80.0, "{off:?}");
        assert!(drive.route()[0].edge.is_some());
        assert!(drive.route().last().unwrap().edge.is_some());
        for (number, point) in points.iter().enumerate() {
            let inside = (740.0..1460.0).contains(&point.position.x);
            let outside = !(660.0..1540.0).contains(&point.position.x);
            if inside || outside {
                count += 1;
                right += usize::from((drive.smoothed(number).off_road > 0.5) == inside);
            }
        }
    }
    assert!(right as f64 >= 0.98 * f64::from(count), "{right} of {count}");
}

/// Two kilometres without a position: the road continues in a tunnel.
#[test]
fn a_tunnel_is_bridged_on_the_road() {
    // A road of two kilometres in a grid whose streets all lead around.
    let open = city(40, 5, 100.0, |a, b| a[1] == 2 && b[1] == 2 && (9..30).contains(&a[0]));
    let mut builder = NetworkBuilder::new();
    for node in open.nodes() {
        builder.node(node.id, node.position).unwrap();
    }
    for edge in open.edges() {
        let [from, to] = [edge.from, edge.to].map(|node| open.nodes()[node].id);
        builder.one_way(from, to, edge.class).unwrap();
    }
    builder.both_ways(id(9, 2), id(30, 2), RoadClass::Arterial).unwrap();
    let matcher = Matcher::new(builder.build().unwrap());
    let tunnel =
        matcher.network().index_of_id(id(9, 2)).zip(matcher.network().index_of_id(id(30, 2)));
    let tunnel = tunnel.and_then(|(a, b)| matcher.network().edge_between(a, b));
    for seed in 0..8 {
        let mut points = along(&[(130.0, 200.0), (3850.0, 200.0)], 15.0, 5.0, seed);
        points.retain(|point| !(920.0..2980.0).contains(&(130.0 + 15.0 * point.time)));
        let drive = matched(&matcher, &points);
        assert!(drive.route().iter().all(|stretch| stretch.edge.is_some()), "{:?}", drive.route());
        assert!(edges(&drive).contains(&tunnel), "{:?}", drive.route());
        assert!((drive.metres() - 3710.0).abs() < 40.0, "{seed}: {}", drive.metres());
        assert_eq!(u_turns(matcher.network(), &drive), 0);
    }
}

/// Two kilometres of ordinary streets without a position.
#[test]
fn a_gap_is_bridged_on_the_road() {
    let matcher = Matcher::new(city(40, 5, 100.0, |_, _| false));
    for seed in 0..8 {
        let mut points = along(&[(130.0, 200.0), (3850.0, 200.0)], 15.0, 5.0, seed);
        points.retain(|point| !(800.0..2800.0).contains(&(130.0 + 15.0 * point.time)));
        let drive = matched(&matcher, &points);
        assert!(drive.route().iter().all(|stretch| stretch.edge.is_some()), "{:?}", drive.route());
        assert!((drive.metres() - 3710.0).abs() < 40.0, "{seed}: {}", drive.metres());
    }
}

/// Up to an hour at a kerb, and at a junction. An offset of two deviations that comes and goes looks
/// like a crawl there and back: of 200 drives each, a third had a U-turn (a half at a junction with
/// a point every 15 s); the most were 4 U-turns and 233 m. Bounds are a third higher.
#[test]
fn standing_adds_little() {
    let network = city(10, 10, 100.0, |_, _| false);
    let matcher = Matcher::new(network);
    let mut rng = rng(7);
    for place in [at(350.0, 400.0), at(400.0, 400.0), at(405.0, 400.0)] {
        for seconds in [1.0, 15.0] {
            let points = standing(place, 300, [8.0, seconds], &mut rng);
            let drive = matched(&matcher, &points);
            let turns = u_turns(matcher.network(), &drive);
            assert!(turns <= 5, "{place:?} {seconds}: {:?}", drive.route());
            assert!(drive.metres() < 310.0, "{place:?} {seconds}: {}", drive.metres());
        }
    }
}

/// A stop of ten minutes does not make a drive longer.
#[test]
fn a_stop_on_the_way_adds_nothing() {
    let matcher = Matcher::new(city(20, 6, 100.0, |_, _| false));
    let mut points = along(&[(120.0, 200.0), (950.0, 200.0)], 12.0, 6.0, 1);
    let mut rng = rng(3);
    let start = points.last().unwrap().time + 1.0;
    for mut point in standing(at(955.0, 200.0), 600, [6.0, 1.0], &mut rng) {
        point.time += start;
        points.push(point);
    }
    for mut point in along(&[(960.0, 200.0), (1750.0, 200.0)], 12.0, 6.0, 2) {
        point.time += start + 600.0;
        points.push(point);
    }
    let drive = matched(&matcher, &points);
    assert_eq!(u_turns(matcher.network(), &drive), 0, "{:?}", drive.route());
    assert!((drive.metres() - 1630.0).abs() < 50.0, "{}", drive.metres());
}

/// Back to the start of a long one-way street by the way around the block.
#[test]
fn around_the_block() {
    let mut builder = NetworkBuilder::new();
    for (n, (x, y)) in
        [(0.0, 0.0), (400.0, 0.0), (400.0, 150.0), (0.0, 150.0)].into_iter().enumerate()
    {
        builder.node(n as u64, at(x, y)).unwrap();
    }
    for n in 0..4 {
        builder.one_way(n, (n + 1) % 4, RoadClass::Street).unwrap();
    }
    let network = builder.build().unwrap();
    let first = network.edge_between(0, 1).unwrap();
    let matcher = Matcher::new(network);
    // At 300 m, and 70 s later at 100 m of the same edge: 900 m on.
    let points = [(0.0, 280.0), (2.0, 300.0), (72.0, 100.0), (74.0, 120.0)]
        .map(|(time, x)| TracePoint::new(time, at(x, 1.0)));
    let drive = matched(&matcher, &points);
    assert_eq!(edges(&drive).len(), 5, "{:?}", drive.route());
    assert_eq!(drive.route()[0].edge, Some(first));
    assert!((drive.metres() - 940.0).abs() < 10.0, "{}", drive.metres());
}
