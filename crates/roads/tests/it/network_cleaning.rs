//! Cleaning of networks, against brute force.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{PlanePosition, RoadClass};
use wayfix_roads::{Cleaning, EdgeOptions, NetworkBuilder, NetworkError, RoadNetwork};

use crate::kit::cases;

type Network = RoadNetwork<PlanePosition>;

/// A random network of up to 12 nodes in a square of 100 m, sparse enough for chains; ids are the
/// indices.
fn any_network() -> impl Strategy<Value = Network> {
    let nodes = vec((0.0..100.0, 0.0..100.0), 1..12);
    let edges = vec((0_u64..12, 0_u64..12, any::<bool>(), 0..8, 1.0..3.0), 0..16);
    let turns = vec((0_usize..100, 0_usize..100), 0..4);
    (nodes, edges, turns).prop_map(|(nodes, edges, turns)| {
        let mut builder = NetworkBuilder::new();
        for (&(x, y), id) in nodes.iter().zip(0..) {
            builder.node(id, PlanePosition { x, y }).unwrap();
        }
        let at = |id: u64| PlanePosition { x: nodes[id as usize].0, y: nodes[id as usize].1 };
        let mut ends = Vec::new();
        for (from, to, both, class, stretch) in edges {
            let [from, to] = [from, to].map(|id| id % nodes.len() as u64);
            let class = if class == 0 { RoadClass::Main } else { RoadClass::Street };
            let metres = Some(at(from).metres_to(at(to)).max(1.0) * stretch);
            let options = || EdgeOptions::of(class).with_metres(metres);
            let there = builder.edge(from, to, options()).unwrap();
            ends.push((from, to));
            if both {
                let back = builder.edge(to, from, options()).unwrap();
                ends.push((to, from));
                builder.pair(there, back);
            }
        }
        for (edge, next) in turns {
            if !ends.is_empty() {
                let edge = edge % ends.len();
                let onward: Vec<usize> =
                    (0..ends.len()).filter(|&e| ends[e].0 == ends[edge].1).collect();
                if !onward.is_empty() {
                    builder.forbid(edge, onward[next % onward.len()]);
                }
            }
        }
        builder.build().unwrap()
    })
}

/// Least metres from each node to each other one, by Floyd and Warshall.
fn distances(network: &Network) -> Vec<Vec<f64>> {
    let n = network.nodes().len();
    let mut metres = vec![vec![f64::INFINITY; n]; n];
    (0..n).for_each(|i| metres[i][i] = 0.0);
    for edge in network.edges() {
        metres[edge.from][edge.to] = metres[edge.from][edge.to].min(edge.metres);
    }
    for k in 0..n {
        for i in 0..n {
            for j in 0..n {
                metres[i][j] = metres[i][j].min(metres[i][k] + metres[k][j]);
            }
        }
    }
    metres
}

/// Index in the old network of each node.
fn old(before: &Network, after: &Network) -> Vec<usize> {
    after.nodes().iter().map(|node| before.index_of_id(node.id).unwrap()).collect()
}

/// Properties of every network: each edge's line begins and ends at its nodes, and reverses are
/// mutual.
fn is_whole(network: &Network) {
    for (e, edge) in network.edges().iter().enumerate() {
        let (shape, ends) =
            (network.shape(e), [edge.from, edge.to].map(|n| network.nodes()[n].position));
        assert_eq!([shape[0], shape[shape.len() - 1]], ends);
        let straight = ends[0].metres_to(ends[1]);
        assert!(edge.metres >= straight * (1.0 - 1e-12), "{edge:?} {straight}");
        if let Some(back) = network.reverse(e) {
            assert_eq!(network.reverse(back), Some(e));
            let other = network.edges()[back];
            assert_eq!((other.from, other.to), (edge.to, edge.from));
        }
    }
    for (edge, next) in network.forbidden_turns() {
        assert_eq!(network.edges()[edge].to, network.edges()[next].from);
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn contraction_keeps_distances_lengths_and_turns(network in any_network()) {
        let (contracted, step) = network.contracted();
        is_whole(&contracted);
        prop_assert_eq!(step.operation, Cleaning::Contraction);
        let (before, after) = (distances(&network), distances(&contracted));
        let old = old(&network, &contracted);
        for (i, &a) in old.iter().enumerate() {
            for (j, &b) in old.iter().enumerate() {
                let (x, y) = (before[a][b], after[i][j]);
                prop_assert!(x == y || (x - y).abs() <= 1e-9 * x, "{x} {y}");
            }
        }
        let total = |n: &Network| n.edges().iter().map(|edge| edge.metres).sum::<f64>();
        prop_assert!((total(&network) - total(&contracted)).abs() <= 1e-9 * total(&network));
        // Each contracted node was between two neighbours, and is now a point of a line.
        for node in network.nodes().iter().filter(|node| contracted.index_of_id(node.id).is_none()) {
            let on_line = (0..contracted.edges().len()).any(|e| contracted.shape(e).contains(&node.position));
            prop_assert!(on_line);
        }
        // Turns at the remaining nodes are unchanged, except U-turns at a contracted node.
        for (edge, next) in network.forbidden_turns() {
            let via = network.nodes()[network.edges()[edge].to].id;
            let back = network.reverse(edge) == Some(next)
                || network.edges()[edge].from == network.edges()[next].to;
            prop_assert!(contracted.index_of_id(via).is_some() || back);
        }
        let kept = network.forbidden_turns().filter(|turn| {
            contracted.index_of_id(network.nodes()[network.edges()[turn.0].to].id).is_some()
        });
        prop_assert_eq!(kept.count(), contracted.forbidden_turns().len());
    }

    #[test]
    fn the_largest_component_is_connected_and_maximal(network in any_network()) {
        let reach = distances(&network);
        let n = network.nodes().len();
        let component = |i: usize| -> Vec<usize> {
            (0..n).filter(|&j| reach[i][j].is_finite() && reach[j][i].is_finite()).collect()
        };
        // The first among the largest.
        let expected = (0..n).map(component).reduce(|a, b| if b.len() > a.len() { b } else { a });
        let expected = expected.unwrap();
        let (largest, step) = network.largest_component();
        is_whole(&largest);
        prop_assert_eq!(old(&network, &largest), expected.clone());
        prop_assert_eq!(step.nodes, [n, expected.len()]);
        let inside = network.edges().iter().filter(|e| expected.contains(&e.from) && expected.contains(&e.to));
        prop_assert_eq!(step.edges, [network.edges().len(), inside.count()]);
        let turns = network.forbidden_turns().filter(|turn| {
            let (a, b) = (network.edges()[turn.0], network.edges()[turn.1]);
            [a.from, a.to, b.to].iter().all(|node| expected.contains(node))
        });
        prop_assert_eq!(step.forbidden_turns[1], turns.count());
    }

    #[test]
    fn merging_keeps_reachability_and_bounds(network in any_network(), metres in 0.0..60.0_f64) {
        let (merged, _) = network.merged(metres).unwrap();
        is_whole(&merged);
        // Every old node has a new one within the radius; if there is only one, it is known.
        let near = |node: usize| -> Vec<usize> {
            let position = network.nodes()[node].position;
            let close = |m: &usize| merged.nodes()[*m].position.metres_to(position) <= metres + 1e-9;
            (0..merged.nodes().len()).filter(close).collect()
        };
        let near: Vec<_> = (0..network.nodes().len()).map(near).collect();
        prop_assert!(near.iter().all(|near| !near.is_empty()));
        let (before, after) = (distances(&network), distances(&merged));
        for (i, row) in before.iter().enumerate() {
            for (j, metres) in row.iter().enumerate() {
                if let ([a], [b], true) = (&near[i][..], &near[j][..], metres.is_finite()) {
                    prop_assert!(after[*a][*b].is_finite());
                }
            }
        }
        // Long edges remain.
        let long = |n: &Network| n.edges().iter().filter(|edge| edge.metres > 2.0 * metres).count();
        prop_assert!(long(&merged) >= long(&network));
    }

    #[test]
    fn no_dead_end_is_left(network in any_network()) {
        let (open, _) = network.without_dead_ends();
        is_whole(&open);
        let neighbors = |network: &Network, kept: &[bool], n: usize| {
            let joins = network.edges().iter().filter_map(|edge| match (edge.from == n, edge.to == n) {
                (true, false) => Some(edge.to),
                (false, true) => Some(edge.from),
                _ => None,
            });
            let mut joins: Vec<usize> = joins.filter(|&other| kept[other]).collect();
            joins.sort_unstable();
            joins.dedup();
            joins.len()
        };
        let mut kept = vec![true; network.nodes().len()];
        while let Some(n) = (0..kept.len()).find(|&n| kept[n] && neighbors(&network, &kept, n) <= 1) {
            kept[n] = false;
        }
        kept[0] |= !kept.contains(&true);
        let expected: Vec<usize> = (0..kept.len()).filter(|&n| kept[n]).collect();
        prop_assert_eq!(old(&network, &open), expected);
    }

    #[test]
    fn a_box_holds_its_nodes(network in any_network(), a in -10.0..110.0, b in -10.0..110.0) {
        let corners = [PlanePosition { x: a, y: -10.0 }, PlanePosition { x: b, y: 110.0 }];
        let inside = |n: &usize| (f64::min(a, b)..=f64::max(a, b)).contains(&network.nodes()[*n].position.x);
        let expected: Vec<usize> = (0..network.nodes().len()).filter(inside).collect();
        match network.within(corners) {
            Ok((cut, _)) => {
                is_whole(&cut);
                prop_assert_eq!(old(&network, &cut), expected);
            }
            Err(NetworkError::EmptyBox { .. }) => prop_assert!(expected.is_empty()),
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn steps_compose(network in any_network()) {
        let cleaning = [
            Cleaning::LargestComponent,
            Cleaning::DeadEnds,
            Cleaning::Contraction,
            Cleaning::Merging { metres: 20.0 },
            Cleaning::Contraction,
        ];
        let (cleaned, steps) = network.clone().cleaned(&cleaning).unwrap();
        is_whole(&cleaned);
        prop_assert_eq!(steps.iter().map(|step| step.operation).collect::<Vec<_>>(), cleaning);
        prop_assert_eq!(steps[0].nodes[0], network.nodes().len());
        prop_assert!(steps.windows(2).all(|pair| pair[0].edges[1] == pair[1].edges[0]));
        prop_assert_eq!(steps[4].nodes[1], cleaned.nodes().len());
        // Strongly connected networks remain so.
        prop_assert!(distances(&cleaned).iter().flatten().all(|metres| metres.is_finite()));
    }
}

/// Nodes on a line, 100 m apart.
fn line(nodes: u64) -> NetworkBuilder<PlanePosition> {
    let mut builder = NetworkBuilder::new();
    for id in 0..nodes {
        builder.node(id, PlanePosition { x: 100.0 * id as f64, y: 0.0 }).unwrap();
    }
    builder
}

#[test]
fn contraction_stops_at_changes_turns_and_dead_ends() {
    let mut builder = line(8);
    let mut edges = Vec::new();
    for (from, class) in (0..7).zip([RoadClass::Street; 4].into_iter().chain([RoadClass::Main; 3]))
    {
        edges.push(builder.both_ways(from, from + 1, class).unwrap());
    }
    // 2 is kept because of a forbidden turn, 4 because of the class.
    builder.forbid(edges[1], edges[2]);
    let (contracted, step) = builder.build().unwrap().contracted();
    let ids: Vec<u64> = contracted.nodes().iter().map(|node| node.id).collect();
    assert_eq!(ids, [0, 2, 4, 7]);
    assert_eq!(step.to_string(), "contracted: 8 → 4 nodes, 14 → 6 edges, 1 → 1 forbidden turns");
    let there = contracted.edge_between(0, 1).unwrap();
    assert_eq!(contracted.reverse(there), contracted.edge_between(1, 0));
    assert!(!contracted.may_turn(there, contracted.edge_between(1, 2).unwrap()));
}

#[test]
fn one_way_roads_there_and_back_keep_their_end() {
    // 0 → 1 → 2 → 3 → 0 are carriageways that end at 2, where a road to 4 begins.
    let mut builder = line(6);
    for (a, b) in [(0, 1), (1, 2), (2, 3), (3, 0)] {
        builder.one_way(a, b, RoadClass::Main).unwrap();
    }
    builder.both_ways(2, 4, RoadClass::Main).unwrap();
    builder.both_ways(0, 5, RoadClass::Main).unwrap();
    let (contracted, _) = builder.build().unwrap().contracted();
    let ids: Vec<u64> = contracted.nodes().iter().map(|node| node.id).collect();
    assert_eq!(ids, [0, 2, 4, 5]);
}

#[test]
fn rings_become_loops() {
    // A ring of 1, 2, 3 at the end of a road, and a ring of its own of 4, 5, 6.
    let mut builder = line(7);
    builder.both_ways(0, 1, RoadClass::Street).unwrap();
    for (a, b) in [(1, 2), (2, 3), (3, 1)] {
        builder.both_ways(a, b, RoadClass::Street).unwrap();
    }
    for (a, b) in [(4, 5), (5, 6), (6, 4)] {
        builder.one_way(a, b, RoadClass::Street).unwrap();
    }
    let (contracted, _) = builder.build().unwrap().contracted();
    let ids: Vec<u64> = contracted.nodes().iter().map(|node| node.id).collect();
    assert_eq!(ids, [0, 1, 4]);
    let loops: Vec<usize> = (0..contracted.edges().len())
        .filter(|&e| contracted.edges()[e].from == contracted.edges()[e].to)
        .collect();
    assert_eq!(loops.len(), 3);
    assert!(loops.iter().all(|&e| contracted.edges()[e].metres == 400.0));
    assert_eq!(contracted.reverse(loops[0]), Some(loops[1]));
    assert_eq!(contracted.reverse(loops[2]), None);
}

#[test]
fn a_long_road_takes_no_stack() {
    let mut builder = line(300_000);
    for from in 0..299_999 {
        builder.both_ways(from, from + 1, RoadClass::Street).unwrap();
    }
    let network = builder.build().unwrap();
    assert_eq!(network.largest_component().0.nodes().len(), 300_000);
    assert_eq!(network.contracted().0.nodes().len(), 2);
    assert_eq!(network.without_dead_ends().0.nodes().len(), 1);
}

#[test]
fn chains_of_short_roads_are_not_drawn_together() {
    let mut builder = line(10);
    for from in 0..9 {
        builder.both_ways(from, from + 1, RoadClass::Street).unwrap();
    }
    let network = builder.build().unwrap();
    let xs = |metres: f64| -> Vec<f64> {
        network.merged(metres).unwrap().0.nodes().iter().map(|node| node.position.x).collect()
    };
    assert_eq!(xs(99.0).len(), 10);
    let merged = xs(100.0);
    assert!(merged.len() >= 4 && merged.len() <= 5, "{merged:?}");
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(network.merged(bad), Err(NetworkError::Parameter(_))));
    }
}
