//! Routes against the enumeration of all sequences of states.

use std::collections::BTreeMap;

use proptest::collection::vec;
use proptest::prelude::*;

use super::RouteSearcher;
use super::lattice::Lattice;
use crate::matching::candidates::{Candidate, OFF_ROAD};
use crate::matching::step::MatchStep;
use crate::matching::{MatchModel, MatchedDrive, Matcher, Stretch, TracePoint};
use crate::{EdgeOptions, NetworkBuilder, RoadNetwork};
use wayfix::map::{PlanePosition, RoadClass};

type Words = Vec<Option<usize>>;

/// Networks of up to 5 nodes, with loops, parallel edges, dead ends, one-way streets and forbidden
/// turns.
fn any_network() -> impl Strategy<Value = RoadNetwork<PlanePosition>> {
    let nodes = vec((0..4_u32, 0..4_u32), 2..=5);
    let edges = vec((0..5_usize, 0..5_usize, any::<bool>(), any::<bool>()), 1..6);
    let turns = vec((0..100_usize, 0..100_usize), 0..3);
    (nodes, edges, turns).prop_map(|(nodes, edges, turns)| {
        let mut builder = NetworkBuilder::new();
        for (id, &(x, y)) in nodes.iter().enumerate() {
            let position = PlanePosition { x: 40.0 * f64::from(x), y: 30.0 * f64::from(y) };
            builder.node(id as u64, position).unwrap();
        }
        let mut ends = Vec::new();
        for (from, to, both, bends) in edges {
            let (from, to) = (from % nodes.len(), to % nodes.len());
            let between = PlanePosition { x: 70.0, y: 40.0 };
            let bends = bends || nodes[from] == nodes[to];
            let between = if bends { vec![between] } else { Vec::new() };
            let options = || EdgeOptions::of(RoadClass::Street).with_between(between.clone());
            let there = builder.edge(from as u64, to as u64, options()).unwrap();
            ends.push((from, to));
            if both && from != to {
                let back = builder.edge(to as u64, from as u64, options()).unwrap();
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

fn words(route: &[Stretch<PlanePosition>]) -> Words {
    route.iter().map(|stretch| stretch.edge).collect()
}

/// Checks that edges are consecutive and stretches have a length, except for an edge and its
/// reverse in place of a forbidden turn.
fn is_connected(network: &RoadNetwork<PlanePosition>, route: &[Stretch<PlanePosition>]) {
    let is_short = |at: usize| {
        route.get(at).is_some_and(|part| part.edge.is_some() && part.exit - part.enter == 0.0)
    };
    for (at, stretch) in route.iter().enumerate() {
        let Some(edge) = stretch.edge else { continue };
        let both = is_short(at + 1) || at > 0 && is_short(at - 1);
        let may_be_short = route.len() == 1 || both && network.forbidden_turns().len() > 0;
        assert!(stretch.exit > stretch.enter || may_be_short, "{route:?}");
        assert!(stretch.enter >= 0.0 && stretch.exit <= network.edges()[edge].metres, "{route:?}");
    }
    for pair in route.windows(2) {
        let [Some(edge), Some(next)] = [pair[0].edge, pair[1].edge] else {
            assert_ne!(pair[0].edge, pair[1].edge);
            continue;
        };
        let length = network.edges()[edge].metres;
        let follows = network.next(edge).any(|other| other == next);
        let at_end = pair[0].exit == length && pair[1].enter == 0.0;
        // A U-turn at the same place, or at the end of an edge whose reverse may be shorter.
        let apart = network.edges()[next].metres - pair[0].exit - pair[1].enter;
        let turned = network.reverse(edge) == Some(next) && (apart.abs() < 1e-6 || at_end);
        assert!(follows && at_end || turned, "{route:?}");
    }
}

/// All routes, with the sums of the probabilities of their sequences of states.
fn enumerate(
    matcher: &Matcher<PlanePosition>,
    drive: &MatchedDrive<PlanePosition>,
    step: &mut MatchStep<'_, PlanePosition>,
) -> BTreeMap<Words, f64> {
    let mut paths: Vec<(Vec<usize>, f64)> = vec![(Vec::new(), -drive.log_likelihood())];
    for number in 1..=drive.states.len() {
        let mut longer = Vec::new();
        for to in 0..drive.states[number - 1].len() {
            let log_likelihood = drive.trellis.log_likelihood(number, to);
            for (from, weight) in drive.trellis.moves(number, to) {
                for (path, log) in &paths {
                    if number == 1 || path[number - 2] == from {
                        let path = path.iter().copied().chain([to]).collect();
                        longer.push((path, log + weight + log_likelihood));
                    }
                }
            }
        }
        paths = longer;
    }
    let mut all = BTreeMap::new();
    for (path, log) in paths {
        let states: Vec<Candidate> =
            path.iter().zip(&drive.states).map(|(state, states)| states[*state]).collect();
        let route = super::route(&matcher.network, &drive.points, &states, step);
        is_connected(&matcher.network, &route);
        *all.entry(words(&route)).or_default() += log.exp();
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn routes_equal_enumeration(
        network in any_network(),
        places in vec((0..5_usize, 0..8_u32, -10.0..10.0, -10.0..10.0, 0.5..20.0), 1..=4),
        leave_road in prop_oneof![Just(5e-4), Just(0.1)],
        u_turn in prop_oneof![Just(2e-3), Just(0.3)],
        count in 1..8_usize,
    ) {
        let mut time = 0.0;
        let points: Vec<_> = places.iter().map(|&(node, share, x, y, seconds)| {
            // At a node, beside one, or on the way to the next.
            let nodes = network.nodes();
            let [a, b] = [node, node + 1].map(|node| nodes[node % nodes.len()].position);
            let share = f64::from(share.saturating_sub(4)) / 4.0;
            let noise = if share == 0.0 { 0.0 } else { 1.0 };
            let position = PlanePosition {
                x: a.x + share * (b.x - a.x) + noise * x,
                y: a.y + share * (b.y - a.y) + noise * y,
            };
            time += seconds;
            TracePoint::new(time, position)
        }).collect();
        let model = MatchModel { noise: 5.0, leave_road, u_turn, ..MatchModel::default() };
        let matcher = Matcher::new(network).with_model(model).unwrap();
        let drive = matcher.match_drive(&points).unwrap();
        let mut step = MatchStep::new(&matcher, &matcher.model);
        is_connected(&matcher.network, drive.route());
        let expected = enumerate(&matcher, &drive, &mut step);

        let found = matcher.routes(&drive, usize::MAX).unwrap();
        prop_assert!(found.is_exact && found.remaining < 1e-9, "{}", found.remaining);
        let mut likely = expected.clone();
        likely.retain(|_, probability| *probability > 1e-20);
        for route in &found.routes {
            let words = words(&route.stretches);
            is_connected(&matcher.network, &route.stretches);
            let expected = expected.get(&words).copied().unwrap_or(0.0);
            prop_assert!((route.probability - expected).abs() < 1e-9 * expected, "{route:?} {expected}");
            likely.remove(&words);
        }
        prop_assert!(likely.is_empty(), "missing: {likely:?}");
        let mut distinct: Vec<Words> = found.routes.iter().map(|r| words(&r.stretches)).collect();
        distinct.sort();
        distinct.dedup();
        prop_assert_eq!(distinct.len(), found.routes.len());
        prop_assert!(found.routes.is_sorted_by(|a, b| a.probability >= b.probability));

        // A few routes are the first of all routes, up to the order of ties.
        let few = matcher.routes(&drive, count).unwrap();
        prop_assert!(few.is_exact);
        prop_assert_eq!(few.routes.len(), count.min(found.routes.len()));
        for (route, best) in few.routes.iter().zip(&found.routes) {
            prop_assert!((route.probability - best.probability).abs() <= 1e-9 * best.probability);
        }
        let sum: f64 = few.routes.iter().map(|route| route.probability).sum();
        prop_assert!((sum + few.remaining - 1.0).abs() < 1e-9);

        // A search cut off at once finds as many, with exact probabilities, and reports that it is
        // not exact.
        let lattice = Lattice::new(&matcher.network, &drive, &mut step);
        let cut = RouteSearcher::new(&lattice).find(count, 0);
        prop_assert!(!cut.is_exact);
        prop_assert_eq!(cut.routes.len(), few.routes.len());
        for (route, probability) in cut.routes {
            let edge = |word: u32| (word != OFF_ROAD).then_some(word as usize);
            let expected = expected[&route.into_iter().map(edge).collect::<Words>()];
            prop_assert!((probability - expected).abs() < 1e-9 * expected);
        }
    }
}
