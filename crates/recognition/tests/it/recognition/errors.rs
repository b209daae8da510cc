//! Invalid queries, labels and options, and warnings.

use std::ops::RangeInclusive;

use wayfix::HmmError;
use wayfix::error::{At, Failed, OutOfRange};
use wayfix_recognition::motion::{OdometryModel, OffMap, ViewChangeRates};
use wayfix_recognition::observation::Distance;
use wayfix_recognition::{LabelledPart, Options, RecognitionError, Recognizer};

use super::{DIMENSION, PLACES, labels, options, recognizer, seen, world};
use crate::kit::text;

#[test]
fn bad_queries_are_errors_and_the_track_stays() {
    let (recognizer, world) = recognizer(50, false);
    let mut track = recognizer.track();
    let queries = seen(&world, &[10, 11, 12, 13], 0.5, 51);
    for query in &queries[..3] {
        track.step_with(1.0, query).unwrap();
    }
    let (before, places) = (track.snapshot(), track.places().as_slice().to_vec());
    let mut other = track.clone();
    let mut spoilt = queries[3].clone();
    spoilt[2] = f32::NAN;
    for query in [&[][..], &[1.0; 3], &[0.0; DIMENSION], &spoilt, &[f32::INFINITY; DIMENSION]] {
        let error = track.step(query).unwrap_err();
        assert!(matches!(error, RecognitionError::Descriptor(At { number: 4, .. })), "{error}");
        assert_eq!(track.snapshot(), before);
        assert_eq!(track.places().as_slice(), places);
    }
    for reading in [f64::NAN, f64::INFINITY, 1e7] {
        let error = track.step_with(reading, &queries[3]).unwrap_err();
        let of_step = |error: &_| matches!(error, HmmError::Control(At { number: 4, .. }));
        assert!(
            matches!(&error, RecognitionError::Inference(Failed { cause: e, .. }) if of_step(e)),
            "{error}"
        );
        assert_eq!(track.snapshot(), before);
    }
    assert_eq!(track.step(&queries[3]).unwrap(), other.step(&queries[3]).unwrap());

    let rows = Recognizer::from_distances(3, options(false)).unwrap();
    let mut track = rows.track();
    track.step(&[0.1, 0.5, 0.9]).unwrap();
    let before = track.snapshot();
    let wrong: [&[f32]; 5] =
        [&[], &[0.1], &[0.1, f32::NAN, 0.2], &[0.1, 0.2, -f32::INFINITY], &[f32::INFINITY; 3]];
    for row in wrong {
        let error = track.step(row).unwrap_err();
        assert!(matches!(error, RecognitionError::Query(At { number: 2, .. })), "{error}");
        assert_eq!(track.snapshot(), before);
        let error = rows.recording(&[&[0.1, 0.5, 0.9][..], row], &[]).unwrap_err();
        assert!(matches!(error, RecognitionError::Query(At { number: 2, .. })), "{error}");
    }
    assert_eq!(
        text(track.step(&[0.1])),
        "the query of step 2 is not valid: 1 distances, expected one for each of 3 references"
    );
    // With a state off the map, a query unlike all references is from elsewhere.
    let answer = Recognizer::from_distances(3, options(true)).unwrap().track();
    let answer = { answer }.step(&[f32::INFINITY; 3]).unwrap();
    assert!(answer.place.is_none() && answer.off_map > 0.9);
    let error = rows.recording(&[[0.1, 0.5, 0.9]], &[None, None]).unwrap_err();
    assert!(matches!(error, RecognitionError::Parameter(OutOfRange { value: 2.0, .. })));
}

#[test]
fn labels_that_do_not_fit_are_errors() {
    let (recognizer, world) = recognizer(60, false);
    let drive: Vec<usize> = (10..20).collect();
    let queries = seen(&world, &drive, 0.5, 61);
    let fit = |places: &[Option<RangeInclusive<usize>>], odometry: &[Option<f64>]| {
        text(recognizer.fit(&[LabelledPart { queries: &queries, places, odometry }]))
    };
    let good = labels(&drive);
    assert_eq!(fit(&good[1..], &[]), "the number of labels is 9, expected 10");
    assert_eq!(fit(&good, &[None]), "the number of odometry readings is 1, expected 10");
    let mut wrong = good.clone();
    wrong[3] = Some(118..=PLACES);
    assert_eq!(
        fit(&wrong, &[]),
        "step 3 of labelled part 0 shows references up to 120, expected a non-empty range within \
         0 to 119"
    );
    #[expect(clippy::reversed_empty_ranges, reason = "that is the error")]
    let empty = Some(5..=4);
    wrong[3] = empty;
    assert!(fit(&wrong, &[]).starts_with("step 3 of labelled part 0 shows references up to 4,"));
    let few = "0 labelled steps are on the map, expected at least two in a row";
    assert_eq!(fit(&[const { None }; 10], &[]), few);
    let every_other =
        good.iter().enumerate().map(|(k, label)| label.clone().filter(|_| k % 2 == 0));
    assert!(fit(&every_other.collect::<Vec<_>>(), &[]).starts_with("5 labelled steps"));
    assert_eq!(text(recognizer.fit::<Vec<f32>>(&[])), few);
    let bad = vec![Some(f64::NAN); 10];
    assert_eq!(
        fit(&good, &bad),
        "labelled part 0 is not valid: a step cannot be taken: step 1 has no valid control: \
         an odometry of NaN places, expected a value from -1e6 to 1e6"
    );
}

/// However short the part, and whether learning uses the values or not.
#[test]
fn all_labelled_queries_and_readings_are_checked() {
    let rows = |wrong: f32| -> Vec<Vec<f32>> {
        let row = |k: usize| (0..20).map(|i| if i == k { 0.1 } else { 0.9 }).collect();
        let mut rows: Vec<Vec<f32>> = (0..15).map(row).collect();
        rows[3].fill(wrong);
        rows
    };
    let places: Vec<_> = (0..15).map(|place| Some(place..=place)).collect();
    let recognizer = Recognizer::from_distances(20, options(false)).unwrap();
    let fit = |rows: &[Vec<f32>], odometry: &[Option<f64>]| {
        let good = LabelledPart { queries: rows, places: &places, odometry: &[] };
        let good = LabelledPart { queries: &good.queries[5..], places: &places[5..], ..good };
        let bad = LabelledPart { queries: rows, places: &places, odometry };
        text(recognizer.fit(&[good, bad]))
    };
    let start = "labelled part 1 is not valid: the query of step 4 is not valid: ";
    assert_eq!(
        fit(&rows(f32::NAN), &[]),
        format!("{start}the distance to reference 0 is NaN, expected a number or infinity")
    );
    assert!(fit(&rows(f32::INFINITY), &[]).starts_with(start));
    let mut odometry = vec![None; 15];
    odometry[9] = Some(f64::NAN);
    let message = fit(&rows(0.5), &odometry);
    assert!(message.starts_with("labelled part 1 is not valid: a step cannot be taken: step 10 "));
}

#[test]
fn options_that_do_not_fit_are_errors() {
    let made = |options| text(Recognizer::from_distances(3, options));
    let default = Options::default;
    let fades = default().with_view_fades(f64::NAN);
    assert_eq!(made(fades), "view_fades is NaN, expected from 0 to 1e6");
    let threshold = default().with_view_threshold(-1.0);
    assert!(made(threshold).starts_with("view_threshold is -1"));
    let views = ViewChangeRates { moved: 0.0, ..ViewChangeRates::default() };
    let lost = OffMap { leave: 2.0, ..default().lost() };
    let odometry = OdometryModel { scale: 0.0, ..OdometryModel::default() };
    for options in
        [default().with_views(views), default().with_lost(lost), default().with_odometry(odometry)]
    {
        assert!(made(options).starts_with("the model of motion"));
    }
    assert_eq!(
        text(Recognizer::from_distances(0, options(false))),
        "the number of references is 0, expected at least 1"
    );
    let none: [&[Vec<f32>]; 0] = [];
    let traverses = |all: &[&[Vec<f32>]]| {
        text(Recognizer::from_traverses(all, Distance::Cosine, options(false)))
    };
    assert_eq!(traverses(&none), "the number of traverses is 0, expected at least 1");
    let world = world(1);
    assert_eq!(
        traverses(&[&world[..5], &world[..4]]),
        "the number of references of a traverse is 4, expected 5"
    );
}
