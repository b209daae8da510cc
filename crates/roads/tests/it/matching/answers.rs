//! Fields of answers, and positions in errors.

use std::error::Error;

use wayfix::error::At;
use wayfix::map::{PlanePosition, Position, RoadClass};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::matching::{
    LearnedMatchModel, MatchError, MatchModel, Matcher, TracePoint, Vehicle,
};

use super::city::{Point, Scenario, at, city, points};

type Part = wayfix_roads::matching::Stretch<PlanePosition>;

fn town() -> Matcher<PlanePosition> {
    Matcher::new(city(8, 8, 120.0, |_, _| false))
}

fn drives(count: u64) -> Vec<Vec<Point>> {
    let network = city(8, 8, 120.0, |_, _| false);
    let scenario = Scenario { noise: 6.0, every: 1.0, gaps: 0.0, ..Scenario::default() };
    (0..count).map(|seed| points(&network, &scenario, 40, seed)).collect()
}

#[test]
fn errors_name_the_point_and_the_drive() {
    let matcher = town();
    let good: Vec<Point> = drives(1).remove(0);
    let mut bad = good.clone();
    bad[7].position.y = f64::NAN;
    let error = matcher.match_drive(&bad).unwrap_err();
    let text = "point 7 has y NaN, expected metres from -1e9 to 1e9";
    assert_eq!(error.to_string(), text);
    let error = matcher.learn(&[&good, &good, &bad], 3).unwrap_err();
    assert!(matches!(error, MatchError::Drive(At { number: 2, .. })));
    assert_eq!(error.to_string(), format!("drive 2: {text}"));
    assert!(error.source().is_none());
    let error = matcher.learn(&[&good[..], &[]], 3).unwrap_err();
    assert_eq!(error.to_string(), "drive 1: the drive has no points");
    bad[7] = good[6];
    let error = matcher.match_drive(&bad).unwrap_err();
    assert!(error.to_string().starts_with("point 7 has time "), "{error}");
    let error = matcher.match_drive(&bad[7..]).err();
    assert!(error.is_none(), "{error:?}");

    let mut builder = NetworkBuilder::new();
    builder.node(0, Position { latitude: -35.0, longitude: 149.0 }).unwrap();
    let matcher = Matcher::new(builder.build().unwrap());
    let point = |latitude, longitude| {
        let point = TracePoint::new(0.0, Position { latitude, longitude });
        let error = matcher.start(&point, 0).unwrap_err();
        error.to_string()
    };
    let latitude = "expected a latitude from -90 to 90 degrees";
    assert_eq!(point(-95.0, 149.0), format!("point 0 has latitude -95, {latitude}"));
    assert_eq!(
        point(149.0, -35.0),
        format!("point 0 has latitude 149, {latitude} (are longitude and latitude swapped?)")
    );
    assert_eq!(
        point(-35.0, 181.0),
        "point 0 has longitude 181, expected a longitude from -180 to 180 degrees"
    );
}

/// On any number of threads, from slices and vectors.
#[test]
fn fits_are_the_same_to_the_bit() {
    let (matcher, vectors) = (town(), drives(9));
    let fit = || matcher.learn(&vectors, 4).unwrap();
    let expected: LearnedMatchModel = fit();
    let slices: Vec<&[Point]> = vectors.iter().map(|points| &points[..]).collect();
    assert_eq!(matcher.learn(&slices, 4).unwrap(), expected);
    assert_eq!(expected.points, vectors.iter().map(Vec::len).sum::<usize>());
    #[cfg(feature = "rayon")]
    for threads in [1, 2, 5] {
        assert_eq!(crate::threads::with_threads(threads, fit), expected, "{threads}");
    }
    // Simulated drives take the shortest way, so that detours have their least length.
    assert!(expected.at_limits().iter().all(|name| *name != "noise"), "{expected:?}");
    let model = MatchModel { deviation: 1.5, ..expected.model };
    assert!(LearnedMatchModel { model, ..expected }.at_limits().contains(&"deviation"));
}

#[cfg(feature = "serde")]
#[test]
fn vehicles_stay_on_their_network() {
    let matcher = town();
    // A network of the same size, which differs in a part of a road.
    let mut builder = NetworkBuilder::new();
    for node in matcher.network().nodes() {
        builder.node(node.id, node.position).unwrap();
    }
    for edge in matcher.network().edges() {
        let id = |node: usize| matcher.network().nodes()[node].id;
        let mut options = wayfix_roads::EdgeOptions::of(edge.class);
        options.metres = Some(edge.metres + if edge.from == 3 { 0.25 } else { 0.0 });
        builder.edge(id(edge.from), id(edge.to), options).unwrap();
    }
    let other = Matcher::new(builder.build().unwrap());
    assert_eq!(other.network().edges().len(), matcher.network().edges().len());

    let points = drives(1).remove(0);
    let vehicle = matcher.start(&points[0], 2).unwrap();
    let bytes = postcard::to_stdvec(&vehicle).unwrap();
    for mut vehicle in [vehicle.clone(), postcard::from_bytes(&bytes).unwrap()] {
        let before = vehicle.clone();
        let error = vehicle.step(&other, &points[1]).unwrap_err();
        let MatchError::Network { found, expected } = error else { panic!("{error}") };
        assert_ne!(found, expected);
        assert!(
            error.to_string().starts_with("the vehicle or drive is from another network: "),
            "{error}"
        );
        assert_eq!(vehicle, before);
        assert!(matches!(vehicle.credible(&other, 0.5), Err(MatchError::Network { .. })));
        // With another model, or built again, the network counts as the same.
        let model = MatchModel { noise: 12.0, ..MatchModel::default() };
        let again = town().with_model(model).unwrap();
        vehicle.step(&again, &points[1]).unwrap();
    }
    let drive = matcher.match_drive(&points).unwrap();
    assert!(matches!(other.routes(&drive, 1), Err(MatchError::Network { .. })));
    assert!(matches!(drive.credible(&other, 3, 0.5), Err(MatchError::Network { .. })));

    // With coordinates of another kind.
    let text = serde_json::to_string(&vehicle).unwrap();
    let error = serde_json::from_str::<Vehicle<Position>>(&text).unwrap_err().to_string();
    assert!(error.starts_with("a vehicle with coordinates in metres, expected degrees"), "{error}");
}

#[test]
fn credible_stretches_say_what_they_hold() {
    let matcher = town();
    let length = |edge: usize| matcher.network().edges()[edge].metres;
    let mut off_road = 0;
    for mut points in drives(4) {
        // Off the road for a while.
        points[20..30].iter_mut().for_each(|point| point.position.x += 4000.0);
        let found = matcher.match_drive(&points).unwrap();
        for point in 0..points.len() {
            let on_road = 1.0 - found.smoothed(point).off_road;
            let mut last = 0.0;
            for mass in [1e-9, 0.1, 0.5, 0.9, 0.99, 1.0] {
                let around = found.credible(&matcher, point, mass).unwrap();
                let probability = around.probability;
                assert!(probability <= on_road + 1e-9, "{mass}: {probability} of {on_road}");
                assert!(probability >= mass.min(on_road) - 1e-9);
                let edges = found.edges(point);
                let of_edge =
                    |part: &Part| edges.iter().find(|edge| Some(edge.0) == part.edge).unwrap().1;
                assert_eq!(around.probabilities.len(), around.stretches.len());
                for (part, p) in around.stretches.iter().zip(&around.probabilities) {
                    assert!(0.0 < *p && *p <= of_edge(part) + 1e-9);
                }
                let sum: f64 = around.probabilities.iter().sum();
                assert!(sum >= probability - 1e-9);
                // A larger mass needs as many stretches or more.
                let total: f64 = around.stretches.iter().map(Part::metres).sum();
                assert!(total >= last - 1e-9, "{mass}: {total} after {last}");
                last = total;
                if mass > on_road {
                    off_road += 1;
                    assert!((probability - on_road).abs() < 1e-9);
                    for part in &around.stretches {
                        assert_eq!([part.enter, part.exit], [0.0, length(part.edge.unwrap())]);
                    }
                    let edges = edges.iter().filter(|edge| edge.1 > 0.0).count();
                    assert_eq!(around.stretches.len(), edges);
                }
            }
        }
        let vehicle = matcher.start(&points[0], 0).unwrap();
        for bad in [0.0, -0.5, 1.0 + 1e-12, f64::NAN, f64::INFINITY] {
            for result in [vehicle.credible(&matcher, bad), found.credible(&matcher, 0, bad)] {
                let error = result.unwrap_err();
                assert!(matches!(error, MatchError::Parameter(_)));
                let expected =
                    format!("the mass is {bad}, expected a probability above 0 and at most 1");
                assert_eq!(error.to_string(), expected);
            }
        }
    }
    assert!(off_road > 50, "{off_road}");
}

#[test]
fn edges_at_points_of_a_drive() {
    let matcher = town();
    let points = drives(1).remove(0);
    let found = matcher.match_drive(&points).unwrap();
    for point in 0..points.len() {
        let (edges, answer) = (found.edges(point), found.smoothed(point));
        let sum: f64 = edges.iter().map(|edge| edge.1).sum();
        assert!((sum + answer.off_road - 1.0).abs() < 1e-9);
        assert!(edges.windows(2).all(|pair| pair[0].1 >= pair[1].1));
        assert_eq!(answer.edge.map(|_| edges[0].1), answer.edge.map(|_| answer.probability));
    }
    let mut vehicle = matcher.start(&points[0], 0).unwrap();
    for point in &points[1..] {
        vehicle.step(&matcher, point).unwrap();
    }
    let last = found.edges(points.len() - 1);
    for (edge, p) in vehicle.edges() {
        let same = last.iter().find(|other| other.0 == edge).unwrap();
        assert!((same.1 - p).abs() < 1e-9, "{edge}");
    }
}

/// The line of a route has its length, and each part begins where the one before ends.
#[test]
fn lines_of_routes() {
    let matcher = town();
    let mut off_road = 0;
    for mut points in drives(6) {
        points[10..].iter_mut().for_each(|point| point.position.x += 4000.0);
        let found = matcher.match_drive(&points).unwrap();
        let mut on_road = 0.0;
        for stretch in found.route() {
            let line = matcher.line(stretch);
            let length: f64 = line.windows(2).map(|pair| pair[0].metres_to(pair[1])).sum();
            assert!((length - stretch.metres()).abs() < 1e-6, "{stretch:?}");
            assert_eq!([line[0], line[line.len() - 1]], stretch.ends);
            on_road += if stretch.edge.is_some() { stretch.metres() } else { 0.0 };
        }
        assert!((on_road - found.metres()).abs() < 1e-9);
        off_road += found.route().iter().filter(|stretch| stretch.edge.is_none()).count();
    }
    assert!(off_road > 0);
    let mut builder = NetworkBuilder::new();
    builder.node(0, at(0.0, 0.0)).unwrap();
    builder.node(1, at(100.0, 0.0)).unwrap();
    let between = vec![at(0.0, 50.0), at(100.0, 50.0)];
    let options = wayfix_roads::EdgeOptions::of(RoadClass::Street).with_between(between);
    builder.edge(0, 1, options).unwrap();
    let matcher = Matcher::new(builder.build().unwrap());
    let drive = [(0.0, at(1.0, 20.0)), (10.0, at(99.0, 30.0))];
    let drive = drive.map(|(time, position)| TracePoint::new(time, position));
    let found = matcher.match_drive(&drive).unwrap();
    let lines: Vec<_> = found.route().iter().flat_map(|s| matcher.line(s)).collect();
    assert_eq!(lines, [at(0.0, 20.0), at(0.0, 50.0), at(100.0, 50.0), at(100.0, 30.0)]);
}
