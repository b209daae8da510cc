//! Cells of edges, positions and groups.

use proptest::prelude::*;
use wayfix::map::PlanePosition;
use wayfix_roads::cells::RoadCells;
use wayfix_roads::{NetworkBuilder, RoadNetwork};

use super::{aisles, networks};
use crate::kit::{cases, text};

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn edges_are_cut_into_equal_cells(cells in networks(4, 6)) {
        let network = cells.network();
        let mut next = 0;
        for (edge, road) in network.edges().iter().enumerate() {
            let range = cells.cells(edge);
            prop_assert_eq!(range.start, next);
            prop_assert_eq!(range.len(), (1..10).find(|&n| road.metres < n as f64 + 0.5).unwrap());
            let size = road.metres / range.len() as f64;
            for (number, cell) in range.clone().enumerate() {
                prop_assert_eq!(cells.edge(cell), edge);
                let stretch = cells.stretch(cell);
                prop_assert!((stretch.start - number as f64 * size).abs() < 1e-12);
                prop_assert!((stretch.end - stretch.start - size).abs() < 1e-12);
                prop_assert_eq!(cells.cell_at(edge, cells.metres_along(cell)), cell);
            }
            prop_assert_eq!(cells.cell_at(edge, -1.0), range.start);
            prop_assert_eq!(cells.cell_at(edge, f64::NAN), range.start);
            prop_assert_eq!(cells.cell_at(edge, road.metres), range.end - 1);
            prop_assert_eq!(cells.cell_at(edge, f64::INFINITY), range.end - 1);
            next = range.end;
        }
        prop_assert_eq!(cells.states(), next);
        let total: f64 = network.edges().iter().map(|edge| edge.metres).sum();
        prop_assert!((cells.mean_metres() * next as f64 - total).abs() < 1e-9);
    }

    #[test]
    fn groups_are_edges_roads_and_places(cells in networks(4, 6)) {
        let network = cells.network();
        let (edges, roads, places) = (cells.by_edge(), cells.by_road(), cells.by_place());
        for a in 0..cells.states() {
            prop_assert_eq!(edges.group_of(a), Some(cells.edge(a)));
            for b in 0..cells.states() {
                let (one, other) = (cells.edge(a), cells.edge(b));
                let pair = network.reverse(one) == Some(other) && network.reverse(other) == Some(one);
                prop_assert_eq!(roads.group_of(a) == roads.group_of(b), one == other || pair);
                let same = cells.cells(one).len() == cells.cells(other).len();
                if pair && !same {
                    continue;
                }
                let opposite = pair
                    && a - cells.cells(one).start + b - cells.cells(other).start + 1
                        == cells.cells(one).len();
                prop_assert_eq!(places.group_of(a) == places.group_of(b), a == b || opposite);
            }
        }
        // All groups have a cell.
        prop_assert!(wayfix::likelihood::Groups::new(places.as_slice().to_vec()).is_ok());
        prop_assert!(wayfix::likelihood::Groups::new(roads.as_slice().to_vec()).is_ok());
    }

    #[test]
    fn a_position_is_on_the_nearest_road(x in -3.0..15.0_f64, y in -3.0..15.0_f64) {
        let cells = RoadCells::new(aisles(4, 4, 3.0), 1.0).unwrap();
        let at = cells.project(PlanePosition { x, y });
        let network: &RoadNetwork<_> = cells.network();
        for edge in 0..network.edges().len() {
            let there = network.project(edge, PlanePosition { x, y });
            prop_assert!(there.metres_off >= at.metres_off);
            prop_assert!(edge >= at.edge || there.metres_off > at.metres_off);
        }
        let cell = cells.nearest(PlanePosition { x, y });
        prop_assert!(cells.stretch(cell).contains(&at.metres_along.min(2.999)));
        let middle = cells.position(cell);
        prop_assert!((middle.metres_to(at.position(cells.network()))) <= 0.5 + 1e-9);
        let ahead = at.metres_along - cells.metres_along(cell);
        prop_assert!(cells.position_ahead(cell, ahead).metres_to(at.position(cells.network())) < 1e-9);
    }
}

#[test]
fn an_edge_of_another_length_has_the_same_places() {
    let mut builder = NetworkBuilder::new();
    builder.node(1, PlanePosition { x: 0.0, y: 0.0 }).unwrap();
    builder.node(2, PlanePosition { x: 4.0, y: 0.0 }).unwrap();
    let class = wayfix::map::RoadClass::Street;
    let options = wayfix_roads::EdgeOptions::of(class).with_metres(8.0);
    let there = builder.one_way(1, 2, class).unwrap();
    let back = builder.edge(2, 1, options).unwrap();
    builder.pair(there, back);
    let cells = RoadCells::new(builder.build().unwrap(), 1.0).unwrap();
    assert_eq!(cells.by_place().as_slice(), [0, 1, 2, 3, 3, 3, 2, 2, 1, 1, 0, 0]);
    assert_eq!(cells.by_road().count(), 1);
    // 12 m in 12 cells: all have the mean length.
    assert_eq!((cells.mean_metres(), cells.rounding()), (1.0, 0.0));
}

#[test]
fn rounding_is_the_variance_of_lengths() {
    let mut builder = NetworkBuilder::new();
    for (id, x) in [(1, 0.0), (2, 10.6), (3, 20.0)] {
        builder.node(id, PlanePosition { x, y: 0.0 }).unwrap();
    }
    builder.one_way(1, 2, wayfix::map::RoadClass::Street).unwrap();
    builder.one_way(2, 3, wayfix::map::RoadClass::Street).unwrap();
    let cells = RoadCells::new(builder.build().unwrap(), 2.0).unwrap();
    // Five cells on 10.6 m and five on 9.4 m.
    assert_eq!(cells.mean_metres(), 2.0);
    assert!((cells.rounding() - 2.0 * 0.6_f64.powi(2) / 20.0).abs() < 1e-12);
}

#[test]
fn bad_spacings_are_errors() {
    let network = std::sync::Arc::new(aisles(2, 2, 3.0));
    for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = text(RoadCells::new(network.clone(), spacing));
        assert_eq!(found, format!("the spacing of cells is {spacing}, expected metres above 0"));
    }
    assert_eq!(
        text(RoadCells::new(network, 1e-9)),
        "roads have 24000000000 cells of 0.000000001 m, expected at most 4294967295 (32-bit indices)"
    );
    let mut empty: NetworkBuilder<PlanePosition> = NetworkBuilder::new();
    empty.node(1, PlanePosition { x: 0.0, y: 0.0 }).unwrap();
    let found = text(RoadCells::new(empty.build().unwrap(), 1.0));
    assert_eq!(found, "cells need at least one road, found none");
}
