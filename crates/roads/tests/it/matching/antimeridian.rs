//! Roads and drives across the antimeridian: the same answers as elsewhere.

use wayfix::Likelihood;
use wayfix::likelihood::{LocalLikelihood, Scratch};
use wayfix::map::{Position, RoadClass};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{PositionFix, PositionLikelihood};
use wayfix_roads::matching::{Matcher, RoadAnswer, TracePoint};
use wayfix_roads::{EdgeIndex, EdgeOptions, NetworkBuilder, RoadNetwork};

/// Degrees by which the same city is moved to the west, far from the antimeridian.
const WEST: f64 = 10.0;

/// A position this many degrees east of 179.996 or, shifted, 10° to the west of that.
fn at(latitude: f64, east: f64, west: f64) -> Position {
    let longitude = 179.996 + east - west;
    let longitude = if longitude > 180.0 { longitude - 360.0 } else { longitude };
    Position { latitude, longitude }
}

/// A grid of streets with bends; unshifted, the four that run east cross the antimeridian.
fn city(west: f64) -> RoadNetwork {
    let mut builder = NetworkBuilder::new();
    let square = |id: u64| ((id / 5) as f64, (id % 5) as f64);
    for id in 0..20 {
        let (row, column) = square(id);
        builder.node(id, at(-17.0 - 1e-3 * row, 2.1e-3 * column, west)).unwrap();
    }
    for id in 0..20 {
        if id % 5 < 4 {
            let (row, column) = square(id);
            let bend = |share: f64, south: f64| {
                at(-17.0 - 1e-3 * row - south, 2.1e-3 * (column + share), west)
            };
            let between = vec![bend(0.3, 1e-4), bend(0.8, -1e-4)];
            let mut options = EdgeOptions::of(RoadClass::Street).with_between(between);
            let there = builder.edge(id, id + 1, options.clone()).unwrap();
            options.between.reverse();
            let back = builder.edge(id + 1, id, options).unwrap();
            builder.pair(there, back);
        }
        if id < 15 {
            builder.both_ways(id, id + 5, RoadClass::Collector).unwrap();
        }
    }
    builder.build().unwrap()
}

/// East along the second street, half way north to the first, and back west on it.
fn drive(west: f64) -> Vec<TracePoint> {
    let wave = |k: i32| 6e-5 * f64::from(k * 7 % 5 - 2);
    let point = |k: i32| {
        let (east, row) =
            if k < 18 { (4e-4 * f64::from(k), 1.0) } else { (4e-4 * f64::from(34 - k), 0.0) };
        let position = at(-17.0 - 1e-3 * row + wave(k), east + wave(k + 3), west);
        TracePoint::new(5.0 * f64::from(k), position)
    };
    (0..34).map(point).collect()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} and {b}");
}

fn same(a: &RoadAnswer, b: &RoadAnswer) {
    assert_eq!(a.edge, b.edge);
    close(a.probability, b.probability, 1e-9);
    close(a.off_road, b.off_road, 1e-9);
    close(a.metres_along, b.metres_along, 1e-6);
}

#[test]
fn a_drive_across_is_matched_as_elsewhere() {
    let [here, there] = [0.0, WEST].map(|west| Matcher::new(city(west)));
    let [points, shifted] = [0.0, WEST].map(drive);
    assert!(points.iter().any(|point| point.position.longitude < 0.0));
    let [a, b] = [here.match_drive(&points), there.match_drive(&shifted)].map(Result::unwrap);
    close(a.log_likelihood(), b.log_likelihood(), 1e-6);
    for point in 0..points.len() {
        same(&a.live(point), &b.live(point));
        same(&a.late(point, 3), &b.late(point, 3));
        same(&a.smoothed(point), &b.smoothed(point));
        assert_eq!(a.edges(point).len(), b.edges(point).len());
    }
    // Both streets from one side to the other.
    let crosses = |longitudes: [f64; 2]| longitudes[0].signum() != longitudes[1].signum();
    let on_route = a.route().iter().filter(|stretch| crosses(stretch.ends.map(|p| p.longitude)));
    assert_eq!(on_route.count(), 2);
    assert_eq!(a.route().len(), b.route().len());
    for (a_part, b_part) in a.route().iter().zip(b.route()) {
        assert_eq!(a_part.edge, b_part.edge);
        close(a_part.metres(), b_part.metres(), 1e-6);
        let lines = here.line(a_part).into_iter().zip(there.line(b_part));
        for (at, shifted) in lines.chain(a_part.ends.into_iter().zip(b_part.ends)) {
            assert!((-180.0..=180.0).contains(&at.longitude), "{at:?}");
            let west = (at.longitude + 360.0 - WEST) % 360.0;
            close(west, shifted.longitude, 1e-9);
            close(at.latitude, shifted.latitude, 1e-9);
        }
    }
    let [mut live, mut moved] =
        [(&here, &points), (&there, &shifted)].map(|(m, points)| m.start(&points[0], 3).unwrap());
    for (point, other) in points.iter().zip(&shifted).skip(1) {
        let logs = [live.step(&here, point).unwrap(), moved.step(&there, other).unwrap()];
        close(logs[0], logs[1], 1e-6);
        same(&live.live(), &moved.live());
        same(&live.late(), &moved.late());
    }
}

/// A gap, distant points and a stretch without roads, so that states continue unseen and off the
/// road.
#[test]
fn states_that_go_on_unseen_cross() {
    let [here, there] = [0.0, WEST].map(|west| Matcher::new(city(west)));
    let far = |west: f64| {
        let mut points = drive(west);
        for (number, point) in points.iter_mut().enumerate() {
            if (6..14).contains(&number) {
                point.position.latitude -= 6e-3;
            }
        }
        points.drain(22..28);
        points
    };
    let [points, shifted] = [0.0, WEST].map(far);
    let [a, b] = [here.match_drive(&points), there.match_drive(&shifted)].map(Result::unwrap);
    for point in 0..points.len() {
        same(&a.live(point), &b.live(point));
        same(&a.smoothed(point), &b.smoothed(point));
    }
    assert!((0..points.len()).any(|point| a.smoothed(point).off_road > 0.5));
}

#[test]
fn the_index_finds_edges_from_both_sides() {
    let [here, there] = [0.0, WEST].map(city);
    let [index, other] = [&here, &there].map(EdgeIndex::new);
    let (mut near, mut expected) = (Vec::new(), Vec::new());
    for step in 0..400 {
        let (row, column) = (f64::from(step / 20), f64::from(step % 20));
        let [p, q] = [0.0, WEST].map(|west| at(-17.004 + 3e-4 * row, 6e-4 * column - 1e-3, west));
        for metres in [30.0, 300.0, 5e6] {
            index.near(&here, p, metres, &mut near);
            other.near(&there, q, metres, &mut expected);
            assert_eq!(near.len(), expected.len());
            for (a, b) in near.iter().zip(&expected) {
                assert_eq!(a.edge, b.edge);
                close(a.metres_off, b.metres_off, 1e-6);
                close(a.metres_along, b.metres_along, 1e-6);
                let place = a.position(&here);
                assert!((-180.0..=180.0).contains(&place.longitude), "{place:?}");
                close(place.metres_to(p), a.metres_off, 1e-3 * a.metres_off + 1e-6);
                let again = here.project(a.edge, p);
                close(again.metres_off, a.metres_off, 1e-6);
                close(here.position_along(a.edge, a.metres_along).metres_to(place), 0.0, 1e-3);
            }
        }
        let nearest = [index.nearest(&here, p), other.nearest(&there, q)].map(Option::unwrap);
        close(nearest[0].metres_off, nearest[1].metres_off, 1e-6);
    }
    // From far off, on either side.
    for longitude in [100.0, 179.0, 180.0, -180.0, -179.0, -100.0] {
        let p = Position { latitude: -17.0, longitude };
        let off = index.nearest(&here, p).unwrap().metres_off;
        let nodes = here.nodes().iter().map(|node| node.position.metres_to(p));
        let node = nodes.fold(f64::INFINITY, f64::min);
        assert!(off <= 1.1 * node && off >= 0.9 * node - 500.0, "{longitude}: {off} {node}");
    }
}

#[test]
fn networks_across_are_cleaned() {
    for west in [0.0, WEST] {
        let network = city(west).contracted().0;
        let (merged, _) = network.merged(250.0).unwrap();
        for node in merged.nodes() {
            let Position { longitude, .. } = node.position;
            assert!((-180.0..=180.0).contains(&longitude));
            let off = network.nodes().iter().map(|n| n.position.metres_to(node.position));
            assert!(off.fold(f64::INFINITY, f64::min) < 500.0);
        }
        assert!(merged.edges().iter().all(|edge| edge.metres < 2000.0));
    }
}

#[test]
fn positions_on_cells_across() {
    let [here, there] = [0.0, WEST].map(|west| RoadCells::new(city(west), 20.0).unwrap());
    let [a, b] = [&here, &there].map(PositionLikelihood::new);
    let [mut scratch, mut other] = [Scratch::default(), Scratch::default()];
    for east in [2e-3, 3.9e-3, 4.1e-3, 6e-3] {
        let [p, q] = [0.0, WEST].map(|west| PositionFix::new(at(-17.0008, east, west), 15.0));
        let [one, two] = [a.diagonal(&p, &mut scratch), b.diagonal(&q, &mut other)];
        let [one, two] = [one.unwrap(), two.unwrap()];
        close(one.log_factor(), two.log_factor(), 1e-9);
        one.as_slice().iter().zip(two.as_slice()).for_each(|(a, b)| close(*a, *b, 1e-6));
        let (mut near, mut expected) = (Vec::new(), Vec::new());
        a.listed_states(&p, &mut near);
        b.listed_states(&q, &mut expected);
        for states in [&mut near, &mut expected] {
            let count = states.len();
            states.sort_unstable();
            states.dedup();
            assert_eq!(states.len(), count);
        }
        assert!(near.len() > 20);
        let [first, second] = [&near, &expected].map(|s| *s.iter().max().unwrap());
        assert!(first.abs_diff(second) < 50);
    }
}
