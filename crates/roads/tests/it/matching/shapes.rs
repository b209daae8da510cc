//! Positions along lines.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{Position, RoadClass};
use wayfix_roads::{EdgeOptions, NetworkBuilder, RoadNetwork};

use super::city::{Network, at};
use crate::kit::cases;

fn of_line(points: &[(f64, f64)], metres: Option<f64>) -> Network {
    let mut builder = NetworkBuilder::new();
    let all: Vec<_> = points.iter().map(|&(x, y)| at(x, y)).collect();
    builder.node(0, all[0]).unwrap();
    builder.node(1, all[all.len() - 1]).unwrap();
    let between = all[1..all.len() - 1].to_vec();
    let options = EdgeOptions::of(RoadClass::Street).with_metres(metres).with_between(between);
    builder.edge(0, 1, options).unwrap();
    builder.build().unwrap()
}

proptest! {
    #![proptest_config(cases())]

    /// Lines that always lead east do not cross themselves.
    #[test]
    fn projection_and_position_are_inverse(
        steps in vec((1.0..50.0, -200.0..200.0), 1..8), metres in proptest::option::of(1.0..5000.0),
        shares in vec(0.0..=1.0, 5),
    ) {
        let mut x = 0.0;
        let mut points = vec![(0.0, 0.0)];
        steps.iter().for_each(|&(dx, y)| {
            x += dx;
            points.push((x, y));
        });
        let network = of_line(&points, metres);
        let length = network.edges()[0].metres;
        for share in shares {
            let along = share * length;
            let position = network.position_along(0, along);
            let found = network.project(0, position);
            prop_assert!(found.metres_off < 1e-9, "{found:?}");
            prop_assert!((found.metres_along - along).abs() < 1e-9 * length.max(1.0), "{found:?} {along}");
            prop_assert!((0.0..=length).contains(&found.metres_along));
            prop_assert!(found.position(&network).metres_to(position) < 1e-9);
        }
    }

    /// The projection is the nearest of many points of the line, on lines that cross themselves.
    #[test]
    fn projection_is_nearest(
        points in vec((0.0..100.0, 0.0..100.0), 2..8), x in -50.0..150.0, y in -50.0..150.0,
    ) {
        let network = of_line(&points, None);
        let (position, length) = (at(x, y), network.edges()[0].metres);
        let found = network.project(0, position);
        prop_assert!((found.position(&network).metres_to(position) - found.metres_off).abs() < 1e-9);
        let along = network.position_along(0, found.metres_along);
        prop_assert!(along.metres_to(found.position(&network)) < 1e-7);
        let samples = (0..=2000).map(|i| network.position_along(0, length * f64::from(i) / 2000.0));
        let nearest = samples.map(|p| p.metres_to(position)).fold(f64::INFINITY, f64::min);
        prop_assert!(found.metres_off <= nearest + 1e-9);
        prop_assert!(found.metres_off >= nearest - length / 2000.0);
    }
}

#[test]
fn ends_and_headings() {
    let network = of_line(&[(0.0, 0.0), (0.0, 10.0), (10.0, 10.0)], Some(40.0));
    assert_eq!(network.position_along(0, -5.0), at(0.0, 0.0));
    assert_eq!(network.position_along(0, 0.0), at(0.0, 0.0));
    assert_eq!(network.position_along(0, 10.0), at(0.0, 5.0));
    assert_eq!(network.position_along(0, 40.0), at(10.0, 10.0));
    assert_eq!(network.position_along(0, 1e9), at(10.0, 10.0));
    let on_first = network.project(0, at(-3.0, 5.0));
    assert_eq!((on_first.metres_along, on_first.metres_off, on_first.heading()), (10.0, 3.0, 0.0));
    let on_second = network.project(0, at(5.0, 12.0));
    assert_eq!(on_second.heading(), std::f64::consts::FRAC_PI_2);
}

#[test]
fn repeated_points_are_no_obstacle() {
    let network = of_line(&[(0.0, 0.0), (0.0, 0.0), (10.0, 0.0), (10.0, 0.0), (20.0, 0.0)], None);
    for metres in [0.0, 5.0, 10.0, 15.0, 20.0] {
        let position = network.position_along(0, metres);
        assert_eq!(position, at(metres, 0.0));
        assert_eq!(network.project(0, position).metres_along, metres);
    }
    let point = of_line(&[(1.0, 1.0), (1.0, 1.0)], Some(7.0));
    assert_eq!(point.position_along(0, 3.0), at(1.0, 1.0));
    let found = point.project(0, at(4.0, 5.0));
    assert_eq!((found.metres_along, found.metres_off), (0.0, 5.0));
}

#[test]
fn on_earth_at_every_latitude() {
    for latitude in [0.0, -35.0, 60.0, 80.0, -85.0] {
        let mut builder: NetworkBuilder = NetworkBuilder::new();
        builder.node(0, Position { latitude, longitude: 10.0 }).unwrap();
        builder.node(1, Position { latitude, longitude: 10.01 }).unwrap();
        builder.one_way(0, 1, RoadClass::Street).unwrap();
        let network: RoadNetwork = builder.build().unwrap();
        let length = network.edges()[0].metres;
        for share in [0.0, 0.3, 1.0] {
            let position = network.position_along(0, share * length);
            let found = network.project(0, position);
            assert!((found.metres_along - share * length).abs() < 1e-6, "{found:?}");
            let north = Position { latitude: position.latitude + 1e-4, ..position };
            let off = network.project(0, north).metres_off;
            assert!((off / position.metres_to(north) - 1.0).abs() < 1e-3, "{latitude}: {off}");
        }
    }
}
