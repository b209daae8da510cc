//! Positions, tags and roads as observations of cells.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::Pruning;
use wayfix::likelihood::LocalLikelihood;
use wayfix::map::{PlanePosition, Position, RoadClass};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, FusedLikelihood, Hmm, Likelihood, OptionalLikelihood, Prior, Scratch};
use wayfix_roads::NetworkBuilder;
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, TurnWeights};
use wayfix_roads::cells::{PositionFix, PositionLikelihood, ReadRates, TagLikelihood};

use super::{aisles, networks};
use crate::kit::{cases_of, close, says};

/// All likelihoods as logarithms, with their factor.
fn all<B: Likelihood<Observation: Sized> + LocalLikelihood>(
    sensor: &B,
    seen: &B::Observation,
) -> Vec<f64> {
    let states: Vec<usize> = (0..sensor.states()).collect();
    let mut scratch = Scratch::default();
    let (found, _) = sensor.local(seen, &states, &mut scratch).unwrap();
    let log = |b: &f64| if found.is_log() { *b } else { b.ln() };
    found.as_slice().iter().map(|b| log(b) + found.log_factor()).collect()
}

/// The listed states have the likelihoods of the full diagonal, and the bound on the others holds;
/// the filter gives the same.
fn check<B: Likelihood<Observation: Sized> + LocalLikelihood>(
    sensor: &B,
    seen: &B::Observation,
    asked: &[bool],
) -> Result<(), TestCaseError> {
    let expected = all(sensor, seen);
    let n = expected.len();
    let mut asked: Vec<usize> = (0..n).filter(|&cell| asked[cell % asked.len()]).collect();
    for _ in 0..2 {
        let mut scratch = Scratch::default();
        let (found, bound) = sensor.local(seen, &asked, &mut scratch).unwrap();
        let log = |b: f64| found.log_factor() + if found.is_log() { b } else { b.ln() };
        prop_assert_eq!(found.as_slice().len(), asked.len());
        for (&cell, &b) in asked.iter().zip(found.as_slice()) {
            prop_assert_eq!(log(b), expected[cell]);
        }
        let others = (0..n).filter(|cell| asked.binary_search(cell).is_err());
        for cell in others {
            prop_assert!(expected[cell] <= log(bound) + 1e-9, "{}", cell);
        }
        // With the states that stand out, too.
        sensor.listed_states(seen, &mut asked);
        asked.sort_unstable();
        asked.dedup();
    }
    // As an observation of a model, for which only the differences matter.
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let still = wayfix::SparseTransition::from_triplets(n, (0..n).map(|i| (i, i, 1.0))).unwrap();
    let hmm = Hmm::new(prior, still, sensor).unwrap();
    let found = hmm.log_likelihood(std::slice::from_ref(seen)).unwrap();
    let mean: f64 = expected.iter().map(|log| log.exp()).sum::<f64>() / n as f64;
    close(found, mean.ln(), 1e-9, 1.0)
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn positions_have_the_density_of_the_docs(
        cells in networks(4, 6),
        (x, y) in (-40.0..40.0_f64, -40.0..40.0_f64),
        deviation in 0.05..5.0_f64,
        ahead in -1.0..1.0_f64,
        asked in vec(any::<bool>(), 1..7),
    ) {
        let sensor = PositionLikelihood::new(&cells).with_degrees(4.0).unwrap();
        let fix = PositionFix { position: PlanePosition { x, y }, deviation, ahead };
        let found = all(&sensor, &fix);
        for (cell, &found) in found.iter().enumerate() {
            let stretch = cells.stretch(cell);
            let end = |metres| cells.network().position_along(cells.edge(cell), metres);
            let (start, end) = (end(stretch.start), end(stretch.end));
            let length = start.metres_to(end);
            // The line of an edge may be shorter than the edge.
            let (u, v) = if length > 0.0 {
                ((end.x - start.x) / length, (end.y - start.y) / length)
            } else {
                (0.0, 0.0)
            };
            let middle = cells.position(cell);
            let (dx, dy) = (x - middle.x - ahead * u, y - middle.y - ahead * v);
            let along = if length > 0.0 { dx * u + dy * v } else { ahead };
            let across2 = if length > 0.0 { (dx * v - dy * u).powi(2) } else { dx * dx + dy * dy };
            let square = deviation * deviation;
            let wide = square + (stretch.end - stretch.start).powi(2) / 12.0;
            let q = along * along / wide + across2 / square;
            let shape = -3.0 * (1.0 + q / 4.0).ln();
            let expected = shape - (2.0 * std::f64::consts::PI * (square * wide).sqrt()).ln();
            close(found, expected, 1e-4, 1.0)?;
        }
        check(&sensor, &fix, &asked)?;
    }

    #[test]
    fn tags_are_read_in_range(
        cells in networks(4, 6),
        range in 0.1..3.0_f64,
        (read, misread) in (0.0..0.9_f64, 0.01..0.1_f64),
        seen in prop_oneof![Just(None), (0..2_usize).prop_map(Some)],
        asked in vec(any::<bool>(), 1..7),
    ) {
        let nodes = [2, 0];
        let rates = ReadRates { read, misread };
        let sensor = TagLikelihood::at_nodes(&cells, &nodes, range, rates).unwrap();
        check(&sensor, &seen, &asked)?;
        for (cell, log) in all(&sensor, &seen).into_iter().enumerate() {
            let edge = cells.network().edges()[cells.edge(cell)];
            let stretch = cells.stretch(cell);
            // By integration over a thousand points of the cell.
            let points = || (0..1000).map(|at| {
                stretch.start + (stretch.end - stretch.start) * (f64::from(at) + 0.5) / 1000.0
            });
            let part = |node: usize| {
                let before = points().filter(|at| edge.metres - at <= range).count();
                let behind = points().filter(|at| *at <= range).count();
                let before = if edge.to == node { before } else { 0 };
                let behind = if edge.from == node { behind } else { 0 };
                before.max(behind) as f64 / 1000.0
            };
            let parts = nodes.map(part);
            let in_range = parts[0].max(parts[1]) * read;
            match seen {
                None => close(log.exp(), 1.0 - in_range - misread, 3e-3, 1.0)?,
                // Of parts of about the same size, either may win.
                Some(_) if (parts[0] - parts[1]).abs() < 0.01 => (),
                Some(tag) => {
                    let here = if parts[tag] > parts[1 - tag] { in_range } else { 0.0 };
                    close(log.exp(), here + misread / 2.0, 3e-3, 1.0)?;
                }
            }
        }
        let roads = cells.by_road();
        let sensor = TagLikelihood::of_groups(&roads, rates).unwrap();
        let seen = seen.map(|tag| tag % roads.count());
        check(&sensor, &seen, &asked)?;
        for (cell, log) in all(&sensor, &seen).into_iter().enumerate() {
            let here = if roads.group_of(cell) == seen { read } else { 0.0 };
            let expected = match seen {
                None => 1.0 - read - misread,
                Some(_) => here + misread / roads.count() as f64,
            };
            close(log.exp(), expected, 1e-6, 1.0)?;
        }
    }

    /// The pruned filter follows the exact one within its proven bound, kidnapped or not.
    #[test]
    fn the_pruned_filter_follows_the_exact_one(
        steps in vec((0.0..8.0_f64, 0.0..15.0_f64, 0.0..15.0_f64, prop_oneof![3 => Just(None), 1 => (0..3_usize).prop_map(Some)]), 1..12),
        restarts in any::<bool>(),
    ) {
        let cells = RoadCells::new(aisles(4, 4, 5.0), 1.0).unwrap();
        let n = cells.states();
        let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
        let mut odometer = motion.odometer();
        let rate = if restarts { 1e-4 } else { 0.0 };
        let motion = RestartTransition::new(motion, rate, Belief::uniform(n).unwrap()).unwrap();
        let rates = ReadRates { read: 0.3, misread: 0.05 };
        let tags = TagLikelihood::at_nodes(&cells, &[3, 7, 12], 1.0, rates).unwrap();
        let sensor = OptionalLikelihood::new(PositionLikelihood::new(&cells));
        let sensor = FusedLikelihood::new(sensor, tags).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
        let hmm = Hmm::new(prior, motion, sensor).unwrap();
        let mut pruned = hmm.pruned_filter(Pruning::default().with_tolerance(1e-6));
        let mut exact = hmm.filter();
        for (metres, x, y, tag) in steps {
            let travel = odometer.add(metres, 0.01 * metres).unwrap();
            let fix = PositionFix { ahead: odometer.ahead(), ..PositionFix::new(PlanePosition { x, y }, 2.0) };
            let seen = ((x < 9.0).then_some(fix), tag);
            exact.step_with(&travel, &seen).unwrap();
            let certificate = pruned.step_with(&travel, &seen).unwrap();
            let distance: f64 = (0..n).map(|cell| {
                (exact.belief().as_slice()[cell] - pruned.probability(cell).unwrap()).abs()
            }).sum::<f64>() / 2.0;
            prop_assert!(distance <= certificate.bound() + 1e-12, "{distance}");
        }
    }
}

/// Cells far from the belief are never visited.
#[test]
fn a_step_on_a_city_looks_at_few_cells() {
    let cells = RoadCells::new(aisles(100, 100, 100.0), 20.0).unwrap();
    let n = cells.states();
    assert_eq!(n, 198_000);
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let mut odometer = motion.odometer();
    let start = cells.nearest(PlanePosition { x: 4950.0, y: 5000.0 });
    let prior = Prior::BeforeFirstTransition(Belief::certain(n, start).unwrap());
    let hmm = Hmm::new(prior, motion, PositionLikelihood::new(&cells)).unwrap();
    let mut filter = hmm.pruned_filter(Pruning::default().with_tolerance(1e-6));
    for second in 1..=60 {
        let x = 4950.0 + 12.0 * f64::from(second);
        let travel = odometer.add(12.0, 1.0).unwrap();
        let fix = PositionFix::new(PlanePosition { x, y: 5003.0 }, 8.0);
        let fix = PositionFix { ahead: odometer.ahead(), ..fix };
        let certificate = filter.step_with(&travel, &fix).unwrap();
        assert!(certificate.holds(), "{second}");
        assert!(filter.active().len() < 3000, "{second}: {}", filter.active().len());
        let position = cells.position_ahead(filter.mode(), odometer.ahead());
        assert!(position.metres_to(PlanePosition { x, y: 5000.0 }) < 25.0, "{second}");
    }
    let edge = cells.network().edges()[cells.edge(filter.mode())];
    assert_eq!(edge.to, edge.from + 1); // to the east
}

#[test]
fn bad_fixes_and_readings_are_errors() {
    let mut builder = NetworkBuilder::new();
    builder.node(1, Position { latitude: 0.0, longitude: 0.0 }).unwrap();
    builder.node(2, Position { latitude: 0.0, longitude: 0.1 }).unwrap();
    builder.both_ways(1, 2, RoadClass::Street).unwrap();
    let cells = RoadCells::new(builder.build().unwrap(), 100.0).unwrap();
    let sensor = PositionLikelihood::new(&cells);
    let try_at = |latitude: f64, deviation: f64| {
        let fix = PositionFix::new(Position { latitude, longitude: 0.05 }, deviation);
        sensor.diagonal(&fix, &mut Scratch::default()).map(|_| ())
    };
    says(
        try_at(91.0, 5.0),
        "the sensor failed: latitude is 91, expected a position of the map's kind",
    );
    says(
        try_at(f64::NAN, 5.0),
        "the sensor failed: latitude is NaN, expected a position of the map's kind",
    );
    says(
        try_at(0.0, 0.0),
        "the sensor failed: the deviation of a position is 0, expected metres above 1e-6",
    );
    says(
        sensor.clone().with_degrees(0.0),
        "the degrees of freedom is 0, expected a value from 1 to 1000",
    );
    // The poles are on Earth.
    assert!(
        all(&sensor, &PositionFix::new(Position { latitude: 90.0, longitude: 0.0 }, 5.0))
            .iter()
            .all(|log| log.is_finite())
    );
    let rates = ReadRates { read: 0.5, misread: 0.1 };
    let reader = |nodes: &[usize], range: f64| TagLikelihood::at_nodes(&cells, nodes, range, rates);
    says(reader(&[2], 1.0), "the node of a tag is 2, expected a node of the map");
    says(reader(&[1, 1], 1.0), "the node of a tag is 1, expected each node once");
    says(reader(&[1], 0.0), "the range of a reader is 0, expected metres above 0");
    let both = ReadRates { read: 0.9, misread: 0.2 };
    says(
        TagLikelihood::at_nodes(&cells, &[1], 1.0, both),
        "the sum of read and misread rate is 1.1, expected at most 1",
    );
    let reader = reader(&[1], 1.0).unwrap();
    says(
        reader.diagonal(&Some(1), &mut Scratch::default()).map(|_| ()),
        "symbol 1 does not exist, the table has 1 symbols (0 to 0)",
    );
}
