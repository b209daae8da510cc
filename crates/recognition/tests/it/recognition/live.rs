//! A track over lost frames, after a relocation, and at the limits of doubles.

use wayfix::HmmError;
use wayfix::error::{At, Failed};
use wayfix_recognition::motion::OffMap;
use wayfix_recognition::{Options, RecognitionError, Recognizer};

use super::{PLACES, options, recognizer, right, seen};

#[test]
fn lost_frames_are_steps_of_motion_alone() {
    for off_map in [false, true] {
        let (recognizer, world) = recognizer(100, off_map);
        let drive: Vec<usize> = (10..60).collect();
        let queries = seen(&world, &drive, 0.4, 101);
        let mut track = recognizer.track();
        let mut answers = Vec::new();
        for (k, query) in queries.iter().enumerate() {
            let lost = k > 20 && k % 10 < 4;
            let answer = if lost { track.predict_with(1.0) } else { track.step_with(1.0, query) };
            answers.push(answer.unwrap());
            assert_eq!(track.steps(), k + 1);
            let total: f64 = track.places().as_slice().iter().sum();
            assert!((total - 1.0).abs() < 1e-9);
        }
        assert!(right(&answers[15..], &drive[15..]) >= 33);
        let sum: f64 = answers.iter().map(|answer| answer.log_likelihood).sum();
        assert!((sum - track.log_likelihood()).abs() < 1e-9);
        // A step without a query or a reading carries no evidence.
        assert!(track.predict().unwrap().log_likelihood.abs() < 1e-12);
        let before = track.snapshot();
        for reading in [f64::NAN, 1e7] {
            let error = track.predict_with(reading).unwrap_err();
            let of_step = |e: &_| matches!(e, HmmError::Control(At { number: 52, .. }));
            assert!(
                matches!(&error, RecognitionError::Inference(Failed { cause: e, .. }) if of_step(e)),
                "{error}"
            );
            assert_eq!(track.snapshot(), before);
        }
        // A track may begin with one, too.
        let mut track = recognizer.track();
        assert!(track.predict_with(f64::NAN).is_err());
        track.predict_with(1.0).unwrap();
        track.step(&queries[0]).unwrap();
    }
}

/// The view after lost frames is compared with the frame before them, not with that of the previous
/// step.
#[test]
fn a_view_after_a_lost_frame_is_no_evidence_on_the_move() {
    let (recognizer, world) = recognizer(110, false);
    let drive: Vec<usize> = (10..40).collect();
    let queries = seen(&world, &drive, 0.3, 111);
    let blind = Options::default().with_use_views(false);
    let blind =
        recognizer.with_parameters(recognizer.parameters().clone().with_options(blind)).unwrap();
    let (mut track, mut other) = (recognizer.track(), blind.track());
    queries.iter().for_each(|query| _ = track.step(query).unwrap());
    other.restore(&track.snapshot()).unwrap();
    for track in [&mut track, &mut other] {
        track.predict().unwrap();
        track.step(&queries[29]).unwrap();
    }
    assert_eq!(track.places().as_slice(), other.places().as_slice());
}

#[test]
fn a_parked_vehicle_that_is_relocated_sees_again() {
    let (recognizer, world) = recognizer(120, false);
    let queries = seen(&world, &[70; 20], 0.3, 121);
    let mut track = recognizer.track();
    queries.iter().for_each(|query| _ = track.step(query).unwrap());
    track.relocate();
    let mut fresh = recognizer.track();
    let (again, first) = (track.step(&queries[19]).unwrap(), fresh.step(&queries[19]));
    let first = first.unwrap();
    assert_eq!((again.place, first.place), (Some(70), Some(70)));
    assert!(again.probability > 0.5 * first.probability, "{again:?} {first:?}");
}

/// The longer it is lost, the less is known of its place.
#[test]
fn a_vehicle_that_may_be_lost_may_be_anywhere() {
    let (recognizer, world) = recognizer(123, false);
    let drive: Vec<usize> = (10..60).collect();
    let queries = seen(&world, &drive, 0.5, 124);
    let sure = |leave: f64| {
        let options = recognizer.options().clone();
        let lost = OffMap { leave, ..options.lost() };
        let fit = recognizer.parameters().clone().with_options(options.with_lost(lost));
        let mut track = recognizer.with_parameters(fit).unwrap().track();
        queries.iter().for_each(|query| _ = track.step(query).unwrap());
        let least = track.places().as_slice().iter().copied().fold(1.0, f64::min);
        assert!(least >= 0.0);
        (0..60).fold((0.0, least), |_, _| (track.predict().unwrap().probability, least))
    };
    let (rare, often) = (sure(1e-6), sure(0.5));
    assert!(often.0 < 0.5 * rare.0 && often.1 > rare.1, "{rare:?} {often:?}");
}

#[test]
fn single_images_are_judged_by_their_odds_alone() {
    let (recognizer, world) = recognizer(130, true);
    let drive: Vec<usize> = (10..60).chain(PLACES..PLACES + 5).collect();
    let recording = recognizer.recording(&seen(&world, &drive, 0.5, 131), &[]).unwrap();
    let single = recording.single();
    let right = right(&single.answers(), &drive[..50]);
    assert!(right >= 45, "{right} of 50");
    for (belief, answer) in single.iter().zip(single.answers()) {
        assert!((belief.as_slice().iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(answer.log_likelihood.is_finite() && answer.probability > 0.0);
    }
    // Surely off the map, with equally likely places.
    let rows = Recognizer::from_distances(3, options(true)).unwrap();
    let nowhere = rows.recording(&[[f32::INFINITY; 3]], &[]).unwrap().single();
    assert!((nowhere.mass(0, None) - 1.0).abs() < 1e-12);
    assert!(nowhere.answers()[0].log_likelihood.is_finite());
}

#[test]
fn the_mass_of_no_place_is_zero() {
    let (recognizer, world) = recognizer(140, false);
    let recording = recognizer.recording(&seen(&world, &[3, 4], 0.5, 141), &[]).unwrap();
    let beliefs = recording.filtered();
    assert_eq!(beliefs.mass(0, Some(&(PLACES..=PLACES + 3))).to_bits(), 0);
    assert_eq!(beliefs.mass(9, Some(&(0..=3))).to_bits(), 0);
    assert_eq!(recognizer.mass_near(&[], 3, 1).to_bits(), 0);
    assert!(recognizer.mass_near(&[f64::NAN; 5], 3, 1).is_nan());
}

/// Wheels that are stuck during lost frames lead on by ever fewer of their readings.
#[test]
fn equal_readings_of_lost_frames_count_less_too() {
    let (recognizer, world) = recognizer(125, false);
    let drive: Vec<usize> = (10..40).collect();
    let mut stuck = recognizer.track();
    seen(&world, &drive, 0.3, 126).iter().for_each(|query| _ = stuck.step(query).unwrap());
    let mut varied = stuck.clone();
    let mut spread = [0, 0];
    for k in 0..40_u32 {
        let answers = [
            stuck.predict_with(2.0).unwrap(),
            varied.predict_with(2.0 + 0.01 * f64::from(k % 2)).unwrap(),
        ];
        spread = answers.map(|answer| answer.around.end() - answer.around.start());
        let refused = stuck.predict_with(f64::NAN);
        assert!(refused.is_err());
    }
    assert!(spread[0] > spread[1], "{spread:?}");
}
