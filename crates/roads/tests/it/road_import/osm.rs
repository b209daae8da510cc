//! Tags, splitting and turn restrictions of OpenStreetMap.

use wayfix::map::RoadClass;
use wayfix_roads::{ImportNote, ImportOptions, ImportReport, RoadNetwork};

use super::pbf::{Extract, Member, Tags};
use super::{ends, osm, turns};

/// Nodes 1 to 9 on a slanted line, 10 and 11 as a square with 1 and 2.
fn nodes() -> Vec<(i64, i64, i64)> {
    let mut nodes: Vec<_> =
        (1..10).map(|i| (i, 470_000_000 + 1_000 * i * i, 95_000_000 + 10_000 * i)).collect();
    nodes.extend([(10, 470_100_000, 95_010_000), (11, 470_100_000, 95_020_000)]);
    nodes
}

fn read(ways: &[(i64, &[i64], Tags<'_>)]) -> (RoadNetwork, ImportReport) {
    osm(&Extract { nodes: nodes(), ways: ways.to_vec(), ..Extract::default() }.bytes()).unwrap()
}

/// Ends of the road of one way 1, 2 with these tags; none if it is skipped.
fn road(tags: Tags<'_>) -> Vec<[u64; 2]> {
    let (network, _) = read(&[(1, &[1, 2], tags), (2, &[8, 9], &[("highway", "road")])]);
    ends(&network).into_iter().filter(|ends| ends[0] < 8).collect()
}

const BOTH: [[u64; 2]; 2] = [[1, 2], [2, 1]];

#[test]
fn tags_decide_on_cars_and_directions() {
    let residential = ("highway", "residential");
    assert_eq!(road(&[residential]), BOTH);
    for (key, value) in [
        ("access", "no"),
        ("access", "private"),
        ("motor_vehicle", "no"),
        ("motorcar", "forestry"),
        ("area", "yes"),
    ] {
        assert!(road(&[residential, (key, value)]).is_empty(), "{key}={value}");
    }
    assert_eq!(road(&[residential, ("access", "no"), ("motor_vehicle", "yes")]), BOTH);
    assert_eq!(road(&[residential, ("access", "destination")]), BOTH);
    for other in ["footway", "cycleway", "track", "construction", "proposed", "pedestrian"] {
        assert!(road(&[("highway", other)]).is_empty(), "{other}");
    }
    assert!(road(&[("railway", "tram")]).is_empty());
    for (value, expected) in [
        ("yes", &BOTH[..1]),
        ("true", &BOTH[..1]),
        ("1", &BOTH[..1]),
        ("-1", &BOTH[1..]),
        ("no", &BOTH[..]),
        ("reversible", &BOTH[..]),
    ] {
        assert_eq!(road(&[residential, ("oneway", value)]), expected, "{value}");
    }
    for implied in [("junction", "roundabout"), ("junction", "circular"), ("highway", "motorway")] {
        let tags = if implied.0 == "highway" { vec![implied] } else { vec![residential, implied] };
        assert_eq!(road(&tags), BOTH[..1], "{implied:?}");
        let no = [&tags[..], &[("oneway", "no")]].concat();
        assert_eq!(road(&no), BOTH, "{implied:?}");
    }
}

#[test]
fn tags_decide_on_class_and_speed() {
    let of = |tags: Tags<'_>| {
        let (network, report) = read(&[(1, &[1, 2], tags)]);
        let edge = network.edges()[0];
        let kmh = edge.speed.map(|speed| (speed * 36.0).round() / 10.0);
        (edge.class, kmh, edge.roundabout, report.count(ImportNote::UnknownSpeed))
    };
    for (highway, class) in [
        ("motorway", RoadClass::Main),
        ("trunk_link", RoadClass::Main),
        ("primary", RoadClass::Main),
        ("secondary", RoadClass::Arterial),
        ("tertiary_link", RoadClass::Collector),
        ("living_street", RoadClass::Street),
        ("service", RoadClass::Street),
    ] {
        assert_eq!(of(&[("highway", highway)]), (class, None, false, 0), "{highway}");
    }
    for (text, expected, unknown) in [
        ("80", Some(80.0), 0),
        ("30 mph", Some(48.3), 0),
        ("50 km/h", Some(50.0), 0),
        ("walk", Some(5.0), 0),
        ("none", None, 0),
        ("CH:urban", None, 1),
        ("0", None, 1),
        ("NaN", None, 1),
    ] {
        let (_, kmh, _, count) = of(&[("highway", "road"), ("maxspeed", text)]);
        assert_eq!((kmh, count), (expected, unknown), "{text}");
    }
    assert!(of(&[("highway", "road"), ("junction", "roundabout")]).2);
}

#[test]
fn options_choose_roads() {
    let ways: [(i64, &[i64], Tags<'_>); 5] = [
        (1, &[1, 2], &[("highway", "service")]),
        (2, &[2, 3], &[("highway", "service"), ("service", "parking_aisle")]),
        (3, &[3, 4], &[("highway", "track")]),
        (4, &[4, 5], &[("highway", "residential"), ("access", "private")]),
        (5, &[5, 6], &[("highway", "residential")]),
    ];
    let bytes = Extract { nodes: nodes(), ways: ways.to_vec(), ..Extract::default() }.bytes();
    let roads = |options: ImportOptions| {
        let (network, report) =
            RoadNetwork::from_osm(std::io::Cursor::new(&bytes), &options).unwrap();
        let skipped = report.count(ImportNote::NotDrivable) + report.count(ImportNote::Closed);
        let firsts = ends(&network).into_iter().filter(|[a, b]| a < b).map(|ends| ends[0]);
        let firsts: Vec<u64> = firsts.collect();
        assert_eq!(firsts.len() + skipped, 5);
        firsts
    };
    let usual = ImportOptions::default;
    assert_eq!(roads(usual()), [1, 2, 5]);
    assert_eq!(roads(usual().with_parking_aisles(false)), [1, 5]);
    assert_eq!(roads(usual().with_service_roads(false)), [5]);
    let all = usual().with_tracks(true).with_private_roads(true);
    assert_eq!(roads(all), [1, 2, 3, 4, 5]);
}

const ROAD: Tags<'static> = &[("highway", "residential")];

#[test]
fn ways_are_split_where_they_meet() {
    // 2 and 4 are points of the line; 3 is shared; 7 - 8 - 9 - 7 is a ring of its own, 10 - 11 one
    // that crosses itself at 1.
    let (network, _) = read(&[
        (1, &[1, 2, 2, 3, 4, 5], ROAD),
        (2, &[3, 6], &[("highway", "primary"), ("oneway", "yes")]),
        (3, &[7, 8, 9, 7], &[("highway", "residential"), ("junction", "roundabout")]),
        (4, &[10, 1, 11, 5, 1], &[("highway", "tertiary"), ("oneway", "yes")]),
    ]);
    let expected = [[1, 3], [1, 5], [3, 1], [3, 5], [3, 6], [5, 1], [5, 3], [7, 7], [10, 1]];
    assert_eq!(ends(&network), expected);
    let edge = |from: u64, to: u64| {
        let [from, to] = [from, to].map(|id| network.index_of_id(id).unwrap());
        network.edge_between(from, to).unwrap()
    };
    assert_eq!(network.shape(edge(1, 3)).len(), 3);
    let back: Vec<_> = network.shape(edge(3, 1)).iter().rev().copied().collect();
    assert_eq!(network.shape(edge(1, 3)), back);
    assert_eq!(network.shape(edge(7, 7)).len(), 4);
    assert_eq!(network.reverse(edge(1, 3)), Some(edge(3, 1)));
    // One-way roads with opposite ends are not a pair if their lengths differ.
    assert_eq!(network.reverse(edge(3, 6)), None);
    let line = network.shape(edge(1, 5)).windows(2).map(|pair| pair[0].metres_to(pair[1]));
    assert!((network.edges()[edge(1, 5)].metres - line.sum::<f64>()).abs() < 1e-9);
}

#[test]
fn roads_are_cut_at_missing_nodes() {
    let (network, report) =
        read(&[(1, &[1, 2, 99, 3, 4, 5, 98, 6], ROAD), (2, &[97, 96], ROAD), (3, &[7], ROAD)]);
    assert_eq!(ends(&network), [[1, 2], [2, 1], [3, 5], [5, 3]]);
    assert_eq!(report.count(ImportNote::MissingNode), 2);
    assert_eq!(report.count(ImportNote::NoLine), 1);
}

/// Turns, and the count of one note, for a crossing of ways 1 (1 - 2), 2 (2 - 3), 3 (2 - 11) at
/// node 2.
fn restricted(
    tags: Tags<'_>,
    members: &[Member<'static>],
    note: ImportNote,
) -> (Vec<[u64; 3]>, usize) {
    let tags = [&[("type", "restriction")][..], tags].concat();
    let ways: Vec<(i64, &[i64], Tags<'_>)> =
        vec![(1, &[1, 2], ROAD), (2, &[2, 3], ROAD), (3, &[11, 2], ROAD)];
    let relations = vec![(&tags[..], members.to_vec())];
    let extract = Extract { nodes: nodes(), ways, relations, ..Extract::default() };
    let (network, report) = osm(&extract.bytes()).unwrap();
    let turns = turns(&network);
    assert_eq!(report.forbidden_turns, turns.len());
    (turns, report.count(note))
}

#[test]
fn turns_are_forbidden() {
    let unused = ImportNote::RestrictionUnused;
    let left = [("from", 1, 1), ("via", 0, 2), ("to", 1, 3)];
    let no = restricted(&[("restriction", "no_left_turn")], &left, unused);
    assert_eq!(no, (vec![[1, 2, 11]], 0));
    let only = restricted(&[("restriction", "only_left_turn")], &left, unused);
    assert_eq!(only, (vec![[1, 2, 1], [1, 2, 3]], 0));
    let back = [("from", 1, 1), ("via", 0, 2), ("to", 1, 1)];
    let no = restricted(&[("restriction", "no_u_turn")], &back, unused);
    assert_eq!(no, (vec![[1, 2, 1]], 0));
    let entry = [("from", 1, 1), ("from", 1, 2), ("via", 0, 2), ("to", 1, 3), ("note", 2, 7)];
    let no = restricted(&[("restriction", "no_entry")], &entry, unused);
    assert_eq!(no, (vec![[1, 2, 11], [3, 2, 11]], 0));
    let cars = [("restriction:motorcar", "no_left_turn"), ("except", "bicycle;psv")];
    assert_eq!(restricted(&cars, &left, unused), (vec![[1, 2, 11]], 0));
}

#[test]
fn restrictions_that_cannot_be_used_are_counted() {
    let left = [("from", 1, 1), ("via", 0, 2), ("to", 1, 3)];
    let kind = ("restriction", "no_left_turn");
    let gone = [("from", 1, 1), ("via", 0, 2), ("to", 1, 77)];
    let elsewhere = [("from", 1, 1), ("via", 0, 1), ("to", 1, 3)];
    let way = [("from", 1, 1), ("via", 1, 2), ("to", 1, 3)];
    for (tags, members, note) in [
        (&[kind][..], &gone[..], ImportNote::RestrictionUnused),
        (&[kind], &elsewhere, ImportNote::RestrictionUnused),
        (&[kind], &left[..1], ImportNote::RestrictionUnused),
        (&[("restriction", "give_way")], &left, ImportNote::RestrictionUnused),
        (&[kind], &way, ImportNote::RestrictionThroughWay),
        (&[kind, ("except", "psv; motorcar")], &left, ImportNote::RestrictionForOthers),
        (&[("restriction:hgv", "no_left_turn")], &left, ImportNote::RestrictionForOthers),
        (
            &[("restriction:conditional", "no_left_turn @ (Mo-Fr)")],
            &left,
            ImportNote::RestrictionByHour,
        ),
    ] {
        assert_eq!(restricted(tags, members, note), (vec![], 1), "{tags:?}");
    }
}
