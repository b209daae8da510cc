//! An edge with probability 0.9 is right nine times of ten.

use wayfix::map::PlanePosition;
use wayfix::matching::{MatchModel, Matcher, RoadAnswer};

use super::city::{Drive, Habits, Network, city, drive};

/// Expected calibration error and accuracy of live, late and smoothed answers.
fn calibration(matcher: &Matcher<PlanePosition>, drives: &[Drive]) -> [(f64, f64); 3] {
    let mut answers: [Vec<(f64, bool)>; 3] = Default::default();
    for drive in drives {
        let found = matcher.match_drive(&drive.points).unwrap();
        for (number, &edge) in drive.edges.iter().enumerate() {
            let of = |answer: RoadAnswer| (answer.probability, answer.edge == Some(edge));
            answers[0].push(of(found.live(number)));
            answers[1].push(of(found.late(number, 2)));
            answers[2].push(of(found.smoothed(number)));
        }
    }
    answers.map(|answers| {
        let mut bins = [(0.0_f64, 0.0_f64, 0.0_f64); 10];
        for &(p, right) in &answers {
            let number = (1..10).take_while(|edge| p >= 0.1 * f64::from(*edge)).count();
            let bin = &mut bins[number];
            *bin = (bin.0 + 1.0, bin.1 + p, bin.2 + f64::from(right));
        }
        let count = answers.len() as f64;
        let error = bins.iter().map(|(_, p, right)| (p - right).abs()).sum::<f64>() / count;
        (error, answers.iter().filter(|answer| answer.1).count() as f64 / count)
    })
}

fn network() -> Network {
    city(30, 30, 100.0, |_, _| false)
}

fn drives(network: &Network, habits: &Habits, seed: u64) -> Vec<Drive> {
    (0..20).map(|number| drive(network, habits, seed + number)).collect()
}

#[test]
fn of_the_right_noise() {
    let network = network();
    // The least accuracy of smoothed answers, and the most error of live ones, which at three points
    // a minute are not sure enough.
    for (sigma, seconds, least, most) in [
        (5.0, 5.0, 0.93, 0.05),
        (15.0, 5.0, 0.82, 0.03),
        (15.0, 1.0, 0.85, 0.03),
        (8.0, 20.0, 0.9, 0.08),
    ] {
        let habits = Habits { seconds, sigma, ..Habits::default() };
        let (noise, poor) = (sigma, 0.01);
        let model = MatchModel { noise, lasting: 0.7, lasts: 25.0, poor, ..MatchModel::default() };
        let matcher = Matcher::new(network.clone()).with_model(model).unwrap();
        let [live, late, smoothed] = calibration(&matcher, &drives(&network, &habits, 100));
        assert!(live.0 <= most, "{sigma}, {seconds}: {live:?}");
        assert!(late.0 <= 0.05 && smoothed.0 <= 0.04, "{sigma}, {seconds}: {late:?} {smoothed:?}");
        assert!(smoothed.1 >= least, "{sigma}, {seconds}: {smoothed:?}");
        // What comes later helps.
        assert!(late.1 > live.1 && smoothed.1 > live.1, "{live:?} {late:?} {smoothed:?}");
    }
}

#[test]
fn of_twice_the_noise_after_learning() {
    let network = network();
    let habits = Habits { sigma: 16.0, ..Habits::default() };
    let (known, others) = (drives(&network, &habits, 200), drives(&network, &habits, 300));
    let matcher = Matcher::new(network);
    let before = calibration(&matcher, &others);
    let points: Vec<_> = known.iter().map(|drive| &drive.points[..]).collect();
    let fitted = matcher.learn(&points, 20).unwrap();
    let after = calibration(&matcher.with_model(fitted.model).unwrap(), &others);
    assert!(after.iter().all(|(error, _)| *error <= 0.05), "{before:?} {after:?}");
}

/// Credible stretches of 0.9 hold the vehicle at nine points of ten or more, where there are some.
#[test]
fn credible_stretches_hold_the_vehicle() {
    let network = network();
    for (sigma, seconds) in [(5.0, 5.0), (15.0, 5.0), (8.0, 20.0)] {
        let habits = Habits { seconds, sigma, ..Habits::default() };
        let model = MatchModel { noise: sigma, ..MatchModel::default() };
        let matcher = Matcher::new(network.clone()).with_model(model).unwrap();
        for mass in [0.5, 0.9, 0.99] {
            let (mut held, mut given, mut points) = ([0_u32; 2], [0_u32; 2], 0_u32);
            for drive in &drives(&network, &habits, 400)[..8] {
                let found = matcher.match_drive(&drive.points).unwrap();
                let mut vehicle = matcher.start(&drive.points[0], 0).unwrap();
                for (number, point) in drive.points.iter().enumerate() {
                    if number > 0 {
                        matcher.step(&mut vehicle, point).unwrap();
                    }
                    let (edge, along) = (drive.edges[number], drive.along[number]);
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
                assert!(share >= mass - 0.03, "{sigma}, {seconds}, {mass}: {share}");
                let given = f64::from(given) / f64::from(points);
                assert!(given >= 0.6, "{sigma}, {seconds}, {mass}: {given}");
            }
        }
    }
}
