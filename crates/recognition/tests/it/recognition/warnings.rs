//! Warnings of a fit, of a recording and of a track.

use std::ops::RangeInclusive;

use wayfix_recognition::{LabelledPart, Recognizer, Warning};

use super::{PLACES, labels, options, recognizer, seen, usual_drive};
use crate::kit::noise;

#[test]
fn warnings_are_given_where_they_should_be() {
    let (recognizer, world) = recognizer(70, false);
    let drive = usual_drive();
    let queries = seen(&world, &drive, 0.5, 71);
    let places = labels(&drive);
    let part = LabelledPart { queries: &queries, places: &places, odometry: &[] };
    let fitted = recognizer.fit(&[part]).unwrap();
    assert!(fitted.parameters().warnings().iter().all(|w| matches!(w, Warning::Harm { .. })));

    // Labels of other places, near the right ones.
    let contradicted = |shift: usize| {
        let places: Vec<_> = places.iter().flatten().map(|place| place.end() - shift).collect();
        let places: Vec<_> = places.iter().map(|at| Some(*at..=*at)).collect();
        let part = LabelledPart { queries: &queries, places: &places, odometry: &[] };
        let fitted = recognizer.fit(&[part]).unwrap();
        let is = |w: &Warning| matches!(w, Warning::Contradicted { share } if *share > 0.6);
        fitted.parameters().warnings().iter().any(is)
    };
    assert!(!contradicted(0) && [3, 6, 10].into_iter().all(contradicted));

    let part = LabelledPart { queries: &queries[..12], places: &places[..12], odometry: &[] };
    let few = recognizer.fit(&[part]).unwrap();
    assert!(few.parameters().warnings().contains(&Warning::Short { steps: 12 }));

    // Similarities that were taken for distances.
    let cosine = |a: &[f32], b: &[f32]| {
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    };
    let row = |query: &Vec<f32>| -> Vec<f32> {
        world[..PLACES].iter().map(|reference| cosine(query, reference)).collect()
    };
    let rows: Vec<Vec<f32>> = queries.iter().map(row).collect();
    let matrix = Recognizer::from_distances(PLACES, options(false)).unwrap();
    let part = LabelledPart { queries: &rows, places: &places, odometry: &[] };
    let wrong = matrix.fit(&[part]).unwrap();
    let chance = wrong
        .parameters()
        .warnings()
        .iter()
        .any(|w| matches!(w, Warning::Chance { rank } if *rank > 0.5));
    assert!(chance, "{:?}", wrong.parameters().warnings());
    assert!(
        wrong.parameters().warnings()[0]
            .to_string()
            .contains("similarities mixed up with distances")
    );
    let rows: Vec<Vec<f32>> = rows.iter().map(|row| row.iter().map(|s| -s).collect()).collect();
    let part = LabelledPart { queries: &rows, places: &places, odometry: &[] };
    let fine = matrix.fit(&[part]).unwrap();
    assert!(!fine.parameters().warnings().iter().any(|w| matches!(w, Warning::Chance { .. })));
}

fn chance(recognizer: &Recognizer) -> bool {
    recognizer.parameters().warnings().iter().any(|w| matches!(w, Warning::Chance { .. }))
}

/// Of seven references one is nearest by chance, too.
#[test]
fn chance_is_seen_with_labels_that_are_ranges() {
    let drive: Vec<usize> = (3..117).collect();
    let (recognizer, world) = recognizer(150, false);
    let good = seen(&world, &drive, 0.5, 151);
    let other = seen(&super::world(152), &drive, 0.5, 153);
    let places: Vec<Option<RangeInclusive<usize>>> =
        drive.iter().map(|place| Some(place - 3..=(place + 3).min(PLACES - 1))).collect();
    let fit = |queries: &[Vec<f32>]| {
        recognizer.fit(&[LabelledPart { queries, places: &places, odometry: &[] }]).unwrap()
    };
    assert!(chance(&fit(&other)));
    let exact = labels(&drive);
    let part = LabelledPart { queries: &good, places: &exact, odometry: &[] };
    assert!(!chance(&recognizer.fit(&[part]).unwrap()));
    let rows = vec![[0.5; PLACES]; drive.len()];
    let matrix = Recognizer::from_distances(PLACES, options(false)).unwrap();
    let part = LabelledPart { queries: &rows, places: &places, odometry: &[] };
    assert!(chance(&matrix.fit(&[part]).unwrap()));
}

#[test]
fn odometry_in_another_unit_is_seen() {
    let drive = usual_drive();
    let (recognizer, world) = recognizer(160, false);
    let queries = seen(&world, &drive, 0.5, 161);
    let places = labels(&drive);
    let warned = |unit: f64, error: f32| {
        let noise = noise(drive.len(), 162);
        let moved = |at: usize| drive[at] as f64 - drive[at.saturating_sub(1)] as f64;
        let odometry: Vec<Option<f64>> = (0..drive.len())
            .map(|at| Some(unit * moved(at) + f64::from(error * noise[at])))
            .collect();
        let part = LabelledPart { queries: &queries, places: &places, odometry: &odometry };
        let fitted = recognizer.fit(&[part]).unwrap();
        let warnings = fitted.parameters().warnings().to_vec();
        warnings.iter().any(|w| matches!(w, Warning::Odometry { .. }))
    };
    assert!(!warned(1.0, 0.0) && !warned(1.04, 0.3));
    assert!(warned(5.0, 0.1) && warned(0.3, 0.1) && warned(1.0, 5.0) && warned(-1.0, 0.1));
}

#[test]
fn labels_off_the_map_that_are_not_learned_from_are_told() {
    let drive: Vec<usize> = (10..50).chain(PLACES..PLACES + 20).chain(50..80).collect();
    let places = labels(&drive);
    for off_map in [false, true] {
        let (recognizer, world) = recognizer(170, off_map);
        let queries = seen(&world, &drive, 0.5, 171);
        let part = LabelledPart { queries: &queries, places: &places, odometry: &[] };
        let fitted = recognizer.fit(&[part]).unwrap();
        let told = fitted.parameters().warnings().contains(&Warning::OffMap { steps: 20 });
        assert_eq!(told, !off_map);
    }
}

fn warnings(
    recognizer: &Recognizer,
    queries: &[Vec<f32>],
    odometry: &[Option<f64>],
) -> Vec<Warning> {
    recognizer.recording(queries, odometry).unwrap().warnings()
}

/// All warnings of a track during a drive.
fn live(recognizer: &Recognizer, queries: &[Vec<f32>], odometry: &[Option<f64>]) -> Vec<Warning> {
    let mut track = recognizer.track();
    let mut all = Vec::new();
    for (at, query) in queries.iter().enumerate() {
        track.step_with(odometry.get(at).copied().flatten(), query).unwrap();
        all.extend(track.warnings());
    }
    all
}

/// To the last place and back, a number of times.
fn there_and_back(times: usize) -> Vec<usize> {
    let once = (0..PLACES).chain((0..PLACES - 1).rev());
    (0..times).flat_map(|_| once.clone()).collect()
}

#[test]
fn answers_that_are_unsure_are_told() {
    let drive = there_and_back(1);
    for seed in 0..3 {
        let (recognizer, world) = recognizer(180 + seed, false);
        let warnings = |queries: &[Vec<f32>]| warnings(&recognizer, queries, &[]);
        assert_eq!(warnings(&seen(&world, &drive, 0.5, 190)), []);
        let elsewhere = seen(&super::world(200 + seed), &drive, 0.5, 191);
        let told = |queries: &[Vec<f32>], expected: usize| {
            let found = warnings(queries);
            let [Warning::Unsure { mean, step, steps }] = found[..] else { panic!("{found:?}") };
            assert!(mean < 0.55 && (steps..=queries.len()).contains(&step));
            assert_eq!(steps, expected);
        };
        told(&elsewhere, drive.len() / 4);
        told(&elsewhere[..100], 50);
        assert_eq!(warnings(&elsewhere[..40]), []);
        let blank: Vec<Vec<f32>> =
            noise(24 * drive.len(), 192).chunks(24).map(<[f32]>::to_vec).collect();
        told(&blank, drive.len() / 4);
    }
}

#[test]
fn a_vehicle_that_is_faster_than_the_speeds_is_told() {
    let (recognizer, world) = recognizer(81, false);
    let fastest = recognizer.options().speeds().values().iter().copied().fold(0.0, f64::max);
    for (speed, seed) in (1..9).zip(82..) {
        let drive: Vec<usize> = (0..PLACES).step_by(speed).collect();
        let found = warnings(&recognizer, &seen(&world, &drive, 0.3, seed), &[]);
        let fast = found.iter().find_map(|warning| match warning {
            Warning::Fast { moved, fastest } => Some((*moved, *fastest)),
            _ => None,
        });
        let is_fast = speed as f64 > fastest + 0.5 && drive.len() > 20;
        assert_eq!(fast, is_fast.then_some((speed as f64, fastest)), "{speed} {found:?}");
    }
    // By odometry the vehicle moves, but noise shows no progress.
    let drive: Vec<usize> = (0..PLACES).step_by(5).collect();
    let queries = seen(&world, &drive, 0.3, 91);
    let readings = vec![Some(5.0); queries.len()];
    let is_fast = |warnings: &[Warning]| warnings.iter().any(|w| matches!(w, Warning::Fast { .. }));
    assert!(!is_fast(&warnings(&recognizer, &queries, &readings)));
    let elsewhere: Vec<Vec<f32>> = (0..100).map(|at| noise(world[0].len(), 92 + at)).collect();
    assert!(!is_fast(&warnings(&recognizer, &elsewhere, &[])));
}

#[test]
fn stuck_odometry_is_told() {
    let (recognizer, world) = recognizer(250, false);
    // One place per step, a stop, and two places per step.
    let leg = || (0..PLACES).chain([PLACES - 1; 80]).chain((0..PLACES).rev().step_by(2));
    let drive: Vec<usize> = leg().chain(leg()).collect();
    let queries = seen(&world, &drive, 0.5, 251);
    let error = noise(drive.len(), 252);
    let moved = |at: usize| drive[at] as f64 - drive[at.saturating_sub(1)] as f64;
    let healthy: Vec<Option<f64>> =
        (0..drive.len()).map(|at| Some(moved(at) + 0.2 * f64::from(error[at]))).collect();
    let stuck = |warnings: &[Warning]| warnings.iter().any(|d| matches!(d, Warning::Stuck { .. }));
    let exact: Vec<Option<f64>> = (0..drive.len()).map(|at| Some(moved(at))).collect();
    for odometry in [&healthy, &exact] {
        for warnings in
            [warnings(&recognizer, &queries, odometry), live(&recognizer, &queries, odometry)]
        {
            assert!(!stuck(&warnings), "{warnings:?}");
        }
    }
    let mut odometry = healthy.clone();
    odometry[50..].fill(Some(0.0));
    let found = warnings(&recognizer, &queries, &odometry);
    assert!(stuck(&found), "{found:?}");
    assert!(stuck(&live(&recognizer, &queries, &odometry)));
    assert!(found.iter().any(|warning| warning.to_string().contains("is it stuck?")));
    // Equal readings count less and less, so that most answers are right nonetheless.
    let drive = there_and_back(1);
    let queries = seen(&world, &drive, 0.5, 253);
    for speed in [0.0, 0.5, 2.0] {
        let recording = recognizer.recording(&queries, &vec![Some(speed); queries.len()]).unwrap();
        let answers = recording.filtered().answers();
        let right =
            answers.iter().zip(&drive).filter(|(a, at)| a.place.unwrap().abs_diff(**at) <= 1);
        let right = right.count();
        assert!(right >= queries.len() * 8 / 10, "{speed}: {right} of {}", queries.len());
    }
    // With a frozen camera, odometry alone leads on, and answers become unsure.
    let mut frozen = queries.clone();
    let last = frozen[60].clone();
    frozen[60..].fill(last);
    let odometry: Vec<Option<f64>> =
        (0..drive.len()).map(|at| Some(1.0 + 0.2 * f64::from(error[at]))).collect();
    let unsure =
        |warnings: &[Warning]| warnings.iter().any(|d| matches!(d, Warning::Unsure { .. }));
    assert!(unsure(&warnings(&recognizer, &frozen, &odometry)));
    assert!(unsure(&live(&recognizer, &frozen, &odometry)));
}
