//! Facts about graphs, on a small map that can be checked by hand, and against brute force on
//! Canberra.

use wayfix::canberra;
use wayfix::map::{Place, Position, Road, RoadClass, RoadMap, TurningProbabilities, TurningRule};
use wayfix::observation::{Confusion, Metric};

fn place(id: u64, latitude: f64, longitude: f64) -> Place {
    Place { id, position: Position { latitude, longitude }, name: format!("P{id}") }
}

fn road(from: u64, to: u64, class: RoadClass, metres: f64) -> Road {
    Road { from, to, class, metres }
}

/// 10 → 20 → 30 → 10 one way, 20 ↔ 40; 50 leads only to 10.
fn small() -> RoadMap {
    use RoadClass::{Arterial, Main, Street};
    RoadMap::new(
        [
            place(10, 0.0, 0.0),
            place(20, 0.0, 0.01),
            place(30, 0.01, 0.01),
            place(40, 0.0, 0.02),
            place(50, 0.0, -0.01),
        ],
        [
            road(50, 10, Street, 1200.0),
            road(10, 20, Main, 1200.0),
            road(20, 30, Street, 1150.0),
            road(30, 10, Arterial, 9000.0),
            road(20, 40, Main, 1113.0),
            road(40, 20, Main, 1113.0),
        ],
    )
    .unwrap()
}

#[test]
fn neighbours_and_hops() {
    let map = small();
    assert_eq!(map.index_of_id(30), Some(2));
    assert_eq!(map.index_of_id(31), None);
    assert_eq!(map.neighbors(1).collect::<Vec<_>>(), [2, 3]);
    assert_eq!(map.joined(0), [1, 2, 4]);
    assert_eq!(map.hops_from(0), [Some(0), Some(1), Some(2), Some(2), None]);
    assert_eq!(map.hops_either_way(0), [Some(0), Some(1), Some(1), Some(2), Some(1)]);
    assert!(!map.is_strongly_connected());
    // A place that does not exist has no facts, and does not panic.
    assert_eq!(map.neighbors(9).count(), 0);
    assert_eq!(map.roads_from(usize::MAX).count(), 0);
    assert_eq!(map.hops_from(9), [None; 5]);
    assert_eq!(map.road_metres_from(9), [None; 5]);
}

#[test]
fn metres_and_the_nearest_place() {
    let map = small();
    // A hundredth of a degree along the equator.
    let expected = 6_371_008.8 * 0.01_f64.to_radians();
    assert!((map.metres_between(0, 1).unwrap() - expected).abs() <= 1e-6);
    assert_eq!(map.metres_between(0, 9), None);
    assert_eq!(
        map.road_metres_from(1),
        [Some(10150.0), Some(0.0), Some(1150.0), Some(1113.0), None]
    );
    assert_eq!(map.nearest(Position { latitude: 0.009, longitude: 0.011 }), Some(2));
    // Halfway between 10 and 20: the lower one.
    assert_eq!(map.nearest(Position { latitude: 0.0, longitude: 0.005 }), Some(0));
    let nowhere = Position { latitude: f64::NAN, longitude: 0.0 };
    assert_eq!(map.nearest(nowhere), None);
    assert!(map.places()[0].position.metres_to(nowhere).is_nan());
    let antipode = Position { latitude: 0.0, longitude: 180.0 };
    let half = std::f64::consts::PI * 6_371_008.8;
    assert!((map.places()[0].position.metres_to(antipode) - half).abs() <= 1e-6);
}

#[test]
fn turning_by_the_default_rule() {
    let turning = TurningProbabilities::by_rule(&small(), &TurningRule::default()).unwrap();
    let row = |place| turning.row(place).collect::<Vec<_>>();
    let close = |found: Vec<(usize, f64)>, expected: &[(usize, f64)]| {
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(expected) {
            assert!(a.0 == b.0 && (a.1 - b.1).abs() <= 1e-15, "{found:?}");
        }
    };
    // On the main road: 0.95 in the ratio 1 (street) to 2 × 8 (main, straight on).
    close(row(1), &[(1, 0.05), (2, 0.95 / 17.0), (3, 0.95 * 16.0 / 17.0)]);
    // At the arterial's start the only way out takes all but the stops.
    close(row(2), &[(0, 0.9), (2, 0.1)]);
    close(row(4), &[(0, 0.8), (4, 0.2)]);
    assert!((turning.get(2, 0) - 0.9).abs() <= 1e-15);
    assert_eq!(turning.get(2, 9), 0.0);

    // A dead end keeps the vehicle.
    let end = RoadMap::new([place(1, 0.0, 0.0)], []).unwrap();
    let turning = TurningProbabilities::by_rule(&end, &TurningRule::default()).unwrap();
    assert_eq!(turning.get(0, 0), 1.0);
}

#[test]
fn distances_on_canberra_agree_with_brute_force() {
    let map = canberra::map();
    let n = map.places().len();
    // Floyd and Warshall.
    let mut metres = vec![vec![f64::INFINITY; n]; n];
    let mut hops = vec![vec![u32::MAX / 4; n]; n];
    for i in 0..n {
        (metres[i][i], hops[i][i]) = (0.0, 0);
        for (j, road) in map.roads_from(i) {
            (metres[i][j], hops[i][j]) = (road.metres, 1);
        }
    }
    for via in 0..n {
        for i in 0..n {
            for j in 0..n {
                metres[i][j] = metres[i][j].min(metres[i][via] + metres[via][j]);
                hops[i][j] = hops[i][j].min(hops[i][via] + hops[via][j]);
            }
        }
    }
    for i in 0..n {
        assert_eq!(map.hops_from(i), hops[i].iter().copied().map(Some).collect::<Vec<_>>());
        let found = map.road_metres_from(i);
        for j in 0..n {
            assert!((found[j].unwrap() - metres[i][j]).abs() <= 1e-9);
        }
    }
}

/// Rows sum to one in each metric, and nearer places are likelier to be seen.
#[test]
fn sensors_in_three_metrics() {
    let map = small();
    let confusion = Confusion::new(&map, 0.9).unwrap();
    for (metric, sigma) in [(Metric::Index, 1.0), (Metric::Hops, 1.0), (Metric::Metres, 800.0)] {
        let sensor = confusion.with_gaussian(&map, metric, sigma).unwrap();
        for i in 0..5 {
            let row: Vec<f64> = (0..5).map(|j| sensor.probability(i, j).unwrap()).collect();
            assert!((row.iter().sum::<f64>() - 1.0).abs() <= 1e-15);
            assert!((0..5).all(|j| j == i || row[j] < row[i]), "{metric:?} {row:?}");
        }
    }
    // 10 and 40: two hops, 2.2 km, three indices; 10 and 50: one hop, 1.1 km,
    // four indices.
    let ratio = |metric, sigma| {
        let sensor = Confusion::new(&map, 1.0).unwrap().with_gaussian(&map, metric, sigma).unwrap();
        sensor.probability(0, 4).unwrap() / sensor.probability(0, 3).unwrap()
    };
    assert!((ratio(Metric::Index, 1.0) - (-3.5_f64).exp()).abs() <= 1e-12);
    assert!((ratio(Metric::Hops, 1.0) - 1.5_f64.exp()).abs() <= 1e-12);
    let d = map.metres_between(0, 4).unwrap() / 800.0;
    assert!((ratio(Metric::Metres, 800.0) - (1.5 * d * d).exp()).abs() <= 1e-9);
    assert!(confusion.into_table().is_ok());
}

#[cfg(feature = "csv")]
#[test]
fn a_map_survives_being_written_as_csv() {
    let map = canberra::map();
    let mut places = String::from("id,latitude,longitude,name\n");
    for place in map.places() {
        let Position { latitude, longitude } = place.position;
        places += &format!("{},{latitude},{longitude},{}\n", place.id, place.name);
    }
    let mut roads = String::from("from,to,class,length_m\n");
    for road in map.roads() {
        roads += &format!("{},{},{},{}\n", road.from, road.to, road.class, road.metres);
    }
    let read = RoadMap::<Position>::from_csv(places.as_bytes(), roads.as_bytes()).unwrap();
    assert_eq!(read.places(), map.places());
    assert_eq!(read.roads(), map.roads());
}
