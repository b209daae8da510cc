//! Route searches against brute force.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::RoadClass;
use wayfix_roads::{EdgeOptions, NetworkBuilder, RouteCosts, RouteMeasures, RouteSearch};

use super::city::{Network, at};
use crate::kit::cases;

/// Up to 6 nodes with loops, parallel edges, dead ends, one-way streets and forbidden turns.
fn any_network() -> impl Strategy<Value = Network> {
    let edges = vec((0..6_u64, 0..6_u64, any::<bool>(), 1..20_u32), 1..12);
    let turns = vec((0..100_usize, 0..100_usize), 0..5);
    (1..=6_u64, edges, turns).prop_map(|(nodes, edges, turns)| {
        let mut builder = NetworkBuilder::new();
        (0..nodes).for_each(|n| {
            builder.node(n, at(n as f64, 0.0)).unwrap();
        });
        let mut ends = Vec::new();
        for (from, to, both, metres) in edges {
            let (from, to) = (from % nodes, to % nodes);
            let options = || EdgeOptions::of(RoadClass::Street).with_metres(f64::from(metres));
            let there = builder.edge(from, to, options()).unwrap();
            ends.push((from, to));
            if both && from != to {
                let back = builder.edge(to, from, options()).unwrap();
                ends.push((to, from));
                builder.pair(there, back);
            }
        }
        for (edge, next) in turns {
            let edge = edge % ends.len();
            let onward: Vec<usize> =
                (0..ends.len()).filter(|&e| ends[e].0 == ends[edge].1).collect();
            if !onward.is_empty() {
                builder.forbid(edge, onward[next % onward.len()]);
            }
        }
        builder.build().unwrap()
    })
}

fn weight(edge: usize, next: usize) -> f64 {
    1.0 + ((3 * edge + next) % 4) as f64
}

/// −ln p of the turn from an edge to the next, without U-turns.
fn log_choice(network: &Network, edge: usize, taken: usize) -> f64 {
    let back = network.reverse(edge);
    let ways = network.next(edge).filter(|next| Some(*next) != back);
    let sum: f64 = ways.map(|next| weight(edge, next)).sum();
    if Some(taken) == back { 0.0 } else { (sum / weight(edge, taken)).ln() }
}

/// Cost of the turn from an edge to the next; a U-turn costs extra if there is another way on.
fn turn(network: &Network, edge: usize, next: usize, [u_turn, choice]: [f64; 2]) -> f64 {
    let back = network.reverse(edge);
    let goes_on = network.next(edge).any(|next| Some(next) != back);
    let u_turn = if goes_on && Some(next) == back { u_turn } else { 0.0 };
    u_turn + choice * log_choice(network, edge, next)
}

/// Least cost from the end of an edge to the start of each, by Bellman and Ford.
fn costs(network: &Network, from: usize, u_turn: [f64; 2]) -> Vec<f64> {
    let edges = network.edges();
    let mut cost = vec![f64::INFINITY; edges.len()];
    for next in network.next(from) {
        cost[next] = cost[next].min(turn(network, from, next, u_turn));
    }
    for _ in 0..=edges.len() {
        for edge in 0..edges.len() {
            for next in network.next(edge) {
                let through = cost[edge] + edges[edge].metres + turn(network, edge, next, u_turn);
                cost[next] = cost[next].min(through);
            }
        }
    }
    cost
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn equal_brute_force(
        network in any_network(),
        searches in vec((0..100_usize, vec(0..100_usize, 1..6), 0..60_u32, 0..30_u32, 0..20_u32), 1..4),
    ) {
        let n = network.edges().len();
        let measures = RouteMeasures::with_turns(&network, weight);
        // All searches share their memory.
        let mut search = RouteSearch::default();
        for (from, targets, most, u_turn, choice) in searches {
            // No cost equals the bound up to rounding.
            let (from, most) = (from % n, f64::from(most) + 0.01);
            let [u_turn, choice] = [f64::from(u_turn), f64::from(choice.saturating_sub(10))];
            let targets: Vec<usize> = targets.iter().map(|target| target % n).collect();
            let route_costs = RouteCosts { u_turn, choice };
            search.set_targets(&network, &measures, targets.iter().copied(), route_costs);
            // An earlier search, from another edge to the same targets, leaves no trace.
            search.run(&network, &measures, (from + 1) % n, 2.0 * most);
            search.run(&network, &measures, from, most);
            let expected = costs(&network, from, [u_turn, choice]);
            for &target in &targets {
                let found = search.reached(target);
                let turns = |found: wayfix_roads::Reached| f64::from(found.u_turns) * u_turn;
                let cost = found.map_or(f64::INFINITY, |found| {
                    found.metres + turns(found) + choice * found.log_choices
                });
                if expected[target] <= most {
                    // Choices are stored in 32 bits.
                    let error = (cost - expected[target]).abs();
                    prop_assert!(error < 1e-4, "from {} to {}: {}", from, target, error);
                } else {
                    prop_assert_eq!(cost, f64::INFINITY, "from {} to {}", from, target);
                }
                let route = search.route(from, target);
                let Some(found) = found else {
                    prop_assert!(route.is_empty());
                    continue;
                };
                prop_assert!(route.len() >= 2);
                prop_assert_eq!([route[0], route[route.len() - 1]], [from, target]);
                for pair in route.windows(2) {
                    prop_assert!(network.next(pair[0]).any(|next| next == pair[1]), "{route:?}");
                }
                let inner = &route[1..route.len() - 1];
                let sum = |values: &dyn Fn(usize) -> f64| inner.iter().map(|&e| values(e)).sum::<f64>();
                prop_assert_eq!(sum(&|e| network.edges()[e].metres), found.metres);
                prop_assert_eq!(sum(&|e| measures.straight_metres(e)), found.chords);
                let counts = route.windows(2).map(|pair| turn(&network, pair[0], pair[1], [1.0, 0.0]));
                prop_assert_eq!(counts.sum::<f64>(), f64::from(found.u_turns));
                let choices: f64 =
                    route.windows(2).map(|pair| log_choice(&network, pair[0], pair[1])).sum();
                prop_assert!((choices - found.log_choices).abs() < 1e-5);
            }
        }
    }
}

/// A winding way of up to 30 nodes, with edges to the next three nodes whose lengths are straight,
/// longer, rounded to centimetres, half of the straight line, or a centimetre.
fn short_edges() -> impl Strategy<Value = Network> {
    let steps = vec((-3.0..9.0, -4.0..4.0), 2..30);
    let edges = vec((0..30_usize, 1..4_usize, 0..12_u32, any::<bool>()), 10..90);
    (steps, edges).prop_map(|(steps, edges)| {
        let mut builder = NetworkBuilder::new();
        let (mut nodes, mut here) = (Vec::new(), [0.0, 0.0]);
        for (x, y) in steps {
            here = [here[0] + x, here[1] + y];
            builder.node(nodes.len() as u64, at(here[0], here[1])).unwrap();
            nodes.push(here);
        }
        for (from, ahead, length, forward) in edges {
            let (from, to) = (from % nodes.len(), (from + ahead) % nodes.len());
            let straight = (nodes[to][0] - nodes[from][0]).hypot(nodes[to][1] - nodes[from][1]);
            let metres = match length {
                0 => 0.01,
                1 => 0.5 * straight,
                2..=6 => (100.0 * straight).round() / 100.0,
                7..=9 => straight,
                _ => 1.3 * straight,
            };
            let [from, to] = if forward { [from, to] } else { [to, from] };
            let options = EdgeOptions::of(RoadClass::Street).with_metres(metres.max(0.01));
            builder.edge(from as u64, to as u64, options).unwrap();
        }
        builder.build().unwrap()
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn edges_may_be_shorter_than_straight(
        network in short_edges(), from in 0..100_usize, u_turn in 0.0..9.0,
    ) {
        let n = network.edges().len();
        let (from, costs) = (from % n, RouteCosts { u_turn, choice: 0.0 });
        let measures = RouteMeasures::new(&network);
        let cost = |search: &RouteSearch, target: usize| {
            search.reached(target).map(|found| found.metres + u_turn * f64::from(found.u_turns))
        };
        // Targets all around: no edge is too far away.
        let [mut all, mut search] = [RouteSearch::default(), RouteSearch::default()];
        all.set_targets(&network, &measures, 0..n, costs);
        all.run(&network, &measures, from, 1e9);
        for target in 0..n {
            let Some(expected) = cost(&all, target) else { continue };
            let most = expected + 1e-9;
            search.set_targets(&network, &measures, [target].into_iter(), costs);
            search.run(&network, &measures, from, most);
            let found = cost(&search, target);
            prop_assert!(found.is_some_and(|found| found <= most), "from {from} to {target}: {found:?}");
        }
    }
}

/// A hundred edges of a centimetre instead of five metres each.
#[test]
fn a_way_far_shorter_than_straight() {
    let mut builder = NetworkBuilder::new();
    (0..=100).for_each(|n| {
        builder.node(n, at(4.9 * n as f64, 0.0)).unwrap();
    });
    (0..100).for_each(|n| {
        let options = EdgeOptions::of(RoadClass::Street).with_metres(0.01);
        builder.edge(n, n + 1, options).unwrap();
    });
    let network = builder.build().unwrap();
    let mut search = RouteSearch::default();
    let measures = RouteMeasures::new(&network);
    search.set_targets(&network, &measures, [99].into_iter(), RouteCosts::default());
    search.run(&network, &measures, 0, 1.0);
    assert!((search.reached(99).unwrap().metres - 0.98).abs() < 1e-9);
}

#[test]
fn nothing_is_beyond_the_bound() {
    let mut builder = NetworkBuilder::new();
    (0..5).for_each(|n| {
        builder.node(n, at(100.0 * n as f64, 0.0)).unwrap();
    });
    (0..4).for_each(|n| {
        builder.one_way(n, n + 1, RoadClass::Street).unwrap();
    });
    let network = builder.build().unwrap();
    let mut search = RouteSearch::default();
    let measures = RouteMeasures::new(&network);
    let costs = RouteCosts { u_turn: 10.0, choice: 0.0 };
    search.set_targets(&network, &measures, [3].into_iter(), costs);
    search.run(&network, &measures, 0, 199.0);
    assert_eq!(search.reached(3), None);
    search.run(&network, &measures, 0, 200.0);
    assert_eq!(search.reached(3).unwrap().metres, 200.0);
    assert_eq!(search.route(0, 3), [0, 1, 2, 3]);
    assert_eq!(search.reached(99), None);
    // Without targets, the search ends at once.
    search.set_targets(&network, &measures, [].into_iter(), costs);
    search.run(&network, &measures, 0, 1e9);
    assert_eq!(search.reached(3), None);
}
