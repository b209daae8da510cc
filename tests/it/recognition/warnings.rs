//! Warnings of a fit, and of a recording.

use std::ops::RangeInclusive;

use wayfix::observation::Distance;
use wayfix::recognition::{LabelledPart, Recognizer, Warning};

use super::{PLACES, labels, options, recognizer, seen, usual_drive};
use crate::kit::noise;

#[test]
fn warnings_are_given_where_they_should_be() {
    let (recognizer, world) = recognizer(70, false);
    let drive = usual_drive();
    let queries = seen(&world, &drive, 0.5, 71);
    let places = labels(&drive);
    let part = LabelledPart { queries: &queries, places: &places, odometry: &[] };
    let fitted = recognizer.fitted(&[part]).unwrap();
    assert!(fitted.fit().warnings().iter().all(|w| matches!(w, Warning::Edge { .. })));
    assert!(fitted.fit().calibrated().is_some());
    let part = LabelledPart { queries: &queries[..12], places: &places[..12], odometry: &[] };
    let few = recognizer.fitted(&[part]).unwrap();
    assert!(few.fit().warnings().contains(&Warning::Short { steps: 12 }));

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
    let wrong = matrix.fitted(&[part]).unwrap();
    let chance =
        wrong.fit().warnings().iter().any(|w| matches!(w, Warning::Chance { rank } if *rank > 0.5));
    assert!(chance, "{:?}", wrong.fit().warnings());
    assert!(wrong.fit().warnings()[0].to_string().contains("similarities and distances"));
    let rows: Vec<Vec<f32>> = rows.iter().map(|row| row.iter().map(|s| -s).collect()).collect();
    let part = LabelledPart { queries: &rows, places: &places, odometry: &[] };
    let fine = matrix.fitted(&[part]).unwrap();
    assert!(!fine.fit().warnings().iter().any(|w| matches!(w, Warning::Chance { .. })));
}

fn chance(recognizer: &Recognizer) -> bool {
    recognizer.fit().warnings().iter().any(|w| matches!(w, Warning::Chance { .. }))
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
        recognizer.fitted(&[LabelledPart { queries, places: &places, odometry: &[] }]).unwrap()
    };
    assert!(chance(&fit(&other)));
    let exact = labels(&drive);
    let part = LabelledPart { queries: &good, places: &exact, odometry: &[] };
    assert!(!chance(&recognizer.fitted(&[part]).unwrap()));
    let rows = vec![[0.5; PLACES]; drive.len()];
    let matrix = Recognizer::from_distances(PLACES, options(false)).unwrap();
    let part = LabelledPart { queries: &rows, places: &places, odometry: &[] };
    assert!(chance(&matrix.fitted(&[part]).unwrap()));
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
        let fitted = recognizer.fitted(&[part]).unwrap();
        let warnings = fitted.fit().warnings().to_vec();
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
        let fitted = recognizer.fitted(&[part]).unwrap();
        let told = fitted.fit().warnings().contains(&Warning::OffMap { steps: 20 });
        assert_eq!(told, !off_map);
    }
}

#[test]
fn a_recording_that_matches_nothing_is_told() {
    let drive: Vec<usize> = (0..PLACES).chain((0..PLACES - 1).rev()).collect();
    for seed in 0..3 {
        let (recognizer, world) = recognizer(180 + seed, false);
        let warning = |queries: &[Vec<f32>]| recognizer.recording(queries, &[]).unwrap().warning();
        assert_eq!(warning(&seen(&world, &drive, 0.5, 190)), None);
        let elsewhere = seen(&super::world(200 + seed), &drive, 0.5, 191);
        let Some(Warning::Nothing { mean, step }) = warning(&elsewhere) else {
            panic!("seed {seed}")
        };
        assert!(mean < -0.25 && (200..=drive.len()).contains(&step));
        assert_eq!(warning(&elsewhere[..199]), None);
        // Where the map may be left, the answers tell.
        let made = Recognizer::from_descriptors(&world[..PLACES], Distance::Cosine, options(true));
        assert_eq!(made.unwrap().recording(&elsewhere, &[]).unwrap().warning(), None);
    }
}
