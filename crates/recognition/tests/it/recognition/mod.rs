//! Recognising places end to end, on a simulated route.

mod density;
mod errors;
mod influence;
mod live;
mod mapper;
mod rows;
mod scores;
mod views;
mod warnings;

use std::ops::RangeInclusive;

use rand_distr::{Distribution, StandardNormal};
use wayfix::likelihood::{GroupedLikelihood, Groups};
use wayfix::transition::DistractedTransition;
use wayfix::{Belief, Hmm, LikelihoodVector, Prior};
use wayfix_recognition::motion::OffMap;
use wayfix_recognition::observation::Distance;
use wayfix_recognition::{Answer, LabelledPart, Options, PlaceBeliefs, Recognizer};

use crate::kit::rng;

const PLACES: usize = 120;
const DIMENSION: usize = 24;

/// A descriptor for each place, similar to those next to it, followed by some of places that are
/// not on the map.
fn world(seed: u64) -> Vec<Vec<f32>> {
    let mut rng = rng(seed);
    let mut white =
        || -> Vec<f32> { (0..DIMENSION).map(|_| StandardNormal.sample(&mut rng)).collect() };
    let noise: Vec<Vec<f32>> = (0..PLACES + 42).map(|_| white()).collect();
    let sum = |place: usize| {
        (0..DIMENSION).map(|d| (noise[place][d] + noise[place + 1][d]) / 2_f32.sqrt()).collect()
    };
    (0..PLACES + 40).map(sum).collect()
}

/// Views of the camera at some places, with noise of this size; a vehicle that stands sees the same
/// view again.
fn seen(world: &[Vec<f32>], drive: &[usize], noise: f32, seed: u64) -> Vec<Vec<f32>> {
    let mut rng = rng(seed);
    let mut views: Vec<Vec<f32>> = Vec::new();
    for (k, &place) in drive.iter().enumerate() {
        let stands = k > 0 && drive[k - 1] == place;
        let noise = if stands { 0.003 } else { noise };
        let before = if stands { &views[k - 1] } else { &world[place] };
        let mut error = || -> f32 { StandardNormal.sample(&mut rng) };
        views.push(before.iter().map(|x| x + noise * error()).collect());
    }
    views
}

/// Ahead, a stop, ahead, and twice as fast.
fn usual_drive() -> Vec<usize> {
    (10..50).chain([50; 12]).chain(50..80).chain((80..118).step_by(2)).collect()
}

fn options(off_map: bool) -> Options {
    Options::default().with_off_map(off_map.then(OffMap::default))
}

fn recognizer(seed: u64, off_map: bool) -> (Recognizer, Vec<Vec<f32>>) {
    let world = world(seed);
    let made = Recognizer::from_descriptors(&world[..PLACES], Distance::Cosine, options(off_map));
    (made.unwrap(), world)
}

fn labels(drive: &[usize]) -> Vec<Option<RangeInclusive<usize>>> {
    drive.iter().map(|place| (*place < PLACES).then_some(*place..=*place)).collect()
}

/// Number of answers that are within two places of the truth, or off the map if it is.
fn right(answers: &[Answer], drive: &[usize]) -> usize {
    let right = |(answer, place): (&Answer, &usize)| match answer.place {
        Some(found) => *place < PLACES && found.abs_diff(*place) <= 2,
        None => *place >= PLACES,
    };
    answers.iter().zip(drive).filter(|pair| right(*pair)).count()
}

fn apart(a: &PlaceBeliefs, b: &PlaceBeliefs) -> f64 {
    let pairs = a.iter().zip(b.iter());
    let apart = pairs.flat_map(|(a, b)| {
        let pairs = a.as_slice().iter().zip(b.as_slice());
        pairs.map(|(a, b)| (a - b).abs()).collect::<Vec<_>>()
    });
    apart.fold(0.0, f64::max)
}

#[test]
fn a_track_is_the_filter_of_a_recording() {
    let drive = usual_drive();
    for off_map in [false, true] {
        let (recognizer, world) = recognizer(1, off_map);
        let queries = seen(&world, &drive, 0.7, 2);
        for odometry in [Vec::new(), vec![Some(1.0); queries.len()]] {
            let recording = recognizer.recording(&queries, &odometry).unwrap();
            let filtered = recording.filtered();
            let mut track = recognizer.track();
            let mut sum = 0.0;
            for (at, query) in queries.iter().enumerate() {
                let answer = track.step_with(odometry.get(at).copied().flatten(), query).unwrap();
                assert_eq!(track.places().as_slice(), filtered.get(at).unwrap().as_slice());
                assert_eq!(answer, filtered.answers()[at]);
                let total: f64 = track.places().as_slice().iter().sum();
                assert!((total - 1.0).abs() < 1e-9);
                sum += answer.log_likelihood;
            }
            assert!((sum - track.log_likelihood()).abs() < 1e-9 * sum.abs());
            assert_eq!((track.steps(), filtered.get(drive.len()).is_none()), (drive.len(), true));
        }
    }
}

/// The same smoother, from a model that is composed by hand.
#[test]
fn a_recording_is_a_sequence() {
    let (recognizer, world) = recognizer(5, true);
    let queries = seen(&world, &usual_drive(), 0.7, 6);
    let recording = recognizer.recording(&queries, &vec![Some(1.0); queries.len()]).unwrap();
    let motion = recognizer.motion().clone();
    let (places, rates) = (motion.place_groups(), recognizer.options().distractions());
    let anywhere = motion.anywhere();
    let of_mode = |share: f64| anywhere.as_slice().iter().map(move |p| p * share);
    let prior = of_mode(1.0 - rates.begin).chain(of_mode(rates.begin)).collect();
    let prior = Prior::AtFirstObservation(Belief::from_weights(prior).unwrap());
    // A likelihood for each place, one for off the map, and one for a distracted camera.
    let distracted = vec![places.count(); anywhere.as_slice().len()];
    let groups = Groups::new([places.as_slice(), &distracted].concat()).unwrap();
    let sensor = LikelihoodVector::linear(places.count() + 1).owned();
    let sensor = GroupedLikelihood::new(sensor, groups).unwrap();
    let drive = DistractedTransition::new(motion, rates).unwrap();
    let smoothing = Hmm::new(prior, drive, sensor).unwrap().smooth(&recording).unwrap();
    let smoothed = recording.smoothed().unwrap();
    assert_eq!(smoothing.posteriors().steps(), smoothed.steps());
    for (states, expected) in smoothing.posteriors().iter().zip(smoothed.iter()) {
        let mut found = vec![0.0; places.count()];
        for (state, p) in states.as_slice().iter().enumerate() {
            found[places.as_slice()[state % distracted.len()]] += p;
        }
        let mut pairs = found.iter().zip(expected.as_slice());
        assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

#[test]
fn lags_lie_between_filter_and_smoother() {
    let drive = usual_drive();
    let (recognizer, world) = recognizer(3, true);
    let queries = seen(&world, &drive, 0.7, 4);
    let recording = recognizer.recording(&queries, &[]).unwrap();
    let (filtered, smoothed) = (recording.filtered(), recording.smoothed().unwrap());
    let lags = [0, 5, queries.len(), 3 * queries.len()];
    let lagged = recording.lagged(&lags).unwrap();
    assert!(apart(&lagged[0], &filtered) < 1e-12);
    assert!(apart(&lagged[2], &smoothed) < 1e-9 && apart(&lagged[3], &smoothed) < 1e-9);
    let logs = |beliefs: &PlaceBeliefs| -> Vec<f64> {
        beliefs.answers().iter().map(|answer| answer.log_likelihood).collect()
    };
    for beliefs in &lagged {
        assert_eq!(logs(beliefs), logs(&filtered));
    }
    let last = queries.len() - 1;
    let ends = [&filtered, &smoothed, &lagged[1]].map(|b| b.get(last).unwrap().as_slice().to_vec());
    for end in &ends {
        assert!(end.iter().zip(&ends[0]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
    let counts = [&filtered, &lagged[1], &smoothed].map(|b| right(&b.answers(), &drive));
    assert!(counts[0] <= counts[1] + 3 && counts[1] <= counts[2] + 3, "{counts:?}");
    assert!(counts[2] + 5 >= drive.len(), "{counts:?}");
    let decoded = recording.decoded().unwrap();
    let near = decoded.iter().zip(&drive).filter(|(a, b)| a.is_some_and(|a| a.abs_diff(**b) <= 2));
    assert!(near.count() + 5 >= drive.len());
    assert_eq!(recording.single().steps(), drive.len());
    assert_eq!(recording.lagged(&[]).unwrap().len(), 0);
    let nothing = recognizer.recording::<Vec<f32>>(&[], &[]).unwrap();
    assert_eq!(nothing.filtered().steps() + nothing.smoothed().unwrap().steps(), 0);
    assert!(nothing.decoded().unwrap().is_empty());
    assert_eq!(nothing.lagged(&[3]).unwrap()[0].steps(), 0);
}

#[test]
fn what_is_around_an_answer_holds_nine_tenths() {
    for closed in [false, true] {
        let world = world(5);
        let options = options(true).with_closed(closed);
        let made = Recognizer::from_descriptors(&world[..PLACES], Distance::Cosine, options);
        let recognizer = made.unwrap();
        let drive: Vec<usize> = (60..120).chain(0..20).collect();
        let recording = recognizer.recording(&seen(&world, &drive, 1.0, 6), &[]).unwrap();
        for beliefs in [recording.filtered(), recording.smoothed().unwrap()] {
            for (answer, belief) in beliefs.answers().iter().zip(beliefs.iter()) {
                let places = &belief.as_slice()[..PLACES];
                let (first, last) = (*answer.around.start(), *answer.around.end());
                let inside = |i: usize| {
                    if first <= last {
                        (first..=last).contains(&i)
                    } else {
                        i >= first || i <= last
                    }
                };
                assert!(first <= last || closed);
                let held: f64 = (0..PLACES).filter(|i| inside(*i)).map(|i| places[i]).sum();
                let all: f64 = places.iter().sum();
                assert!(held >= 0.9 * all - 1e-9, "{held} of {all} in {:?}", answer.around);
                if let Some(place) = answer.place {
                    assert!(inside(place));
                    assert_eq!(answer.probability, recognizer.mass_near(places, place, 1));
                }
            }
        }
    }
}

/// Views elsewhere look alike for a while, so a detour is seen as it goes on, and known afterwards.
#[test]
fn a_detour_is_found() {
    let (mut live, mut known, mut sure_and_wrong) = (0, 0, 0);
    for seed in 0..5 {
        let drive: Vec<usize> = (10..50).chain(PLACES..PLACES + 40).chain(50..90).collect();
        let (recognizer, world) = recognizer(10 + seed, true);
        let queries = seen(&world, &drive, 0.5, 20 + seed);
        let recording = recognizer.recording(&queries, &[]).unwrap();
        let found = |beliefs: &PlaceBeliefs| {
            let answers = beliefs.answers();
            let on = answers[10..40].iter().chain(&answers[95..]);
            assert!(on.filter(|answer| answer.place.is_none()).count() <= 3);
            assert!(right(&answers[10..40], &drive[10..40]) >= 28);
            answers[40..80].iter().filter(|answer| answer.place.is_none()).count()
        };
        let filtered = recording.filtered();
        live += found(&filtered);
        // What it says of the route meanwhile, it rarely believes.
        let sure = |answer: &&Answer| answer.place.is_some() && answer.probability > 0.9;
        sure_and_wrong += filtered.answers()[40..80].iter().filter(sure).count();
        let smoothed = found(&recording.smoothed().unwrap());
        assert!(smoothed >= 30, "seed {seed}: {smoothed}");
        known += smoothed;
        let decoded = recording.decoded().unwrap();
        assert!(decoded[45..75].iter().filter(|place| place.is_none()).count() > 20);
    }
    assert!(live >= 60 && known >= 180, "{live} and {known} of 200");
    assert!(sure_and_wrong <= 40, "{sure_and_wrong} of 200");
}

/// Carried from one place to another, without a model of off the map.
#[test]
fn a_kidnapped_vehicle_is_found_again() {
    for seed in 0..5 {
        let drive: Vec<usize> = (10..50).chain(90..118).collect();
        let (recognizer, world) = recognizer(30 + seed, false);
        let recording = recognizer.recording(&seen(&world, &drive, 0.5, 40 + seed), &[]);
        let answers = recording.unwrap().filtered().answers();
        assert!(right(&answers[60..], &drive[60..]) >= 7, "seed {seed}");
        assert!(answers.iter().all(|answer| answer.place.is_some() && answer.off_map == 0.0));
    }
}

#[test]
fn several_traverses_see_what_one_does_not() {
    let world = world(80);
    // In the second season, half of the places look like no reference.
    let other: Vec<Vec<f32>> = seen(&world, &(0..PLACES).collect::<Vec<_>>(), 1.5, 81);
    let drive: Vec<usize> = (5..115).collect();
    let queries = seen(&other, &drive, 0.3, 82);
    let count = |traverses: &[&[Vec<f32>]]| {
        let made = Recognizer::from_traverses(traverses, Distance::Cosine, options(false));
        let beliefs = made.unwrap().recording(&queries, &[]).unwrap().single();
        right(&beliefs.answers(), &drive)
    };
    let (one, two) = (count(&[&world[..PLACES]]), count(&[&world[..PLACES], &other]));
    assert!(two > one && two >= 100, "{one} and {two}");
    assert_eq!(count(&[&other, &world[..PLACES]]), two);
}

#[test]
fn a_fit_of_another_map_keeps_what_is_not_of_its_places() {
    let (recognizer, world) = recognizer(90, true);
    let drive: Vec<usize> = (5..115).collect();
    let queries = seen(&world, &drive, 0.5, 91);
    let places = labels(&drive);
    let odometry = vec![Some(1.04); drive.len()];
    let part = LabelledPart { queries: &queries, places: &places, odometry: &odometry };
    let fitted = recognizer.fit(&[part]).unwrap();
    let fit = fitted.parameters();
    assert!(fit.options().odometry().scale > 1.0);
    let smaller = Recognizer::from_descriptors(&world[..50], Distance::Cosine, options(false));
    let smaller = smaller.unwrap().with_parameters(fit.clone()).unwrap();
    assert_eq!(smaller.options(), fit.options());
    assert_eq!(*smaller.parameters(), fit.clone().without_references());
    assert_eq!(smaller.references(), 50);
    let drive: Vec<usize> = (5..45).collect();
    let answers = smaller.recording(&seen(&world, &drive, 0.5, 92), &[]).unwrap();
    assert!(right(&answers.filtered().answers(), &drive) >= 30);
    assert!(fit.options().speeds() != Options::default().speeds());
}
