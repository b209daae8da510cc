//! Mapping while driving: refused inputs, and settings that are kept.

use wayfix::HmmError;
use wayfix::error::{At, Failed, OutOfRange};
use wayfix_recognition::motion::{OdometryModel, OffMap, ViewChangeRates};
use wayfix_recognition::observation::{Distance, ViewError};
use wayfix_recognition::{Mapper, Options, RecognitionError};

use crate::kit::noise;

const LOOP: usize = 120;

fn image(place: usize) -> Vec<f32> {
    (1..17).map(|k| ((place * 16 + k).pow(2) as f32 * 0.37).sin()).collect()
}

#[test]
fn what_is_no_descriptor_never_becomes_a_reference() {
    let too_long = [f32::MAX; 16];
    let cases: [(Distance, &[f32]); 5] = [
        (Distance::Cosine, &[0.0; 16]),
        (Distance::Euclidean, &too_long),
        (Distance::Cosine, &[f32::NAN; 16]),
        (Distance::Euclidean, &[]),
        (Distance::Cosine, &[1.0; 3]),
    ];
    for (distance, wrong) in cases {
        let mut mapper = Mapper::new(distance, Options::default()).unwrap();
        let mut again = 0;
        for step in 0..LOOP * 3 / 2 {
            if step % 30 == 7 || (step == 0 && wrong.len() != 3) {
                let before = mapper.references().len();
                let error = mapper.step(wrong).unwrap_err();
                match error {
                    RecognitionError::Parameter(OutOfRange { what, .. }) => {
                        assert_eq!((&*what, wrong), ("the length of a descriptor", &too_long[..]));
                    }
                    RecognitionError::Descriptor(At { number: at, .. }) => assert_eq!(at, step + 1),
                    error => panic!("{error}"),
                }
                assert_eq!(mapper.references().len(), before);
            }
            let place = mapper.step(&image(step % LOOP)).unwrap().and_then(|seen| seen.place);
            again += u32::from(place.is_some_and(|place| place.abs_diff(step % LOOP) <= 2));
        }
        assert!(again > 30, "{distance:?} {again}");
    }
    let mut mapper = Mapper::new(Distance::Cosine, Options::default()).unwrap();
    let error = mapper.step(&[0.0; 4]).unwrap_err();
    let zero = |source: &_| matches!(source, ViewError::Zero { .. });
    assert!(matches!(&error, RecognitionError::Descriptor(At { cause, .. }) if zero(cause)));
    assert_eq!(
        error.to_string(),
        "the descriptor of the query of step 1 is not valid: query 0 is 0 in every element, so it \
         has no cosine with another"
    );
}

/// Equal images make no model, which is not an error.
#[test]
fn a_vehicle_that_stands_from_the_start_is_no_error() {
    let options = Options::default().with_view_threshold(0.0);
    let mut mapper = Mapper::new(Distance::Cosine, options).unwrap();
    for _ in 0..120 {
        mapper.step_with(0.0, &image(1)).unwrap();
    }
}

/// With odometry, noise at a red light adds no references.
#[test]
fn a_vehicle_that_stands_adds_no_references_by_odometry() {
    let noisy = |place: usize, step: usize| -> Vec<f32> {
        let noise = |k: usize| 0.02 * ((step * 31 + k * 17) as f32).sin();
        image(place).iter().enumerate().map(|(k, x)| x + noise(k)).collect()
    };
    let count = |odometry: Option<f64>| {
        let mut mapper = Mapper::new(Distance::Cosine, Options::default()).unwrap();
        for step in 0..20 {
            mapper.step_with(1.0, &noisy(step, step)).unwrap();
        }
        for step in 20..45 {
            mapper.step_with(odometry, &noisy(19, step)).unwrap();
        }
        mapper.references().len()
    };
    assert!(count(Some(0.0)) == 20 && count(None) > 35);
}

/// Two tunnels look alike, but nothing after them does.
#[test]
fn a_dark_stretch_like_another_is_no_place_seen_before() {
    let dark = |step: usize| -> Vec<f32> {
        (0..16).map(|k| 0.3 + 0.01 * ((step * 13 + k * 7) as f32).sin()).collect()
    };
    let light = |step: usize| -> Vec<f32> {
        let scrambled = |k: usize| (step * 16 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        (0..16).map(|k| (scrambled(k) * scrambled(k) % 1009) as f32 / 1009.0).collect()
    };
    let mut mapper = Mapper::new(Distance::Euclidean, Options::default()).unwrap();
    for step in 0..300 {
        let is_dark = (60..72).contains(&step) || (200..212).contains(&step);
        let view = if is_dark { dark(step) } else { light(step) };
        let seen = mapper.step(&view).unwrap();
        assert!(seen.is_none(), "{step}: {seen:?}");
    }
}

#[test]
fn options_and_readings_are_checked_from_the_start() {
    let made = |options| Mapper::new(Distance::Cosine, options).unwrap_err().to_string();
    let default = Options::default;
    let never = Some(OffMap { leave: 0.0, ..OffMap::default() });
    let start = "the model of motion is not valid: the ";
    assert!(made(default().with_off_map(never)).starts_with(start));
    let odometry = OdometryModel { scale: 0.0, ..OdometryModel::default() };
    assert!(made(default().with_odometry(odometry)).starts_with(start));
    let views = ViewChangeRates { moved: 0.0, ..ViewChangeRates::default() };
    assert!(made(default().with_views(views)).starts_with("the model of motion"));
    assert!(made(default().with_view_fades(-1.0)).starts_with("view_fades is -1"));

    let made = Mapper::new(Distance::Cosine, Options::default()).unwrap();
    let mut mapper = made.with_gap(usize::MAX);
    for step in 0..100 {
        for reading in [f64::NAN, f64::INFINITY, 1e7] {
            let error = mapper.step_with(reading, &image(step)).unwrap_err();
            let names =
                |e: &_| matches!(e, HmmError::Control(At { number: at, .. }) if *at == step + 1);
            assert!(
                matches!(&error, RecognitionError::Inference(Failed { cause: e, .. }) if names(e)),
                "{error}"
            );
        }
        assert_eq!(mapper.references().len(), step);
        assert_eq!(mapper.step_with(1.0, &image(step)).unwrap(), None);
        assert_eq!(mapper.references().len(), step + 1);
    }
}

/// Views that change little from one to the next look like others a while later, but no place is
/// seen twice; and on a second pass it is.
#[test]
fn a_first_pass_does_not_close_however_alike_its_neighbours_are() {
    for (seed, correlated) in [(1, 1), (2, 4), (3, 20)] {
        let white: Vec<Vec<f32>> =
            noise(64 * (400 + correlated), seed).chunks(64).map(<[f32]>::to_vec).collect();
        let mean =
            |at: usize, d: usize| white[at..at + correlated].iter().map(|w| w[d]).sum::<f32>();
        let view = |at: usize| -> Vec<f32> { (0..64).map(|d| mean(at, d)).collect() };
        let mut mapper = Mapper::new(Distance::Cosine, Options::default()).unwrap();
        for at in 0..400 {
            let answer = mapper.step(&view(at)).unwrap();
            assert!(answer.is_none(), "{correlated}: {answer:?} at {at}");
        }
        let near = |at: usize| {
            let again: Vec<f32> = view(at).iter().map(|x| x * 1.1 + 0.01).collect();
            let place = mapper.step(&again).unwrap().and_then(|answer| answer.place);
            place.map(|place| place.abs_diff(at) <= correlated)
        };
        let closed: Vec<bool> = (0..400).filter_map(near).collect();
        assert!(closed.len() >= 250 && closed.iter().all(|right| *right), "{closed:?}");
    }
}

/// A camera at half the rate of steps, or a vehicle that stops at each place.
#[test]
fn views_that_come_twice_are_recognised_too() {
    let images: Vec<Vec<f32>> = noise(16 * LOOP, 9).chunks(16).map(<[f32]>::to_vec).collect();
    let mut mapper = Mapper::new(Distance::Cosine, Options::default()).unwrap();
    let mut again = 0;
    for step in 0..LOOP * 4 {
        let place = step / 2 % LOOP;
        let seen = mapper.step(&images[place]).unwrap().and_then(|answer| answer.place);
        if step < 2 * LOOP {
            assert_eq!(seen, None);
        }
        again += u32::from(seen.is_some_and(|seen| seen.abs_diff(place) <= 2));
    }
    assert!(again > 120, "{again}");
    assert!(mapper.references().len() < 160);
}
