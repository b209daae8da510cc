//! Shortest drives, against all drives that visit no place twice.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{Place, PlanePosition, Road, RoadClass, RoadMap};

use crate::kit::cases;

fn map(places: usize, roads: &[(usize, usize, u8)]) -> RoadMap<PlanePosition> {
    let place = |i| Place {
        id: i as u64,
        position: PlanePosition { x: i as f64, y: 0.0 },
        name: String::new(),
    };
    let within = roads.iter().filter(|road| road.0 < places && road.1 < places);
    let road = |&(from, to, metres): &(usize, usize, u8)| Road {
        from: from as u64,
        to: to as u64,
        class: RoadClass::Street,
        metres: f64::from(metres),
    };
    RoadMap::cleaned((0..places).map(place), within.map(road)).unwrap().0
}

/// All ways from the last of `places` to `to`.
fn drives(
    map: &RoadMap<PlanePosition>,
    to: usize,
    places: &mut Vec<usize>,
    metres: f64,
    found: &mut Vec<(f64, Vec<usize>)>,
) {
    let here = *places.last().unwrap();
    if here == to {
        // Ties are resolved from the end.
        found.push((metres, places.iter().rev().copied().collect()));
        return;
    }
    for (next, road) in map.roads_from(here) {
        if !places.contains(&next) {
            places.push(next);
            drives(map, to, places, metres + road.metres, found);
            places.pop();
        }
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn none_is_shorter_and_ties_go_to_the_lowest(
        places in 1..7_usize, roads in vec((0..7_usize, 0..7_usize, 1..4_u8), 0..25),
    ) {
        let map = map(places, &roads);
        for from in 0..places {
            let metres = map.road_metres_from(from);
            for (to, metres) in metres.into_iter().enumerate() {
                let mut found = Vec::new();
                drives(&map, to, &mut vec![from], 0.0, &mut found);
                let best = found.into_iter().min_by(|a, b| a.partial_cmp(b).unwrap());
                let shortest = map.shortest_path(from, to);
                prop_assert_eq!(metres, best.as_ref().map(|best| best.0));
                let shortest = shortest.map(|drive| {
                    (drive.metres(), drive.places().iter().rev().copied().collect::<Vec<_>>())
                });
                prop_assert_eq!(shortest, best);
            }
        }
    }
}

#[test]
fn ends_that_do_not_exist_and_lengths_beyond_a_double() {
    let two = map(2, &[(0, 1, 1)]);
    assert_eq!(two.shortest_path(0, 2), None);
    assert_eq!(two.shortest_path(2, 0), None);
    assert_eq!(two.shortest_path(2, 2), None);
    assert_eq!(two.shortest_path(1, 1).unwrap().places(), [1]);

    // Lengths that do not change a sum do not lead into a loop.
    let place = |id, x| Place { id, position: PlanePosition { x, y: 0.0 }, name: String::new() };
    let road = |from, to, metres| Road { from, to, class: RoadClass::Street, metres };
    let places = [place(0, 0.0), place(1, 1.0), place(2, 2.0), place(3, 3.0)];
    let roads =
        [road(0, 2, 1e9), road(2, 1, 1e-9), road(1, 2, 1e-9), road(1, 3, 1e-9), road(2, 3, 1e-8)];
    let drive = RoadMap::new(places.clone(), roads).unwrap().shortest_path(0, 3).unwrap();
    assert_eq!((drive.places(), drive.metres()), (&[0, 2, 1, 3][..], 1e9));
    let far = [road(0, 1, f64::MAX), road(1, 2, f64::MAX)];
    let drive = RoadMap::new(places, far).unwrap().shortest_path(0, 2).unwrap();
    assert_eq!(drive.places(), [0, 1, 2]);
}
