//! Live answers against those of whole drives.

use proptest::prelude::*;
use wayfix::error::OutOfRange;
use wayfix_roads::matching::{MatchError, Matcher, RoadAnswer, TracePoint};

use super::city::{Scenario, at, city, points};
use crate::kit::cases_of;

fn bits(answer: &RoadAnswer) -> (Option<usize>, [u64; 4]) {
    let RoadAnswer { edge, metres_along, probability, entropy, off_road } = *answer;
    (edge, [metres_along, probability, entropy, off_road].map(f64::to_bits))
}

pub(crate) fn is_near(a: &RoadAnswer, b: &RoadAnswer) -> bool {
    let close = |x: f64, y: f64| (x - y).abs() <= 1e-9;
    // If two edges are equally probable, either may be named.
    let same = a.edge == b.edge && close(a.metres_along, b.metres_along);
    (same || a.probability < 0.5 + 1e-9)
        && close(a.probability, b.probability)
        && close(a.entropy, b.entropy)
        && close(a.off_road, b.off_road)
}

proptest! {
    #![proptest_config(cases_of(150))]

    #[test]
    fn live_and_late_equal_those_of_the_drive(
        seed in any::<u64>(), lag in 0..6_usize, seconds in 0.5..20.0, sigma in 1.0..30.0,
        outliers in 0.0..0.3, told in any::<bool>(),
    ) {
        let network = city(8, 8, 120.0, |_, _| false);
        let scenario = Scenario { noise: sigma, every: seconds, outliers, ..Scenario::default() };
        let mut points = points(&network, &scenario, 40, seed);
        if told {
            for (number, point) in points.iter_mut().enumerate() {
                point.speed = (number % 3 > 0).then_some(10.0);
                point.heading = (number % 4 > 0).then_some(90.0 * (number / 10) as f64);
                point.accuracy = (number % 5 > 0).then_some(sigma);
            }
        }
        let matcher = Matcher::new(network);
        let whole = matcher.match_drive(&points).unwrap();
        let mut vehicle = matcher.start(&points[0], lag).unwrap();
        for (number, point) in points.iter().enumerate() {
            if number > 0 {
                let log = vehicle.step(&matcher, point).unwrap();
                prop_assert_eq!(log, vehicle.log_normalizer());
            }
            prop_assert_eq!(vehicle.points(), number + 1);
            prop_assert_eq!(vehicle.last_point(), point);
            prop_assert_eq!(bits(&vehicle.live()), bits(&whole.live(number)));
            prop_assert_eq!(vehicle.log_normalizer(), whole.log_normalizer(number));
            // The rounded filtered distribution stands for everything before the window.
            let behind = vehicle.points_late();
            prop_assert_eq!(behind, lag.min(number));
            let (late, expected) = (vehicle.late(), whole.late(number - behind, behind));
            prop_assert!(is_near(&late, &expected), "{late:?}, expected {expected:?}");
            let edges = vehicle.edges();
            let sum: f64 = edges.iter().map(|edge| edge.1).sum();
            prop_assert!((sum + vehicle.live().off_road - 1.0).abs() < 1e-12, "{sum}");
            prop_assert!(edges.windows(2).all(|pair| pair[0].1 >= pair[1].1));
            let mut distinct: Vec<_> = edges.iter().map(|edge| edge.0).collect();
            distinct.sort_unstable();
            distinct.dedup();
            prop_assert_eq!(distinct.len(), edges.len());
        }
        prop_assert_eq!(vehicle.log_likelihood(), whole.log_likelihood());
        // At the end, filter and smoother agree.
        let last = points.len() - 1;
        prop_assert!(is_near(&whole.live(last), &whole.smoothed(last)));
        for number in 0..points.len() {
            prop_assert!(is_near(&whole.late(number, 0), &whole.live(number)));
            prop_assert!(is_near(&whole.late(number, usize::MAX), &whole.smoothed(number)));
        }
        // Other scratch memory changes nothing.
        let again = matcher.match_drive(&points).unwrap();
        prop_assert_eq!(again.route(), whole.route());
        prop_assert_eq!(again.log_likelihood(), whole.log_likelihood());
    }
}

#[test]
fn errors_leave_the_vehicle_as_it_was() {
    let network = city(4, 4, 100.0, |_, _| false);
    let matcher = Matcher::new(network);
    let good = |time: f64| TracePoint::new(time, at(12.0 * time, 3.0));
    let mut vehicle = matcher.start(&good(0.0), 3).unwrap();
    (1..6).for_each(|time| {
        vehicle.step(&matcher, &good(f64::from(time))).unwrap();
    });
    let before = vehicle.clone();
    let next = good(6.0);
    let bad = [
        ("x", TracePoint { position: at(f64::NAN, 0.0), ..next }),
        ("y", TracePoint { position: at(0.0, 2e9), ..next }),
        ("time", TracePoint { time: f64::NAN, ..next }),
        ("time", TracePoint { time: f64::INFINITY, ..next }),
        ("accuracy", TracePoint { accuracy: Some(0.0), ..next }),
        ("accuracy", TracePoint { accuracy: Some(-1.0), ..next }),
        ("accuracy", TracePoint { accuracy: Some(f64::NAN), ..next }),
        ("accuracy", TracePoint { accuracy: Some(f64::INFINITY), ..next }),
        // A noise so small that densities overflow.
        ("accuracy", TracePoint { accuracy: Some(1e-320), ..next }),
        ("heading", TracePoint { heading: Some(f64::NAN), ..next }),
        ("heading", TracePoint { heading: Some(-180.5), ..next }),
        ("heading", TracePoint { heading: Some(360.5), ..next }),
        ("speed", TracePoint { speed: Some(-1.0), ..next }),
        ("speed", TracePoint { speed: Some(f64::INFINITY), ..next }),
    ];
    for (name, point) in bad {
        match vehicle.step(&matcher, &point) {
            Err(MatchError::Point { point: 6, what, .. }) => assert_eq!(what, name),
            other => panic!("{name}: {other:?}"),
        }
        assert_eq!(vehicle, before, "{name}");
        if name != "time" {
            assert!(matcher.start(&point, 0).is_err());
        }
        let drive = [good(5.0), point];
        assert!(matches!(
            matcher.match_drive(&drive),
            Err(MatchError::Point { point: 1, what, .. }) if what == name
        ));
    }
    for time in [5.0, 4.0, -1e9] {
        let error = vehicle.step(&matcher, &TracePoint { time, ..next }).unwrap_err();
        assert!(matches!(error, MatchError::Time { point: 6, time: t, before: 5.0 } if t == time));
        assert!(error.to_string().contains(&format!("{time}")) && error.to_string().contains('5'));
        assert_eq!(vehicle, before);
        let drive = [good(0.0), good(5.0), TracePoint { time, ..next }];
        let result = matcher.match_drive(&drive);
        assert!(
            matches!(result, Err(MatchError::Time { point: 2, time: t, before: 5.0 }) if t == time)
        );
    }
    assert!(matches!(matcher.match_drive(&[]), Err(MatchError::Empty)));

    // It continues as if it had never seen them.
    let mut other = before;
    let found = vehicle.step(&matcher, &next).unwrap();
    assert_eq!(found, other.step(&matcher, &next).unwrap());
    assert_eq!(vehicle, other);

    // A vehicle of a different network.
    let small = Matcher::new(city(2, 1, 100.0, |_, _| false));
    let state = vehicle.clone();
    let result = vehicle.step(&small, &good(7.0));
    assert!(matches!(result, Err(MatchError::Network { .. })));
    assert_eq!(vehicle, state);
}

#[test]
fn parameters_out_of_range() {
    let matcher = Matcher::new(city(2, 1, 100.0, |_, _| false));
    let good = *matcher.model();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
        let model = wayfix_roads::matching::MatchModel { noise: bad, ..good };
        let result = matcher.clone().with_model(model);
        assert!(
            matches!(result, Err(MatchError::Parameter(OutOfRange { what, .. })) if what == "the parameter noise"),
            "{bad}"
        );
    }
    for bad in [0.0, 1.0, -0.5, f64::NAN] {
        let models = [
            ("outliers", wayfix_roads::matching::MatchModel { outliers: bad, ..good }),
            ("stop", wayfix_roads::matching::MatchModel { stop: bad, ..good }),
            ("leave_road", wayfix_roads::matching::MatchModel { leave_road: bad, ..good }),
            ("return_to_road", wayfix_roads::matching::MatchModel { return_to_road: bad, ..good }),
            ("u_turn", wayfix_roads::matching::MatchModel { u_turn: bad, ..good }),
        ];
        for (name, model) in models {
            let result = matcher.clone().with_model(model);
            assert!(
                matches!(result, Err(MatchError::Parameter(OutOfRange { what, .. })) if what == format!("the parameter {name}"))
            );
        }
    }
}
