//! Settings, points and bytes that nobody should pass, but somebody will.

use wayfix::error::SnapshotError;
use wayfix::map::{PlanePosition, RoadClass};
use wayfix_roads::matching::{MatchError, MatchModel, Matcher, TracePoint, Vehicle};
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
        matcher.step(&mut vehicle, point).unwrap();
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
    let result = small.step(&mut vehicle, &TracePoint { time: 99.0, ..points[5] });
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
                matcher.step(&mut vehicle, point).unwrap();
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
        let error = two().edge(0, 1, EdgeOptions { metres: Some(metres), ..options.clone() });
        assert!(
            error.unwrap_err().to_string().ends_with("expected metres above 0 and at most 1e12")
        );
    }
    for speed in [0.0, -1.0, f64::NAN, 1e10] {
        let error = two().edge(0, 1, EdgeOptions { speed: Some(speed), ..options.clone() });
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
        builder.edge(from, to, EdgeOptions { metres, ..options.clone() }).unwrap();
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

/// Bytes with one word replaced, and a matching checksum.
fn with_word(bytes: &[u8], word: usize, value: u64) -> Vec<u8> {
    let mut bytes = bytes[..bytes.len() - 8].to_vec();
    bytes[8 * word..8 * word + 8].copy_from_slice(&value.to_le_bytes());
    let (words, rest) = bytes.as_chunks::<8>();
    assert!(rest.is_empty());
    let words = words.iter().map(|word| u64::from_le_bytes(*word)).chain([0]);
    let add =
        |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    let sum = words.fold(bytes.len() as u64, add);
    bytes.extend(sum.to_le_bytes());
    bytes
}

#[test]
fn vehicles_of_any_bytes_give_sane_answers() {
    let (matcher, points) = (town(), points());
    let mut vehicle = matcher.start(&points[0], 2).unwrap();
    matcher.step(&mut vehicle, &points[1]).unwrap();
    let bytes = vehicle.to_bytes();
    let special = [0.0, -0.0, -1.0, 1e300, -1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    let words = special.map(f64::to_bits).into_iter().chain([1, 2, u64::MAX, u64::MAX - 1]);
    let mut accepted = 0;
    for word in 1..bytes.len() / 8 - 1 {
        for value in words.clone() {
            let damaged = with_word(&bytes, word, value);
            let Ok(mut vehicle) = Vehicle::<PlanePosition>::from_bytes(&damaged) else { continue };
            accepted += 1;
            for point in &points[2..] {
                let answers = [vehicle.live(), vehicle.late()];
                for answer in answers {
                    let numbers = [answer.probability, answer.off_road, answer.entropy];
                    let sane = numbers.iter().all(|number| (-1e-9..10.0).contains(number));
                    assert!(
                        sane && answer.metres_along >= 0.0,
                        "word {word}, {value:x}: {answer:?}"
                    );
                }
                let logs = [vehicle.log_likelihood(), vehicle.log_normalizer()];
                assert!(logs.iter().all(|log| log.is_finite()), "word {word}, {value:x}: {logs:?}");
                let around = vehicle.credible(&matcher, 0.5);
                let around = around.as_ref().map_or(&[][..], |around| &around.stretches);
                for part in around {
                    assert!(part.enter <= part.exit, "word {word}, {value:x}: {part:?}");
                }
                let _ = matcher.step(&mut vehicle, point);
            }
        }
    }
    assert!(accepted > 100, "{accepted}");
}

#[test]
fn snapshots_of_no_distributions_are_refused() {
    /// Words of the first state on a road: its covariances (of the position along the road and the
    /// error to the east and north, by rows, each for three receptions), then the probabilities of
    /// the receptions.
    const COVARIANCES: usize = 31;
    const WITH_EAST: usize = COVARIANCES + 3;
    const EAST: usize = COVARIANCES + 3 * 3;
    const SHARES: usize = COVARIANCES + 6 * 3;
    let (matcher, points) = (town(), points());
    let mut vehicle = matcher.start(&points[0], 0).unwrap();
    matcher.step(&mut vehicle, &points[1]).unwrap();
    let bytes = vehicle.to_bytes();
    let number = |word: usize| f64::from_le_bytes(*bytes[8 * word..].first_chunk().unwrap());
    let shares = [0, 1, 2].map(|reception| number(SHARES + reception));
    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{shares:?}");
    let [along, east] = [COVARIANCES, EAST].map(number);
    let most = (along * east).sqrt();
    assert!(number(WITH_EAST).abs() <= most);

    let last = bytes.len() / 8 - 2;
    let cases = [
        (SHARES, shares[0] + 1e-6, "the sum of probabilities"),
        (SHARES, 0.0, "the sum of probabilities"),
        (SHARES, -shares[0], "the probability -0."),
        (SHARES, f64::NAN, "the probability NaN"),
        (COVARIANCES, -1e-9, "the variance -"),
        (WITH_EAST, 1.001 * most, "the covariance"),
        (WITH_EAST, -1.001 * most, "the covariance"),
        (EAST, 0.0, "the covariance"),
        (WITH_EAST, f64::NAN, "the covariance NaN"),
        (last, number(last) + 0.1, "probabilities sum to"),
        (last, f64::NAN, "probabilities sum to NaN"),
    ];
    for (word, value, expected) in cases {
        let read = Vehicle::<PlanePosition>::from_bytes(&with_word(&bytes, word, value.to_bits()));
        match read {
            Err(SnapshotError::Contents { reason }) if reason.contains(expected) => {}
            other => panic!("word {word}, {value}: {other:?}"),
        }
    }
}
