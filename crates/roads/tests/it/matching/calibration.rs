//! Calibration: an edge with probability 0.9 is right nine times in ten.
//!
//! Off the road, only "off the road" is right, from the first metre beside the road to the last,
//! about 3 s each way. Bounds are a third above the worst of ten batches of 40 drives; the tests
//! use another batch.

use wayfix::evaluate::{expected_calibration_error, reliability};
use wayfix::map::PlanePosition;
use wayfix_roads::matching::{MatchModel, Matcher, RoadAnswer};

use super::city::{Drive, Network, ON_ROADS, Scenario, city, drive};

const ROOM: f64 = 4.0 / 3.0;

/// Live, late and smoothed answers.
#[derive(Debug, Default)]
struct Measured {
    /// Expected calibration error.
    error: [f64; 3],
    /// Share of answers that are right.
    right: [f64; 3],
    /// Share of wrong answers among those with a probability of 0.95 or more.
    wrong: [f64; 3],
    /// Share of the points off the road that are found, and of the other points that are taken for
    /// such.
    off_road: [f64; 3],
    on_road: [f64; 3],
}

/// Share of answers with a property, among those with another.
fn share<T>(all: &[T], of: impl Fn(&T) -> bool, is: impl Fn(&T) -> bool) -> f64 {
    let of: Vec<&T> = all.iter().filter(|answer| of(answer)).collect();
    of.iter().filter(|answer| is(answer)).count() as f64 / of.len().max(1) as f64
}

fn measure(matcher: &Matcher<PlanePosition>, drives: &[Drive]) -> Measured {
    let mut answers: [Vec<(RoadAnswer, Option<usize>)>; 3] = Default::default();
    for drive in drives {
        let found = matcher.match_drive(&drive.points).unwrap();
        for (number, truth) in drive.truth.iter().enumerate() {
            let edge = truth.map(|(edge, _)| edge);
            let each = [found.live(number), found.late(number, 2), found.smoothed(number)];
            answers.iter_mut().zip(each).for_each(|(all, answer)| all.push((answer, edge)));
        }
    }
    let mut measured = Measured::default();
    for (number, answers) in answers.iter().enumerate() {
        let forecasts: Vec<_> = answers
            .iter()
            .map(|(answer, truth)| (answer.probability.min(1.0), answer.edge == *truth))
            .collect();
        let bins = reliability(&forecasts, 10).unwrap();
        measured.error[number] = expected_calibration_error(&bins);
        measured.right[number] = share(&forecasts, |_| true, |forecast| forecast.1);
        measured.wrong[number] =
            share(&forecasts, |forecast| forecast.0 >= 0.95, |forecast| !forecast.1);
        let is_off = |answer: &(RoadAnswer, Option<usize>)| answer.0.edge.is_none();
        measured.off_road[number] = share(answers, |answer| answer.1.is_none(), is_off);
        measured.on_road[number] = share(answers, |answer| answer.1.is_some(), is_off);
    }
    measured
}

fn network() -> Network {
    city(30, 30, 100.0, |_, _| false)
}

fn drives(network: &Network, scenario: &Scenario, count: u64, seed: u64) -> Vec<Drive> {
    (0..count).map(|number| drive(network, scenario, seed + number)).collect()
}

/// Measures of drives with the receiver that they were simulated with.
fn of_known_receiver(scenario: &Scenario) -> Measured {
    let network = network();
    let drives = drives(&network, scenario, 40, 100_000);
    let (noise, poor) = (scenario.noise, 0.02);
    let model = MatchModel { noise, lasting: 0.7, lasts: 25.0, poor, ..MatchModel::default() };
    measure(&Matcher::new(network).with_model(model).unwrap(), &drives)
}

/// Checks rows of noise, interval, largest errors, largest share of wrong answers among sure ones,
/// and smallest share of right smoothed answers.
fn check(scenario: &Scenario, rows: &[([f64; 2], [f64; 3], f64, f64)]) {
    for &([noise, every], errors, wrong, right) in rows {
        let found = of_known_receiver(&Scenario { noise, every, ..*scenario });
        let is_within = |found: [f64; 3], most: [f64; 3]| {
            found.iter().zip(most).all(|(found, most)| *found <= ROOM * most)
        };
        assert!(is_within(found.error, errors), "{noise} m, {every} s: {found:?}");
        assert!(is_within(found.wrong, [wrong; 3]), "{noise} m, {every} s: {found:?}");
        let not_right = 1.0 - found.right[2];
        assert!(not_right <= ROOM * (1.0 - right), "{noise} m, {every} s: {found:?}");
        // Later points help.
        assert!(found.right[1].min(found.right[2]) > found.right[0], "{found:?}");
    }
}

#[test]
fn on_roads_with_errors_that_last() {
    let rows = [
        ([5.0, 1.0], [0.029, 0.022, 0.009], 0.007, 0.938),
        ([5.0, 5.0], [0.035, 0.018, 0.013], 0.006, 0.937),
        ([5.0, 20.0], [0.047, 0.029, 0.029], 0.007, 0.932),
        ([15.0, 1.0], [0.020, 0.021, 0.033], 0.039, 0.815),
        ([15.0, 5.0], [0.025, 0.022, 0.026], 0.024, 0.835),
        ([15.0, 20.0], [0.067, 0.036, 0.040], 0.031, 0.814),
    ];
    check(&ON_ROADS, &rows);
}

/// A car park 30 to 60 m from the road looks much like a wait on it with a poor receiver: most of
/// these points are wrong with too high a probability, the more so the rougher the receiver.
#[test]
fn with_gaps_car_parks_and_turns() {
    let rows = [
        ([5.0, 1.0], [0.042, 0.047, 0.062], 0.057, 0.882),
        ([5.0, 5.0], [0.034, 0.047, 0.046], 0.056, 0.892),
        ([5.0, 20.0], [0.038, 0.039, 0.038], 0.041, 0.896),
        ([15.0, 1.0], [0.091, 0.087, 0.106], 0.118, 0.764),
        ([15.0, 5.0], [0.070, 0.076, 0.098], 0.150, 0.763),
        ([15.0, 20.0], [0.061, 0.073, 0.078], 0.144, 0.750),
    ];
    check(&Scenario::default(), &rows);
}

/// One in each drive. Bounds: three quarters of the least of five batches.
#[test]
fn car_parks_are_found() {
    let rows =
        [(1.0, [0.369, 0.369, 0.383]), (5.0, [0.405, 0.417, 0.489]), (20.0, [0.687, 0.772, 0.775])];
    for (every, least) in rows {
        let found = of_known_receiver(&Scenario { noise: 5.0, every, car_parks: 1.0, ..ON_ROADS });
        for (found, least) in found.off_road.iter().zip(least) {
            assert!(*found >= 0.75 * least, "{every} s: {found:?}");
        }
        assert!(found.on_road.iter().all(|share| *share < 0.02), "{every} s: {found:?}");
    }
}

/// Bounds: a third above the worst of twenty batches of 20 drives.
#[test]
fn of_twice_the_noise_after_learning() {
    let network = network();
    let plain = Scenario { noise: 16.0, ..ON_ROADS };
    let all = Scenario { noise: 16.0, ..Scenario::default() };
    for (scenario, errors) in [(plain, [0.034, 0.033, 0.043]), (all, [0.103, 0.107, 0.113])] {
        let known = drives(&network, &scenario, 20, 200_000);
        let others = drives(&network, &scenario, 20, 300_000);
        let matcher = Matcher::new(network.clone());
        let before = measure(&matcher, &others);
        let points: Vec<_> = known.iter().map(|drive| &drive.points[..]).collect();
        let fitted = matcher.learn(&points, 20).unwrap();
        let after = measure(&matcher.with_model(fitted.model).unwrap(), &others);
        for (after, (most, before)) in after.error.iter().zip(errors.iter().zip(before.error)) {
            assert!(*after <= ROOM * most && *after < before, "{scenario:?}: {after} {before}");
        }
    }
}

/// Credible stretches of 0.9 hold the vehicle at nine of ten points or more, if there are any.
#[test]
fn credible_stretches_hold_the_vehicle() {
    let network = network();
    for (noise, every) in [(5.0, 5.0), (15.0, 5.0), (8.0, 20.0)] {
        let scenario = Scenario { noise, every, ..ON_ROADS };
        let model = MatchModel { noise, ..MatchModel::default() };
        let matcher = Matcher::new(network.clone()).with_model(model).unwrap();
        for mass in [0.5, 0.9, 0.99] {
            let (mut held, mut given, mut points) = ([0_u32; 2], [0_u32; 2], 0_u32);
            for drive in &drives(&network, &scenario, 8, 400) {
                let found = matcher.match_drive(&drive.points).unwrap();
                let mut vehicle = matcher.start(&drive.points[0], 0).unwrap();
                for (number, point) in drive.points.iter().enumerate() {
                    if number > 0 {
                        vehicle.step(&matcher, point).unwrap();
                    }
                    let (edge, along) = drive.truth[number].unwrap();
                    let around =
                        [vehicle.credible(&matcher, mass), found.credible(&matcher, number, mass)];
                    for ((held, given), around) in held.iter_mut().zip(&mut given).zip(around) {
                        let around = around.unwrap();
                        if around.probability < mass {
                            continue;
                        }
                        *given += 1;
                        *held += u32::from(around.stretches.iter().any(|part| {
                            part.edge == Some(edge) && (part.enter..=part.exit).contains(&along)
                        }));
                        for part in &around.stretches {
                            let (start, end) = (part.enter, part.exit);
                            let length = network.edges()[part.edge.unwrap()].metres;
                            assert!(0.0 <= start && start <= end && end <= length, "{part:?}");
                        }
                    }
                    points += 1;
                }
            }
            for (held, given) in held.into_iter().zip(given) {
                let share = f64::from(held) / f64::from(given);
                assert!(share >= mass - 0.03, "{noise} m, {every} s, {mass}: {share}");
                let given = f64::from(given) / f64::from(points);
                assert!(given >= 0.6, "{noise} m, {every} s, {mass}: {given}");
            }
        }
    }
}
