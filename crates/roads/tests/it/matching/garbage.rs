//! Any points from a receiver give answers, or a typed error.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{Coordinates, Position, RoadClass};
use wayfix_roads::matching::{MatchError, Matcher, RoadAnswer, TracePoint};
use wayfix_roads::{NetworkBuilder, RoadNetwork};

use crate::kit::cases;

/// A grid of streets near a place.
fn town(latitude: f64, longitude: f64) -> RoadNetwork {
    let mut builder = NetworkBuilder::new();
    let n = 6_u64;
    for id in 0..n * n {
        let (row, column) = ((id / n) as f64, (id % n) as f64);
        let east = column * 0.001 / latitude.to_radians().cos().max(0.01);
        let position = Position { latitude: latitude + row * 0.001, longitude: longitude + east };
        builder.node(id, position).unwrap();
    }
    for id in 0..n * n {
        if id % n + 1 < n {
            builder.both_ways(id, id + 1, RoadClass::Street).unwrap();
        }
        if id / n + 1 < n {
            if id % n == 3 {
                builder.one_way(id, id + n, RoadClass::Main).unwrap();
            } else {
                builder.both_ways(id, id + n, RoadClass::Street).unwrap();
            }
        }
    }
    builder.build().unwrap()
}

fn is_sane(answer: &RoadAnswer) {
    let RoadAnswer { edge, metres_along, probability, entropy, off_road } = *answer;
    assert!((0.0..=1.0 + 1e-9).contains(&probability), "{answer:?}");
    assert!((0.0..=1.0 + 1e-9).contains(&off_road), "{answer:?}");
    assert!(entropy.is_finite() && entropy >= -1e-9, "{answer:?}");
    assert!(metres_along.is_finite() && metres_along >= 0.0, "{answer:?}");
    assert!(edge.is_some() || probability == off_road, "{answer:?}");
}

/// Positions in the town, anywhere, at the poles and at the antimeridian.
fn position(latitude: f64, longitude: f64) -> impl Strategy<Value = Position> {
    let near = move || {
        (-0.002..0.008_f64, -0.002..0.008_f64).prop_map(move |(a, b)| Position {
            latitude: (latitude + a).clamp(-90.0, 90.0),
            longitude: (longitude + b).clamp(-180.0, 180.0),
        })
    };
    let anywhere = (-90.0..=90.0, -180.0..=180.0)
        .prop_map(|(latitude, longitude)| Position { latitude, longitude });
    let special = proptest::sample::select(
        &[
            (90.0, 0.0),
            (-90.0, 180.0),
            (90.0, -180.0),
            (0.0, 180.0),
            (0.0, -180.0),
            (-35.0, 180.0),
            (89.999_999, 10.0),
        ][..],
    )
    .prop_map(|(latitude, longitude)| Position { latitude, longitude });
    prop_oneof![6 => near(), 1 => anywhere, 1 => special]
}

fn points(latitude: f64, longitude: f64) -> impl Strategy<Value = Vec<TracePoint>> {
    let seconds = prop_oneof![6 => 0.5..60.0, 1 => Just(1e-9), 1 => Just(1e6), 1 => 1e-6..0.1];
    let accuracy = prop_oneof![
        4 => Just(None), 2 => (1.0..50.0).prop_map(Some), 1 => Just(Some(0.01)),
        1 => Just(Some(1e5)), 1 => Just(Some(1000.0))
    ];
    let heading = prop_oneof![2 => Just(None), 1 => (-180.0..=360.0).prop_map(Some)];
    let speed = prop_oneof![2 => Just(None), 2 => (0.0..40.0).prop_map(Some), 1 => (0.0..1000.0).prop_map(Some)];
    let point = (seconds, position(latitude, longitude), accuracy, heading, speed, 0..4);
    vec(point, 1..12).prop_map(|all| {
        let mut time = 0.0;
        let mut points: Vec<TracePoint> = Vec::new();
        for (seconds, position, accuracy, heading, speed, repeats) in all {
            time += seconds;
            // One in four repeats the position of the point before.
            let before = points.last().map(|point| point.position).filter(|_| repeats == 0);
            let position = before.unwrap_or(position);
            points.push(TracePoint { time, position, accuracy, heading, speed });
        }
        points
    })
}

fn check<P: Coordinates>(matcher: &Matcher<P>, points: &[TracePoint<P>]) {
    match matcher.match_drive(points) {
        Ok(drive) => {
            for number in 0..points.len() {
                is_sane(&drive.live(number));
                is_sane(&drive.late(number, 2));
                is_sane(&drive.smoothed(number));
                assert!(drive.log_normalizer(number).is_finite());
            }
            assert!(drive.log_likelihood().is_finite());
            assert!(drive.metres().is_finite() && drive.metres() >= 0.0, "{:?}", drive.route());
            for stretch in drive.route() {
                assert!(stretch.enter.is_finite() && stretch.exit.is_finite());
            }
        }
        Err(MatchError::Time { time, before, .. }) => assert!(time <= before),
        Err(MatchError::Point { what: "time", value, .. }) => assert!(value.abs() > 1e20),
        Err(other) => panic!("{other}"),
    }
    let Ok(mut vehicle) = matcher.start(&points[0], 2) else {
        assert!(points[0].time.abs() > 1e20);
        return;
    };
    is_sane(&vehicle.live());
    for point in &points[1..] {
        let before = vehicle.clone();
        match vehicle.step(matcher, point) {
            Ok(log) => assert!(log.is_finite()),
            Err(_) => assert_eq!(vehicle, before),
        }
        is_sane(&vehicle.live());
        is_sane(&vehicle.late());
        let sum: f64 = vehicle.edges().iter().map(|edge| edge.1).sum();
        assert!((sum + vehicle.live().off_road - 1.0).abs() < 1e-9);
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn answers_are_finite(
        (place, points) in proptest::sample::select(&[(-35.3, 149.1), (78.2, 15.6), (-16.8, 179.99)][..])
            .prop_flat_map(|place| (Just(place), points(place.0, place.1))),
    ) {
        let network = town(place.0, if place.1 > 179.0 { 179.99 } else { place.1 });
        check(&Matcher::new(network), &points);
    }

    #[test]
    fn learning_from_garbage_stays_in_range(points in points(-35.3, 149.1)) {
        let matcher = Matcher::new(town(-35.3, 149.1));
        if let Ok(fitted) = matcher.learn(&[&points], 3) {
            assert!(fitted.log_likelihood.is_finite());
            // An accepted network is usable.
            let matcher = matcher.with_model(fitted.model).unwrap();
            check(&matcher, &points);
        }
    }
}

#[test]
fn extreme_times() {
    let matcher = Matcher::new(town(-35.3, 149.1));
    let position = Position { latitude: -35.2995, longitude: 149.1001 };
    for (first, second) in [
        (-1e308, 1e308),
        (0.0, 1e300),
        (0.0, 5e-324),
        (1e20, 1.1e20),
        (-1e20, 1e20),
        (-f64::MAX, f64::MAX),
    ] {
        check(&matcher, &[first, second].map(|time| TracePoint::new(time, position)));
    }
}
