//! Maps of a plane, and maps from messy files.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{
    CleaningReport, Place, PlanePosition, Position, Road, RoadClass, RoadMap, TurningProbabilities,
    TurningRule,
};
use wayfix::observation::{Confusion, Metric};

use crate::kit::{cases, says};

fn shelf(id: u64, x: f64, y: f64) -> Place<PlanePosition> {
    Place { id, position: PlanePosition { x, y }, name: format!("S{id}") }
}

fn road(from: u64, to: u64, metres: f64) -> Road {
    Road { from, to, class: RoadClass::Street, metres }
}

#[test]
fn a_plane_is_euclidean() {
    let shelves = [shelf(1, 0.0, 0.0), shelf(2, 3.0, 4.0), shelf(3, 3.0, -8.0)];
    let roads = [
        Road::straight(&shelves[0], &shelves[1], RoadClass::Main),
        Road::straight(&shelves[1], &shelves[2], RoadClass::Street),
    ];
    assert_eq!(roads[0], Road { class: RoadClass::Main, ..road(1, 2, 5.0) });
    let map = RoadMap::new(shelves, roads).unwrap();
    assert_eq!(map.metres_between(1, 2), Some(12.0));
    assert_eq!(map.metres_between(0, 3), None);
    assert_eq!(map.road_metres_from(0), [Some(0.0), Some(5.0), Some(17.0)]);
    assert_eq!(map.shortest_path(0, 2).unwrap().metres(), 17.0);
    assert_eq!(map.nearest(PlanePosition { x: 9.0, y: -2.1 }), Some(2));
    // At the same distance from 2 and 3: the lower one.
    assert_eq!(map.nearest(PlanePosition { x: 9.0, y: -2.0 }), Some(1));
    assert_eq!(map.nearest(PlanePosition { x: f64::NAN, y: 0.0 }), None);

    // Everything that a map can make works for this one.
    let turning = TurningProbabilities::by_rule(&map, &TurningRule::default()).unwrap();
    assert_eq!(turning.clone().tied(&map).inner().entries(), 5);
    assert_eq!(turning.get(2, 2), 1.0);
    let sensor = Confusion::new(&map, 1.0).unwrap().with_gaussian(&map, Metric::Metres, 5.0);
    let sensor = sensor.unwrap();
    let ratio = sensor.probability(1, 0).unwrap() / sensor.probability(1, 2).unwrap();
    assert!((ratio.ln() - 0.5 * (144.0 - 25.0) / 25.0).abs() <= 1e-12);
}

#[test]
fn a_plane_has_an_end() {
    for (bad, found) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (-2e9, "-2000000000")] {
        let text = |axis| {
            format!("place 7 has {axis} {found}, expected metres from -1000000000 to 1000000000")
        };
        says(RoadMap::new([shelf(7, bad, 0.0)], []), &text("x"));
        says(RoadMap::new([shelf(7, 0.0, bad)], []), &text("y"));
    }
}

#[test]
fn repeated_places_are_dropped_unless_they_moved() {
    let places = || vec![shelf(1, 0.0, 0.0), shelf(2, 1.0, 0.0), shelf(1, 0.0, 0.0)];
    says(RoadMap::new(places(), []), "place 1 is given twice");
    let (map, report) = RoadMap::cleaned(places(), [road(1, 2, 1.0)]).unwrap();
    assert_eq!(map.places(), &places()[..2]);
    assert_eq!(report.repeated_places, [(2, 1)]);
    assert!(!report.is_clean());
    assert_eq!(
        report.to_string(),
        "dropped 1 of 3 places (repeated) and 0 of 1 roads (parallel: 0, loops: 0)"
    );
    let moved = places().into_iter().chain([shelf(2, 1.5, 0.0)]);
    says(RoadMap::cleaned(moved, []), "place 2 is given twice");

    let cleaned = |roads: &[Road]| RoadMap::cleaned(places(), roads.iter().copied());
    assert!(cleaned(&[road(1, 1, f64::NAN)]).is_ok());
    says(
        cleaned(&[road(1, 2, 1.0), road(1, 2, -1.0)]),
        "the road from place 1 to place 2 has length -1, expected metres above 0",
    );
    says(
        cleaned(&[road(9, 9, 1.0)]),
        "the road from place 9 to place 9 needs place 9, which does not exist",
    );
    says(RoadMap::<Position>::cleaned([], []), "a map needs at least one place, found none");
}

fn all(report: &CleaningReport) -> Vec<(usize, Road)> {
    let mut all = [&report.parallel_roads[..], &report.loops].concat();
    all.sort_by_key(|dropped| dropped.0);
    all
}

proptest! {
    #![proptest_config(cases())]

    /// The remaining roads are accepted by the strict constructor, and are the shortest ones.
    #[test]
    fn the_shortest_roads_are_left(given in vec((0..4_u64, 0..4_u64, 1..4_u8), 0..30)) {
        let places = || (0..4_u64).map(|id| shelf(id, id as f64, 0.0));
        let given: Vec<Road> =
            given.into_iter().map(|(from, to, m)| road(from, to, f64::from(m))).collect();
        let (map, report) = RoadMap::cleaned(places(), given.iter().copied()).unwrap();
        let is_left = |index: usize| {
            let Road { from, to, metres, .. } = given[index];
            from != to && given.iter().enumerate().all(|(other, road)| {
                let beside = (road.from, road.to) == (from, to) && other != index;
                !beside || (metres, index) < (road.metres, other)
            })
        };
        let left: Vec<Road> = (0..given.len()).filter(|i| is_left(*i)).map(|i| given[i]).collect();
        let strict = RoadMap::new(places(), left).unwrap();
        prop_assert_eq!(map.roads(), strict.roads());
        prop_assert_eq!(map.places(), strict.places());
        let dropped: Vec<(usize, Road)> = (0..given.len()).filter(|index| !is_left(*index))
            .map(|index| (index, given[index])).collect();
        prop_assert_eq!(all(&report), dropped);
        prop_assert!(report.loops.iter().all(|dropped| dropped.1.from == dropped.1.to));
        prop_assert!(report.parallel_roads.is_sorted_by_key(|dropped| dropped.0));
        prop_assert_eq!(report.is_clean(), map.roads().len() == given.len());
        prop_assert_eq!((report.places_given, report.roads_given), (4, given.len()));
    }
}

#[cfg(feature = "csv")]
#[test]
fn planes_and_unclean_files() {
    let places = "id,x,y,name\n1,0,0,dock\n\n2,-30,40.5,shelf\n2,-30,40.5,again\n";
    let roads = "from,to,class,length_m\n1,2,main,70\n1,2,street,60\n2,2,street,\n2,1,street,\n";
    let cleaned = |places: &str, roads: &str| {
        RoadMap::<PlanePosition>::cleaned_from_csv(places.as_bytes(), roads.as_bytes())
    };
    let (map, report) = cleaned(places, roads).unwrap();
    let back = 30_f64.hypot(40.5);
    let street = |from, to, metres| Road { class: RoadClass::Street, ..road(from, to, metres) };
    assert_eq!(map.roads(), [street(1, 2, 60.0), street(2, 1, back)]);
    assert_eq!(map.places()[1].name, "shelf");
    assert_eq!(report.repeated_places, [(2, 2)]);
    assert_eq!(all(&report).iter().map(|dropped| dropped.0).collect::<Vec<_>>(), [0, 2]);

    let strict = |roads: &str| {
        RoadMap::<PlanePosition>::from_csv(
            "id,x,y,name\n1,0,0,\n2,1e10,0,\n".as_bytes(),
            roads.as_bytes(),
        )
    };
    says(
        strict(roads),
        "places, line 3: place 2 has x 10000000000, expected metres from -1000000000 to 1000000000",
    );
    let empty = "from,to,class,length_m\n1,3,main,\n";
    says(
        cleaned(places, empty),
        "roads, line 2: the road from place 1 to place 3 needs place 3, which does not exist",
    );
    says(
        cleaned("id,latitude,longitude,name\n", empty),
        "places, line 1: header \"id,latitude,longitude,name\", expected \"id,x,y,name\"",
    );

    // On Earth, lengths must be given.
    let places = "id,latitude,longitude,name\n1,0,0,\n2,0,1e-3,\n";
    let earth =
        |roads: &str| RoadMap::<Position>::cleaned_from_csv(places.as_bytes(), roads.as_bytes());
    says(
        earth("from,to,class,length_m\n1,2,main,\n"),
        "roads, line 2: length_m is \"\", expected a number",
    );
    let (map, report) = earth("from,to,class,length_m\n1,2,main,112\n1,2,main,112\n").unwrap();
    assert_eq!((map.roads().len(), report.parallel_roads[0].0), (1, 1));
    let missing = RoadMap::<Position>::cleaned_from_csv_files("no/such/places.csv", "no/roads.csv");
    assert!(missing.unwrap_err().to_string().starts_with("cannot read no/such/places.csv: "));
}

/// Empty lines, line feeds in quotes and carriage returns count as in an editor.
#[cfg(feature = "csv")]
#[test]
fn errors_name_the_line() {
    let roads = "from,to,class,length_m\n";
    let places = "id,latitude,longitude,name\n";
    for (text, line) in [
        (format!("{places}1,0,0,\nx,0,0,\n"), 3),
        (format!("{places}1,0,0,\r\nx,0,0,\r\n").replace("name\n", "name\r\n"), 3),
        (format!("{places}1,0,0,\n\n\nx,0,0,"), 5),
        (format!("{places}1,0,0,\n\n\nx,0,0,").replace('\n', "\r\n"), 5),
        (format!("{places}1,0,0,\"a\nb\n\"\nx,0,0,\n"), 5),
        (format!("{places}1,0,0,\"a\nb\n\"\nx,0,0,\n").replace('\n', "\r\n"), 5),
        (format!("\n\u{feff}{places}"), 2),
        (format!("{places}1,0,0,\nx,0,0,\n").replace('\n', "\r"), 3),
        (format!("{places}{}x,0,0,", "1,0,0,\r\n\r\n".repeat(5000)), 10_002),
    ] {
        let error =
            RoadMap::<Position>::cleaned_from_csv(text.as_bytes(), roads.as_bytes()).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with(&format!("places, line {line}: ")), "{text}, expected {line}");
    }
    // Fields are kept as they are, also in quotes.
    let text = "id,latitude,longitude,name\r\n1,0,0,\"a\r\nb\"\r\n2,0,1e-3,\r\n";
    let (map, _) =
        RoadMap::<Position>::cleaned_from_csv(text.as_bytes(), roads.as_bytes()).unwrap();
    assert_eq!(map.places()[0].name, "a\r\nb");
    // Bytes that are not UTF-8, beyond the first buffer.
    let lines = "1,0,0,\r\n".repeat(5000);
    let text = [places.as_bytes(), lines.as_bytes(), b"2,0,0,ab\xff\r\n"].concat();
    says(
        RoadMap::<Position>::cleaned_from_csv(&text[..], roads.as_bytes()),
        "places, line 5002: CSV parse error: record 5001 (line 5002, field: 3, byte: 40026): \
         invalid utf-8: invalid UTF-8 in field 3 near byte index 2",
    );
}
