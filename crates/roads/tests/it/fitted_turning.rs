//! Turns learned from moves and from counts of traffic.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::error::OutOfRange;
use wayfix::map::{MapError, PlanePosition, RoadClass, RoadMap, TurningProbabilities, TurningRule};
use wayfix::transition::MoveCounts;
use wayfix::{Belief, Fixed, Hmm, Prior, TransitionError, canberra};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, EdgeTurns, TurnWeights};
use wayfix_roads::{NetworkBuilder, NetworkError, RoadNetwork};

use crate::kit::{cases, rng};

/// Strongly connected networks: a ring of all nodes, and other roads.
fn networks() -> impl Strategy<Value = RoadNetwork<PlanePosition>> {
    let class = prop_oneof![Just(RoadClass::Main), Just(RoadClass::Street)];
    let road = (0_u64..8, 0_u64..8, any::<bool>(), class);
    (2_u64..8, vec(road, 0..16)).prop_map(|(nodes, roads)| {
        let mut builder = NetworkBuilder::new();
        for id in 0..nodes {
            let (x, y) = ((id * 7 % 5) as f64, (id * 3 % 7) as f64);
            builder.node(id, PlanePosition { x, y }).unwrap();
        }
        for id in 0..nodes {
            builder.one_way(id, (id + 1) % nodes, RoadClass::Street).unwrap();
        }
        for (from, to, both, class) in roads {
            let [from, to] = [from, to].map(|id| id % nodes);
            if from != to && both {
                builder.both_ways(from, to, class).unwrap();
            } else if from != to {
                builder.one_way(from, to, class).unwrap();
            }
        }
        builder.build().unwrap()
    })
}

fn with_counts() -> impl Strategy<Value = (RoadNetwork<PlanePosition>, Vec<f64>)> {
    networks().prop_flat_map(|network| {
        let counts = vec(1.0..1000.0_f64, network.edges().len());
        (Just(network), counts)
    })
}

/// In- and outflow of each node.
fn through(network: &RoadNetwork<PlanePosition>, flow: &[f64]) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; network.nodes().len()];
    for (edge, flow) in network.edges().iter().zip(flow) {
        sums[edge.to][0] += flow;
        sums[edge.from][1] += flow;
    }
    sums
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-7 * (a.abs() + b.abs())
}

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * (a.abs() + b.abs())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn a_flow_enters_and_leaves_and_is_the_nearest((network, counts) in with_counts()) {
        let flow = network.consistent_flow(&counts).unwrap();
        for [into, out] in through(&network, &flow) {
            prop_assert!(near(into, out), "{into} {out}");
        }
        // The derivative of the relative entropy to any other flow y is Σ (y − x) ln(x / c) = 0.
        let other: Vec<f64> = counts.iter().map(|c| 1.0 + c.sqrt()).collect();
        let other = network.consistent_flow(&other).unwrap();
        let slope = |(x, (y, c)): (&f64, (&f64, &f64))| (y - x) * (x / c).ln();
        let terms: Vec<f64> = flow.iter().zip(other.iter().zip(&counts)).map(slope).collect();
        let size: f64 = terms.iter().map(|term| term.abs()).sum();
        prop_assert!(terms.iter().sum::<f64>().abs() <= 1e-6 * (size + 1.0));
        // Fitting a flow does not change it.
        let again = network.consistent_flow(&flow).unwrap();
        prop_assert!(flow.iter().zip(&again).all(|(a, b)| near(*a, *b)));
    }

    #[test]
    fn turns_of_edges_make_the_flow((network, counts) in with_counts()) {
        let weights = TurnWeights::default();
        let turns = EdgeTurns::fit_traffic(&network, &counts, &weights).unwrap();
        let flow = network.consistent_flow(&counts).unwrap();
        let edges = network.edges().len();
        let (mut sums, mut next, mut behind) = (vec![0.0; edges], vec![0.0; edges], vec![0.0; edges]);
        for turn in turns.turns() {
            sums[turn.from] += turn.probability;
            next[turn.to] += flow[turn.from] * turn.probability;
            behind[turn.from] += turn.count;
        }
        for edge in 0..edges {
            prop_assert!(same(sums[edge], 1.0));
            prop_assert!(near(next[edge], flow[edge]) && near(behind[edge], flow[edge]));
        }
        // Ratios of two edges in and two edges out are those of the weights.
        let cells = RoadCells::new(network.clone(), 1.0).unwrap();
        let prior = CellTransition::new(&cells, &weights).unwrap();
        let fitted = CellTransition::with_turns(&cells, &turns).unwrap();
        for a in 0..edges {
            for b in (0..edges).filter(|&b| network.edges()[a].to == network.edges()[b].to) {
                let [c, d] = [network.next(a).min().unwrap(), network.next(a).max().unwrap()];
                let ratio = |of: &CellTransition| {
                    of.turn(a, c) * of.turn(b, d) / (of.turn(a, d) * of.turn(b, c))
                };
                prop_assert!(near(ratio(&prior), ratio(&fitted)));
            }
        }
    }

    #[test]
    fn the_flow_of_places_lasts((network, counts) in with_counts()) {
        let map = network.to_map().unwrap();
        let counts = &counts[..map.roads().len()];
        let rule = TurningRule::default();
        let learned = TurningProbabilities::fit_traffic(&map, counts, &rule).unwrap();
        let flow = map.consistent_flow(counts).unwrap();
        // If the flow out of places is right, so is the flow into them, and stays change nothing.
        let (mut flow, mut next) = (flow.iter(), vec![0.0; map.places().len()]);
        let mut at = vec![0.0; map.places().len()];
        for (from, at) in at.iter_mut().enumerate() {
            let out: f64 = flow.by_ref().take(map.roads_from(from).len()).sum();
            *at = out / (1.0 - learned.get(from, from));
        }
        for turn in learned.turns() {
            next[turn.to] += at[turn.from] * turn.probability;
        }
        prop_assert!(at.iter().zip(&next).all(|(a, b)| near(*a, *b)), "{at:?} {next:?}");
    }

    #[test]
    fn moves_of_edges_by_the_formula(
        network in networks(),
        path in vec(any::<prop::sample::Index>(), 1..60),
        prior in prop_oneof![Just(0.0), 0.1..20.0_f64],
    ) {
        let mut route = vec![0];
        for choice in path {
            let next: Vec<usize> = network.next(route[route.len() - 1]).collect();
            route.push(next[choice.index(next.len())]);
        }
        let weights = TurnWeights::default();
        let learned =
            EdgeTurns::fit(&network, &MoveCounts::of_path(&route), &weights, prior).unwrap();
        let cells = RoadCells::new(network.clone(), 1.0).unwrap();
        let mean = CellTransition::new(&cells, &weights).unwrap();
        for edge in 0..network.edges().len() {
            let moves = |next| route.windows(2).filter(|pair| **pair == [edge, next]).count() as f64;
            let all: f64 = network.next(edge).map(moves).sum();
            for next in network.next(edge) {
                let expected = if all + prior > 0.0 {
                    (moves(next) + prior * mean.turn(edge, next)) / (all + prior)
                } else {
                    mean.turn(edge, next)
                };
                prop_assert!(same(learned.turn(edge, next), expected));
            }
        }
        let counted: f64 = learned.turns().map(|turn| turn.count).sum();
        prop_assert_eq!(counted, (route.len() - 1) as f64);
    }
}

#[test]
fn simulated_moves_give_their_probabilities_back() {
    let map = canberra::map();
    let truth = canberra::turning().into_transition();
    let anywhere = Prior::AtFirstObservation(Belief::uniform(canberra::PLACES).unwrap());
    let sensor = Fixed(canberra::sensor(1.0).unwrap());
    let drive = Hmm::new(anywhere, truth, sensor).unwrap().simulate(400_000, &mut rng(7));
    let counts = MoveCounts::of_path(drive.states());
    for (weight, bound) in [(0.0, 0.06), (50.0, 0.06), (1e9, 1.0)] {
        // A prior that is far off: equal roads, and half of the time a stay.
        let rule = TurningRule {
            weight: wayfix::map::ByClass::all(1.0),
            straight_on: 1.0,
            stop: wayfix::map::ByClass::all(0.4),
        };
        let learned = TurningProbabilities::fit_with_stays(&map, &counts, &rule, weight).unwrap();
        let mut worst = 0.0;
        for turn in learned.turns() {
            let p = canberra::turning().get(turn.from, turn.to);
            let all: f64 =
                learned.turns().iter().filter(|t| t.from == turn.from).map(|t| t.count).sum();
            if all > 1500.0 {
                worst = f64::max(worst, (turn.probability - p).abs());
            }
            assert_eq!(turn.count, counts.get(turn.from, turn.to));
        }
        assert!(worst < bound && (weight < 100.0 || worst > 0.2), "{weight}: {worst}");
    }
}

#[test]
fn the_rule_holds_without_data_and_for_stays_not_counted() {
    let map = canberra::map();
    let (rule, prior) = (canberra::turning(), TurningRule::default());
    assert!(rule.turns().is_empty());
    for weight in [0.0, 5.0] {
        let none = TurningProbabilities::fit(&map, &MoveCounts::default(), &prior, weight).unwrap();
        assert_eq!(none.turns().len(), map.places().len() + map.roads().len());
        for turn in none.turns() {
            assert!(same(turn.probability, rule.get(turn.from, turn.to)));
            assert_eq!(turn.count, 0.0);
        }
        let to = map.neighbors(4).next().unwrap();
        let moves = MoveCounts::of_path(&[4, to, to]);
        let some = TurningProbabilities::fit(&map, &moves, &prior, weight).unwrap();
        assert!(same(some.get(to, to), rule.get(to, to)));
        let moves = 1.0 - rule.get(4, 4);
        let expected = moves * (1.0 + weight * rule.get(4, to) / moves) / (1.0 + weight);
        assert!(same(some.get(4, to), expected), "{} {expected}", some.get(4, to));
    }
}

#[test]
fn errors_name_what_is_wrong() {
    let mut builder = NetworkBuilder::new();
    for (id, x) in [(7, 0.0), (8, 1.0), (9, 2.0)] {
        builder.node(id, PlanePosition { x, y: 0.0 }).unwrap();
    }
    builder.both_ways(7, 8, RoadClass::Street).unwrap();
    builder.one_way(8, 9, RoadClass::Street).unwrap();
    let network = builder.build().unwrap();
    let map: RoadMap<PlanePosition> = network.to_map().unwrap();
    let (weights, rule) = (TurnWeights::default(), TurningRule::default());
    let flow = |counts: &[f64]| map.consistent_flow(counts);
    assert_eq!(flow(&[1.0; 2]), Err(MapError::RoadCounts { found: 2, expected: 3 }));
    let count = |counts: &[f64]| format!("{}", flow(counts).unwrap_err());
    assert_eq!(
        count(&[1.0, f64::NAN, 0.0]),
        "the count of the road from place 8 to place 7 is NaN, expected 0 to 1e150"
    );
    assert_eq!(
        count(&[1.0, 2.0, 3.0]),
        "3 vehicles were counted on the road from place 8 to place 9, but no roads with counts lead back"
    );
    assert_eq!(flow(&[0.0; 3]), Ok(vec![0.0; 3]));
    let balanced = flow(&[1.0, 4.0, 0.0]).unwrap();
    assert!(near(balanced[0], 2.0) && near(balanced[1], 2.0));
    // Counts of very different sizes.
    let balanced = flow(&[1e-150, 1e150, 0.0]).unwrap();
    assert!(near(balanced[0], 1.0) && near(balanced[1], 1.0), "{balanced:?}");
    let error = TurningProbabilities::fit_traffic(&map, &[1.0, 2.0, 3.0], &rule).unwrap_err();
    assert!(matches!(error, MapError::NoWayBack { from: 8, to: 9, .. }));

    let error = |path: &[usize], weight| {
        TurningProbabilities::fit(&map, &MoveCounts::of_path(path), &rule, weight).unwrap_err()
    };
    assert_eq!(error(&[0, 2, 0, 2], 5.0), MapError::Moved { from: 7, to: 9, count: 2.0 });
    let missing = TransitionError::OutOfRange { to: 5, from: 0, states: 3 };
    assert_eq!(error(&[0, 5], 5.0), MapError::Transition(missing.clone()));
    assert!(matches!(error(&[0, 1], -1.0), MapError::Parameter(OutOfRange { value: -1.0, .. })));

    let edges = |path: &[usize], weight| {
        EdgeTurns::fit(&network, &MoveCounts::of_path(path), &weights, weight).unwrap_err()
    };
    assert_eq!(edges(&[0, 5], 1.0), missing);
    assert_eq!(edges(&[2, 0], 1.0), TransitionError::Forbidden { to: 0, from: 2 });
    assert!(matches!(edges(&[0, 1], f64::NAN), TransitionError::Parameter(_)));
    // Without U-turns, traffic from 7 cannot go back there.
    let mut builder = NetworkBuilder::new();
    for (id, x) in [(7, 0.0), (8, 1.0), (9, 2.0)] {
        builder.node(id, PlanePosition { x, y: 0.0 }).unwrap();
    }
    builder.both_ways(7, 8, RoadClass::Street).unwrap();
    builder.both_ways(8, 9, RoadClass::Street).unwrap();
    let line = builder.build().unwrap();
    let no_u_turn = TurnWeights { u_turn: 0.0, ..weights };
    let error = EdgeTurns::fit_traffic(&line, &[9.0, 9.0, 1.0, 1.0], &no_u_turn).unwrap_err();
    let is_unbalanced = matches!(error, NetworkError::Map(MapError::Unbalanced { id: 8, .. }));
    assert!(is_unbalanced, "{error}");
    assert!(EdgeTurns::fit_traffic(&line, &[9.0, 9.0, 1.0, 1.0], &weights).is_ok());
    assert!(EdgeTurns::fit_traffic(&line, &[9.0; 4], &no_u_turn).is_ok());
    // Turns of a different network.
    let turns = EdgeTurns::fit(&line, &MoveCounts::default(), &weights, 1.0).unwrap();
    let cells = RoadCells::new(network, 1.0).unwrap();
    let error = CellTransition::with_turns(&cells, &turns).unwrap_err();
    assert_eq!(error, TransitionError::PartStates { part: "turns", found: 4, expected: 3 });
}
