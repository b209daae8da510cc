//! Edges near a position against the projection on all edges.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{Coordinates, Position, RoadClass};
use wayfix_roads::matching::{Matcher, TracePoint};
use wayfix_roads::{EdgeIndex, EdgeOptions, NearEdge, NetworkBuilder, RoadNetwork};

use super::city::at;
use crate::kit::cases;

/// Up to 8 nodes and 12 edges, bent, in one or both directions, in a square that `place` maps to
/// positions.
fn any_network<P: Coordinates + 'static>(
    place: impl Fn((f64, f64)) -> P + Clone + 'static,
) -> impl Strategy<Value = RoadNetwork<P>> {
    let point = || (0.0..1.0, 0.0..1.0);
    let edges = vec((0..8_usize, 0..8_usize, any::<bool>(), vec(point(), 0..4)), 1..12);
    (vec(point(), 8), edges).prop_map(move |(nodes, edges)| {
        let mut builder = NetworkBuilder::new();
        for (&node, id) in nodes.iter().zip(0..) {
            builder.node(id, place(node)).unwrap();
        }
        for (from, to, both, between) in edges {
            if from == to && between.is_empty() {
                continue;
            }
            let mut between: Vec<P> = between.into_iter().map(&place).collect();
            let ends = [from as u64, to as u64];
            let options =
                |between: Vec<P>| EdgeOptions::of(RoadClass::Street).with_between(between);
            let there = builder.edge(ends[0], ends[1], options(between.clone())).unwrap();
            if both {
                between.reverse();
                let back = builder.edge(ends[1], ends[0], options(between)).unwrap();
                builder.pair(there, back);
            }
        }
        builder.build().unwrap()
    })
}

/// The index finds the same as projections, except for edges within this share of the limit.
fn check<P: Coordinates>(
    network: &RoadNetwork<P>,
    position: P,
    metres: f64,
    tolerance: f64,
) -> Result<(), TestCaseError> {
    let index = EdgeIndex::new(network);
    let mut found = vec![];
    index.near(network, position, metres, &mut found);
    prop_assert!(found.windows(2).all(|pair| pair[0].edge < pair[1].edge), "{found:?}");
    for edge in 0..network.edges().len() {
        let expected = network.project(edge, position);
        let near: Option<&NearEdge> = found.iter().find(|near| near.edge == edge);
        let margin = tolerance * metres + 1e-7;
        match near {
            None => prop_assert!(
                expected.metres_off > metres - margin,
                "{edge} is missing: {expected:?}"
            ),
            Some(near) => {
                prop_assert!(near.metres_off <= metres);
                prop_assert!(
                    (near.metres_off - expected.metres_off).abs() <= margin,
                    "{near:?} {expected:?}"
                );
                let length = network.edges()[edge].metres;
                prop_assert!((0.0..=length * (1.0 + 1e-12)).contains(&near.metres_along));
                // The position is as near as the nearest, if not the same.
                let place = network.position_along(edge, near.metres_along);
                let off = place.metres_to(position);
                prop_assert!(
                    (off - expected.metres_off).abs() <= margin + 2.0 * tolerance * length,
                    "{near:?} {expected:?}"
                );
                let split = near.across.hypot(near.beyond);
                prop_assert!((split - near.metres_off).abs() <= 1e-6, "{near:?}");
                prop_assert!(near.across >= 0.0);
                let margin = 1e-9 * length;
                if near.beyond > 1e-9 {
                    prop_assert!(near.metres_along >= length - margin);
                } else if near.beyond < -1e-9 {
                    prop_assert!(near.metres_along <= margin);
                }
            }
        }
    }
    let best = (0..network.edges().len()).map(|edge| network.project(edge, position).metres_off);
    let best = best.reduce(f64::min);
    let nearest = index.nearest(network, position);
    prop_assert_eq!(nearest.is_some(), best.is_some());
    if let (Some(nearest), Some(best)) = (nearest, best) {
        let margin = tolerance * best + 1e-7;
        prop_assert!((nearest.metres_off - best).abs() <= margin, "{nearest:?} {best}");
        let again = network.project(nearest.edge, position);
        prop_assert!((nearest.metres_off - again.metres_off).abs() <= margin);
        let off = nearest.position(network).metres_to(position);
        prop_assert!((off - best).abs() <= margin + 2e-3 * best, "{off} {best}");
        // The first of all edges within a distance.
        index.near(network, position, nearest.metres_off + 1.0, &mut found);
        let least = found.iter().map(|near| near.metres_off).fold(f64::INFINITY, f64::min);
        let first = found.iter().find(|near| near.metres_off == least).unwrap();
        prop_assert!(*first == nearest || (least - nearest.metres_off).abs() <= margin);
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn equal_brute_force_in_a_plane(
        network in any_network(|(x, y)| at(1000.0 * x, 1000.0 * y)),
        x in -200.0..1200.0, y in -200.0..1200.0, metres in 0.0..600.0,
    ) {
        check(&network, at(x, y), metres, 1e-12)?;
    }

    /// Squares of 500 to 900 m at the equator, in Canberra, and near 80°.
    #[test]
    fn equal_brute_force_on_earth(
        (network, latitude) in proptest::sample::select(&[0.0, -35.0, 69.6, 80.0][..]).prop_flat_map(|latitude| {
            let place = move |(x, y): (f64, f64)| Position {
                latitude: latitude + 0.005 * y,
                longitude: 20.0 + 0.008 * x / f64::to_radians(latitude).cos(),
            };
            (any_network(place), Just(latitude))
        }),
        x in -0.2..1.2, y in -0.2..1.2, metres in 0.0..400.0,
    ) {
        let longitude = 20.0 + 0.008 * x / f64::to_radians(latitude).cos();
        let position = Position { latitude: latitude + 0.005 * y, longitude };
        // The scale of the projection changes by 1e-3 over such a square near 80°.
        check(&network, position, metres, 2e-3)?;
    }
}

/// Two carriageways around a square, of one length between the same nodes: each has its own line.
#[test]
fn both_directions_have_their_own_lines() {
    let mut builder = NetworkBuilder::new();
    builder.node(0, at(0.0, 0.0)).unwrap();
    builder.node(1, at(200.0, 0.0)).unwrap();
    for (from, to, y) in [(0, 1, -60.0), (1, 0, 60.0)] {
        let between =
            if from == 0 { vec![at(0.0, y), at(200.0, y)] } else { vec![at(200.0, y), at(0.0, y)] };
        let options = EdgeOptions::of(RoadClass::Street).with_between(between);
        builder.edge(from, to, options).unwrap();
    }
    let network = builder.build().unwrap();
    let back = network.edge_between(1, 0).unwrap();
    let mut near = Vec::new();
    EdgeIndex::new(&network).near(&network, at(100.0, 60.0), 10.0, &mut near);
    let edges: Vec<_> = near.iter().map(|near| (near.edge, near.metres_off)).collect();
    assert_eq!(edges, [(back, 0.0)]);
}

/// Beside an edge, beyond its end, and before its start, as the index finds it.
#[test]
fn projections_know_what_is_across_and_beyond() {
    let mut builder = NetworkBuilder::new();
    builder.node(0, at(0.0, 0.0)).unwrap();
    builder.node(1, at(100.0, 0.0)).unwrap();
    builder.one_way(0, 1, RoadClass::Street).unwrap();
    let network = builder.build().unwrap();
    for (x, y, along, across, beyond) in [
        (30.0, 7.0, 30.0, 7.0, 0.0),
        (130.0, 40.0, 100.0, 40.0, 30.0),
        (-3.0, -4.0, 0.0, 4.0, -3.0),
    ] {
        let found = network.project(0, at(x, y));
        assert_eq!((found.metres_along, found.across, found.beyond), (along, across, beyond));
        assert_eq!(found.metres_off, across.hypot(beyond));
        assert_eq!(found.position(&network), at(along, 0.0));
        assert_eq!(found.heading(), std::f64::consts::FRAC_PI_2);
        assert_eq!(EdgeIndex::new(&network).nearest(&network, at(x, y)), Some(found));
    }
}

#[test]
fn a_network_without_edges() {
    let mut builder = NetworkBuilder::new();
    builder.node(0, at(0.0, 0.0)).unwrap();
    let network = builder.build().unwrap();
    let mut near = Vec::new();
    EdgeIndex::new(&network).near(&network, at(0.0, 0.0), 1e6, &mut near);
    assert!(near.is_empty());
    let matcher = Matcher::new(network);
    let points = [0.0, 1.0, 2.0].map(|time| TracePoint::new(time, at(5.0 * time, 0.0)));
    let drive = matcher.match_drive(&points).unwrap();
    assert_eq!(drive.smoothed(1).edge, None);
    assert_eq!(drive.smoothed(1).off_road, 1.0);
    assert_eq!(drive.metres(), 0.0);
}

/// The projection stretches without bound towards the poles.
#[test]
fn nothing_is_near_a_pole() {
    let mut builder: NetworkBuilder = NetworkBuilder::new();
    builder.node(0, Position { latitude: -35.0, longitude: 149.0 }).unwrap();
    builder.node(1, Position { latitude: -35.0, longitude: 149.01 }).unwrap();
    builder.both_ways(0, 1, RoadClass::Street).unwrap();
    let network = builder.build().unwrap();
    let index = EdgeIndex::new(&network);
    for latitude in [90.0, -90.0, 89.999_99, -89.999_99] {
        let mut near = Vec::new();
        index.near(&network, Position { latitude, longitude: 149.0 }, 1000.0, &mut near);
        assert!(near.is_empty(), "{latitude}: {near:?}");
    }
}

/// Distant positions, both directions, invalid positions, and no edges.
#[test]
fn the_nearest_edge() {
    let mut builder = NetworkBuilder::new();
    for (id, x) in [(0, 0.0), (1, 100.0), (2, 300.0)] {
        builder.node(id, at(x, 0.0)).unwrap();
    }
    builder.both_ways(0, 1, RoadClass::Street).unwrap();
    builder.both_ways(1, 2, RoadClass::Street).unwrap();
    let network = builder.build().unwrap();
    let index = EdgeIndex::new(&network);
    let street = network.edge_between(1, 2).unwrap();
    let nearest = index.nearest(&network, at(180.0, 50_000.0)).unwrap();
    assert_eq!((nearest.edge, nearest.metres_along), (street, 80.0));
    assert_eq!((nearest.metres_off, nearest.position(&network)), (50_000.0, at(180.0, 0.0)));
    // At a node of four edges, the lowest.
    assert_eq!(index.nearest(&network, at(100.0, 0.0)).unwrap().edge, 0);
    for x in [f64::NAN, f64::INFINITY] {
        assert!(index.nearest(&network, at(x, 0.0)).is_none());
    }
    let mut builder = NetworkBuilder::new();
    builder.node(0, at(0.0, 0.0)).unwrap();
    let empty = builder.build().unwrap();
    assert!(EdgeIndex::new(&empty).nearest(&empty, at(0.0, 0.0)).is_none());
}

/// The line of a road may be tiny, whatever the road's length.
#[test]
fn lines_without_length() {
    for x in [0.0, f64::from_bits(1), 1e-300] {
        let mut builder = NetworkBuilder::new();
        builder.node(1, at(0.0, 0.0)).unwrap();
        builder.node(2, at(x, 0.0)).unwrap();
        let options = EdgeOptions::of(RoadClass::Street).with_metres(1e5);
        builder.edge(1, 2, options).unwrap();
        let Ok(network) = builder.build() else { continue };
        let index = EdgeIndex::new(&network);
        let near = index.nearest(&network, at(3.0, 4.0)).unwrap();
        assert!((0.0..=1e5).contains(&near.metres_along), "{x:e}: {near:?}");
        assert_eq!(near.metres_off, 5.0);
    }
}
