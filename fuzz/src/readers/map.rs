//! Maps from CSV files.

use wayfix::map::{MapError, Position, Road, RoadMap, TurningProbabilities, TurningRule};
use wayfix::motion::{DistanceTransition, OdometryReading};
use wayfix::{Belief, Hmm, LikelihoodVector, Prior};

use super::{check_message, damage::damaged};
use crate::counts::Counts;
use crate::draw::Draw;

/// Reads damaged files of places and roads.
pub fn csv(bytes: &[u8], counts: &mut Counts) {
    let mut draw = Draw::new(bytes);
    let count = 1 + draw.below(8);
    let mut places = "id,latitude,longitude,name\n".to_owned();
    for id in 0..count {
        let name = draw.pick(&["", "Civic", "\"a, b\"", "\"say \"\"x\"\"\"", "Ö", " x ", "\"\n\""]);
        let (latitude, longitude) =
            (draw.unit() * 180.0 - 90.0, draw.pick(&[0.0, -180.0, 149.13, 1e-3]));
        places += &format!("{},{latitude},{longitude},{name}\n", id * 3);
    }
    let mut roads = "from,to,class,length_m\n".to_owned();
    for from in 0..count {
        for step in 1..=draw.below(3).min(count - 1) {
            let class = draw.pick(&["main", "arterial", "collector", "street"]);
            let metres = draw.pick(&["1", "250.5", "1e-3", "1e5"]);
            roads += &format!("{},{},{class},{metres}\n", from * 3, (from + step) % count * 3);
        }
    }
    // One of the two is damaged, or both are.
    let which = draw.below(4);
    let mut change = |text: &str, stays: bool| {
        if stays { text.as_bytes().to_vec() } else { damaged(&mut draw, text.as_bytes()) }
    };
    let (places, roads) = (change(&places, which == 0), change(&roads, which == 1));
    counts.note(|| {
        format!("{}\n{}", String::from_utf8_lossy(&places), String::from_utf8_lossy(&roads))
    });
    match RoadMap::<Position>::from_csv(&places[..], &roads[..]) {
        Ok(map) => {
            counts.add("maps accepted");
            check(&map, counts);
        }
        Err(error) => {
            counts.add("maps refused");
            check_message(&error);
            if let MapError::Line { line, .. } = error {
                let lines = places.len().max(roads.len()) as u64 + 1;
                assert!((1..=lines).contains(&line), "line {line} of at most {lines}");
            }
        }
    }
}

/// Checks all queries of a map, and drives on it.
fn check(map: &RoadMap, counts: &mut Counts) {
    let n = map.places().len();
    for (index, place) in map.places().iter().enumerate() {
        assert_eq!(map.index_of_id(place.id), Some(index));
        let Position { latitude, longitude } = place.position;
        assert!((-90.0..=90.0).contains(&latitude) && (-180.0..=180.0).contains(&longitude));
        let ends = map.roads_from(index).map(|road| road.0);
        assert!(ends.eq(map.neighbors(index)), "neighbours are the ends of roads");
        assert_eq!(map.hops_from(index).len(), n);
        assert_eq!(map.hops_either_way(index)[index], Some(0));
        assert_eq!(map.road_metres_from(index)[index], Some(0.0));
        assert!(map.joined(index).len() < n);
        assert_eq!(map.metres_between(index, index), Some(0.0));
        assert!(map.nearest(place.position).is_some());
    }
    let _ = map.is_strongly_connected();
    for Road { from, to, metres, .. } in map.roads() {
        assert!(map.index_of_id(*from).is_some() && map.index_of_id(*to).is_some());
        assert!(*metres > 0.0 && metres.is_finite());
    }
    // Written and read again.
    let mut places = "id,latitude,longitude,name\n".to_owned();
    for place in map.places() {
        let (Position { latitude, longitude }, name) = (place.position, &place.name);
        let name = name.replace('"', "\"\"");
        places += &format!("{},{latitude},{longitude},\"{name}\"\n", place.id);
    }
    let mut roads = "from,to,class,length_m\n".to_owned();
    for Road { from, to, class, metres } in map.roads() {
        roads += &format!("{from},{to},{class},{metres}\n");
    }
    let again =
        RoadMap::<Position>::from_csv(places.as_bytes(), roads.as_bytes()).expect("the same map");
    assert_eq!((again.places(), again.roads()), (map.places(), map.roads()));

    let turning = TurningProbabilities::by_rule(map, &TurningRule::default());
    let base = turning.expect("a rule that holds for every map").into_transition();
    let distances = DistanceTransition::on_map(map, base.clone()).expect("a road for each move");
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).expect("a place"));
    let (sensor, nothing) = (LikelihoodVector::linear(n), vec![1.0; n]);
    let hmm = Hmm::new(prior.clone(), base, sensor).expect("a model");
    hmm.filter().step(&nothing).expect("a step");
    let hmm = Hmm::new(prior, distances, sensor).expect("a model");
    let mut filter = hmm.filter();
    for odometry in [(250.0, 100.0), (0.0, 1e-9), (1e9, 1e300)] {
        let (distance, variance) = odometry;
        filter.step_with(&Some(OdometryReading { distance, variance }), &nothing).expect("a step");
        let sum: f64 = filter.belief().as_slice().iter().sum();
        assert!((sum - 1.0).abs() < 1e-9, "a belief that sums to {sum}");
    }
    counts.add("drives on maps");
}
