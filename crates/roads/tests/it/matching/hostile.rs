//! Settings, points and bytes that nobody should pass, but somebody will.

use wayfix::map::{PlanePosition, RoadClass};
#[cfg(feature = "serde")]
use wayfix_roads::matching::Vehicle;
use wayfix_roads::matching::{MatchError, MatchModel, Matcher, TracePoint};
use wayfix_roads::{EdgeOptions, NetworkBuilder};

use super::city::{Network, Point, at, city};

fn town() -> Matcher<PlanePosition> {
    Matcher::new(city(4, 4, 100.0, |_, _| false))
}

/// East along the lowest street.
fn points() -> Vec<Point> {
    (0..6).map(f64::from).map(|k| TracePoint::new(5.0 * k, at(20.0 + 50.0 * k, 2.0))).collect()
}

#[test]
fn any_lag_and_any_number_of_routes() {
    let (matcher, points) = (town(), points());
    let mut vehicle = matcher.start(&points[0], usize::MAX).unwrap();
    for point in &points[1..] {
        vehicle.step(&matcher, point).unwrap();
    }
    assert_eq!(vehicle.points_late(), 5);
    let drive = matcher.match_drive(&points[..2]).unwrap();
    assert!(matcher.routes(&drive, 0).unwrap().routes.is_empty());
    let all = matcher.routes(&drive, usize::MAX).unwrap();
    let few = matcher.routes(&drive, 1).unwrap();
    assert_eq!(all.routes[0], few.routes[0]);
}

#[test]
fn drives_and_vehicles_of_another_network() {
    let large = town();
    let small = Matcher::new(city(2, 1, 100.0, |_, _| false));
    let points = points();
    let drive = large.match_drive(&points).unwrap();
    let result = small.routes(&drive, 2);
    assert!(matches!(result, Err(MatchError::Network { .. })));
    let mut vehicle = large.start(&points[5], 2).unwrap();
    let edge = vehicle.live().edge.unwrap();
    assert!(edge >= small.network().edges().len());
    for result in [vehicle.credible(&small, 0.9), drive.credible(&small, 5, 0.9)] {
        assert!(matches!(result, Err(MatchError::Network { .. })));
    }
    let result = vehicle.step(&small, &TracePoint { time: 99.0, ..points[5] });
    assert!(matches!(result, Err(MatchError::Network { .. })));
}

#[test]
fn next_to_no_outliers() {
    let mut points = points();
    points[3].position = at(150.0, 900.0);
    for outliers in [5e-324, 1e-320, 1e-300, 1e-12, 1.0 - f64::EPSILON / 2.0] {
        let model = MatchModel { outliers, ..MatchModel::default() };
        let matcher = town().with_model(model).unwrap();
        let drive = matcher.match_drive(&points).unwrap();
        assert!(drive.log_likelihood().is_finite(), "{outliers}");
        let fitted = matcher.learn(&[&points], 3).unwrap();
        assert!(fitted.log_likelihood.is_finite(), "{outliers}");
        matcher.with_model(fitted.model).unwrap();
    }
}

/// A position so far off that its density, also under poor reception or as an outlier, is 0 as a
/// double.
#[test]
fn densities_below_doubles() {
    for x in [1e4, 1e6, 1e8] {
        let mut points = points();
        points[3] = TracePoint { accuracy: Some(1e-3), ..points[3] };
        points[4].position = at(x, -x);
        for value in [5e-324, 1e-300, 0.2] {
            for model in [
                MatchModel { poor: value, ..MatchModel::default() },
                MatchModel { outliers: value, ..MatchModel::default() },
                MatchModel { poor: value, outliers: 5e-324, noise: 1e-6, ..MatchModel::default() },
            ] {
                let matcher = town().with_model(model).unwrap();
                let drive = matcher.match_drive(&points).unwrap();
                assert!(drive.log_likelihood().is_finite(), "{x} {model:?}");
            }
        }
    }
}

/// Rates of leaving the road and coming back at the limits of their ranges, between points that are
/// a moment or a day apart.
#[test]
fn rates_off_the_road_near_0_and_1() {
    let ends = [f64::from_bits(1), 1e-300, 0.5, 1.0 - f64::EPSILON / 2.0];
    for (leave_road, return_to_road) in ends.into_iter().flat_map(|a| ends.map(|b| (a, b))) {
        let model = MatchModel { leave_road, return_to_road, ..MatchModel::default() };
        let matcher = town().with_model(model).unwrap();
        for seconds in [1e-300, 1e-6, 1.0, 86_400.0] {
            let mut points = points();
            points.iter_mut().enumerate().for_each(|(k, point)| point.time = k as f64 * seconds);
            points[3].position = at(150.0, 900.0);
            let case = format!("{leave_road} {return_to_road} {seconds}");
            let Ok(drive) = matcher.match_drive(&points) else { continue };
            assert!(drive.log_likelihood().is_finite(), "{case}");
            let mut vehicle = matcher.start(&points[0], 2).unwrap();
            for point in &points[1..] {
                vehicle.step(&matcher, point).unwrap();
                assert!(vehicle.log_likelihood().is_finite(), "{case}");
            }
            let fitted = matcher.learn(&[&points], 2).unwrap();
            assert!(fitted.log_likelihood.is_finite(), "{case}");
            matcher.clone().with_model(fitted.model).unwrap();
        }
    }
}

#[test]
fn a_point_a_thousand_kilometres_off() {
    let matcher = town();
    let good = points();
    let mut points = good.clone();
    points[3].position = at(1e6, -3e5);
    let drive = matcher.match_drive(&points).unwrap();
    let expected = matcher.match_drive(&good).unwrap();
    for point in [0, 1, 2, 4, 5] {
        assert_eq!(drive.smoothed(point).edge, expected.smoothed(point).edge, "{point}");
    }
    assert!((drive.metres() - expected.metres()).abs() < 1.0);
    // Far less probable, which a caller can see.
    assert!(drive.log_normalizer(3) < expected.log_normalizer(3) - 3.0);
}

#[test]
fn lengths_and_speeds_of_networks_are_bounded() {
    let two = || {
        let mut builder = NetworkBuilder::new();
        for id in 0..3 {
            builder.node(id, at(id as f64, 0.0)).unwrap();
        }
        builder
    };
    let options = EdgeOptions::of(RoadClass::Main);
    for metres in [1.1e12, 1e308, f64::INFINITY] {
        let error = two().edge(0, 1, options.clone().with_metres(metres));
        assert!(
            error.unwrap_err().to_string().ends_with("expected metres above 0 and at most 1e12")
        );
    }
    for speed in [0.0, -1.0, f64::NAN, 1e10] {
        let error = two().edge(0, 1, options.clone().with_speed(speed));
        assert_eq!(
            error.unwrap_err().to_string(),
            format!(
                "the road from place 0 to place 1 has speed {speed}, expected metres per second \
                 above 0 and at most 1e9"
            )
        );
    }
    // Two allowed lengths have an allowed sum.
    let mut builder = two();
    for (from, to) in [(0, 1), (1, 2)] {
        let metres = Some(1e12);
        builder.edge(from, to, options.clone().with_metres(metres)).unwrap();
    }
    let (network, _): (Network, _) = builder.build().unwrap().contracted();
    assert_eq!(network.edges()[0].metres, 2e12);
}

#[test]
#[should_panic(expected = "edges 0 and 1 are not opposite")]
fn only_opposite_edges_are_pairs() {
    let mut builder = NetworkBuilder::new();
    for id in 0..3 {
        builder.node(id, at(id as f64, 0.0)).unwrap();
    }
    builder.one_way(0, 1, RoadClass::Main).unwrap();
    builder.one_way(1, 2, RoadClass::Main).unwrap();
    builder.pair(0, 1);
}

/// Pointers to all numbers of a stored vehicle.
#[cfg(feature = "serde")]
fn leaves(value: &serde_json::Value, at: &str, found: &mut Vec<String>) {
    use serde_json::Value;
    match value {
        Value::Array(values) => {
            for (number, value) in values.iter().enumerate() {
                leaves(value, &format!("{at}/{number}"), found);
            }
        }
        Value::Object(fields) => {
            for (name, value) in fields {
                leaves(value, &format!("{at}/{name}"), found);
            }
        }
        _ => found.push(at.to_owned()),
    }
}

/// Checks that a vehicle whose stored numbers were changed gives sane answers.
#[cfg(feature = "serde")]
fn check_sane(mut vehicle: Vehicle<PlanePosition>, matcher: &Matcher<PlanePosition>, case: &str) {
    for point in &points()[2..] {
        for answer in [vehicle.live(), vehicle.late()] {
            let numbers = [answer.probability, answer.off_road, answer.entropy];
            let sane = numbers.iter().all(|number| (-1e-9..10.0).contains(number));
            assert!(sane && answer.metres_along >= 0.0, "{case}: {answer:?}");
        }
        let logs = [vehicle.log_likelihood(), vehicle.log_normalizer()];
        assert!(logs.iter().all(|log| log.is_finite()), "{case}: {logs:?}");
        let around = vehicle.credible(matcher, 0.5);
        let around = around.as_ref().map_or(&[][..], |around| &around.stretches);
        for part in around {
            assert!(part.enter <= part.exit, "{case}: {part:?}");
        }
        let _ = vehicle.step(matcher, point);
    }
}

#[cfg(feature = "serde")]
#[test]
fn vehicles_of_any_numbers_give_sane_answers() {
    use serde::Deserialize;
    use serde_json::{Value, json};
    let (matcher, points) = (town(), points());
    let mut vehicle = matcher.start(&points[0], 2).unwrap();
    vehicle.step(&matcher, &points[1]).unwrap();
    let mut stored = serde_json::to_value(&vehicle).unwrap();
    let special = [0.0, -0.0, -1.0, 1e300, -1e300].map(|value| json!(value));
    let whole = [1, 2, u64::MAX, u64::MAX - 1].map(|value| json!(value));
    let values: Vec<Value> = special.into_iter().chain(whole).chain([Value::Null]).collect();
    let mut all = Vec::new();
    leaves(&stored, "", &mut all);
    let mut accepted = 0;
    for at in all {
        for value in &values {
            let before = std::mem::replace(stored.pointer_mut(&at).unwrap(), value.clone());
            if let Ok(vehicle) = Vehicle::deserialize(&stored) {
                accepted += 1;
                check_sane(vehicle, &matcher, &format!("{at} {value}"));
            }
            *stored.pointer_mut(&at).unwrap() = before;
        }
    }
    assert!(accepted > 100, "{accepted}");

    // NaN and infinities, anywhere in a compact format.
    let bytes = postcard::to_stdvec(&vehicle).unwrap();
    for at in 0..bytes.len() - 8 {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut damaged = bytes.clone();
            damaged[at..at + 8].copy_from_slice(&value.to_le_bytes());
            if let Ok(vehicle) = postcard::from_bytes(&damaged) {
                check_sane(vehicle, &matcher, &format!("byte {at}: {value}"));
            }
        }
    }
}

#[cfg(feature = "serde")]
#[test]
fn stored_vehicles_without_distributions_are_refused() {
    use serde::Deserialize;
    use serde_json::json;
    let (matcher, points) = (town(), points());
    let mut vehicle = matcher.start(&points[0], 0).unwrap();
    vehicle.step(&matcher, &points[1]).unwrap();
    let stored = serde_json::to_value(&vehicle).unwrap();
    // Covariances of the first state's place along and of its error to the east, by rows of the
    // upper triangle, each in three receptions.
    let place = |field: &str| format!("/window/0/0/state/place/{field}");
    let [along, with_east, east] = [0, 1, 3].map(|part| place(&format!("covariance/{part}/0")));
    let share = place("shares/0");
    let last = format!("/log_filtered/{}", stored["log_filtered"].as_array().unwrap().len() - 1);
    let number = |at: &str| stored.pointer(at).unwrap().as_f64().unwrap();
    let most = (number(&along) * number(&east)).sqrt();
    assert!(number(&with_east).abs() <= most);

    let cases = [
        (&share, number(&share) + 1e-6, "the sum of probabilities"),
        (&share, 0.0, "the sum of probabilities"),
        (&share, -number(&share), "the probability -0."),
        (&along, -1e-9, "the variance -"),
        (&with_east, 1.001 * most, "the covariance"),
        (&with_east, -1.001 * most, "the covariance"),
        (&east, 0.0, "the covariance"),
        (&last, number(&last) + 0.1, "probabilities sum to"),
    ];
    for (at, value, expected) in cases {
        let mut stored = stored.clone();
        *stored.pointer_mut(at).unwrap() = json!(value);
        let error = Vehicle::<PlanePosition>::deserialize(&stored).unwrap_err().to_string();
        assert!(error.contains(expected), "{at} {value}: {error}");
    }
    let mut other = stored.clone();
    other["log_filtered"].as_array_mut().unwrap().pop();
    let error = Vehicle::<PlanePosition>::deserialize(&other).unwrap_err().to_string();
    assert!(error.contains("probabilities for"), "{error}");
}
