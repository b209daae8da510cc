//! Place recognition from end to end, on simulated distances: starts anywhere, kidnapped vehicles,
//! and places that are not on the map.

use rand_distr::{Distribution, StandardNormal};
use wayfix::likelihood::GroupedLikelihood;
use wayfix::motion::OffMapTransition;
use wayfix::transition::{RestartTransition, WindowTransition};
use wayfix::{
    Belief, Filter, Hmm, Likelihood, LikelihoodVector, OptionalLikelihood, Prior, Transition,
    evaluate,
};
use wayfix_recognition::motion::{
    RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates, ViewEvidence,
};
use wayfix_recognition::observation::{
    Distance, MatchOdds, ReferenceDescriptors, Standardizer, ViewComparison,
};

use crate::kit::rng;

const PLACES: usize = 200;

/// Rows of distances of a drive; `None` is off the map. The right reference is only 1.5 standard
/// deviations nearer than others, so that the nearest is usually wrong.
fn rows(drive: &[Option<usize>], seed: u64) -> Vec<Vec<f32>> {
    let mut rng = rng(seed);
    let row = |place: &Option<usize>| {
        let mut row: Vec<f32> = (0..PLACES).map(|_| StandardNormal.sample(&mut rng)).collect();
        if let Some(place) = place {
            row[*place] -= 1.5;
        }
        row
    };
    drive.iter().map(row).collect()
}

fn ahead() -> WindowTransition {
    WindowTransition::closed(PLACES, 0, &[0.1, 0.8, 0.1]).unwrap()
}

/// Camera whose frames are given as log-odds.
fn camera() -> LikelihoodVector<Vec<f64>> {
    LikelihoodVector::log(PLACES).owned()
}

/// Log-odds of the places for each row, with independent errors. A row that repeats the one before
/// is not learned from.
fn log_odds(rows: &[Vec<f32>]) -> Vec<Vec<f64>> {
    let odds = MatchOdds::default();
    let mut references = Standardizer::new(PLACES).unwrap();
    let mut scores = vec![0.0; PLACES];
    let of_row = |(k, row): (usize, &Vec<f32>)| {
        references.scores(row, &mut scores).unwrap();
        if k == 0 || rows[k - 1] != *row {
            references.observe(row).unwrap();
        }
        scores.iter().map(|score| odds.log_odds(*score)).collect()
    };
    rows.iter().enumerate().map(of_row).collect()
}

fn from_anywhere<A: Transition, B: Likelihood>(motion: A, camera: B) -> Hmm<A, B> {
    let prior = Belief::uniform(motion.states()).unwrap();
    Hmm::new(Prior::AtFirstObservation(prior), motion, camera).unwrap()
}

/// The mass within two places of the mode after each step, and whether the mode
/// is within two of the truth.
fn masses<A: Transition<Control = ()>>(
    filter: &mut Filter<&Hmm<A, LikelihoodVector<Vec<f64>>>>,
    drive: &[Option<usize>],
    rows: &[Vec<f64>],
) -> Vec<(f64, bool)> {
    let step = |(place, row): (&Option<usize>, &Vec<f64>)| {
        filter.step(row).unwrap();
        let belief = filter.belief();
        let mode = belief.mode();
        let right = place.is_some_and(|place| mode.abs_diff(place) <= 2);
        (belief.mass_around(mode, 2).unwrap(), right)
    };
    drive.iter().zip(rows).map(step).collect()
}

#[test]
fn a_filter_that_starts_anywhere_says_when_it_has_found_its_place() {
    let drive: Vec<Option<usize>> = (20..120).map(Some).collect();
    let hmm = from_anywhere(ahead(), camera());
    for seed in 0..10 {
        let rows = log_odds(&rows(&drive, seed));
        let masses = masses(&mut hmm.filter(), &drive, &rows);
        let steps = evaluate::steps_to_localize_correctly(&masses, 0.9, 5).unwrap();
        let steps = steps.expect("it finds its place");
        // One image is not enough, and forty are plenty.
        assert!((2..=40).contains(&steps), "seed {seed}: {steps} steps");
        assert!(masses[0].0 < 0.9, "seed {seed}");
    }
}

#[test]
fn a_restart_mix_brings_a_kidnapped_vehicle_back() {
    let drive: Vec<Option<usize>> = (0..50).chain(120..180).map(Some).collect();
    let anywhere = Belief::uniform(PLACES).unwrap();
    let mixed = RestartTransition::new(ahead(), 0.001, anywhere).unwrap();
    let (mixed, plain) = (from_anywhere(mixed, camera()), from_anywhere(ahead(), camera()));
    let mut lost = 0;
    for seed in 0..10 {
        let rows = log_odds(&rows(&drive, seed));
        let masses_of = |masses: Vec<(f64, bool)>| {
            evaluate::steps_to_localize_correctly(&masses[50..], 0.9, 5).unwrap()
        };
        let back = masses_of(masses(&mut mixed.filter(), &drive, &rows));
        assert!(back.is_some_and(|steps| steps <= 40), "seed {seed}: {back:?}");
        // A window alone stays wrong for longer, or for ever.
        let without = masses_of(masses(&mut plain.filter(), &drive, &rows));
        lost += usize::from(without.is_none_or(|steps| Some(steps) > back));
    }
    assert!(lost >= 8, "{lost} of 10");
}

#[test]
fn filter_fixed_lag_smoother_and_viterbi_tell_places_that_are_not_on_the_map() {
    let drive: Vec<Option<usize>> =
        (10..60).map(Some).chain([None; 40]).chain((60..110).map(Some)).collect();
    let back = Belief::uniform(PLACES).unwrap();
    let motion = OffMapTransition::new(ahead(), 0.002, 0.02, back).unwrap();
    let hmm = from_anywhere(motion, LikelihoodVector::log(PLACES + 1).owned());
    let off = hmm.transition().off_map_state();
    // Off the map, the odds hardly depend on the image.
    let with_off_map = |odds: Vec<f64>| [odds, vec![0.9_f64.ln()]].concat();
    for seed in 0..5 {
        let rows: Vec<Vec<f64>> =
            log_odds(&rows(&drive, seed)).into_iter().map(with_off_map).collect();
        let mut stream = hmm.fixed_lag(20);
        let (mut filtered, mut lagged) = (Vec::new(), Vec::new());
        for (step, row) in rows.iter().enumerate() {
            stream.step(row).unwrap();
            filtered.push(stream.filter().belief().as_slice()[off]);
            if step >= 20 {
                lagged.push(stream.lagged().as_slice()[off]);
            }
        }
        let smoothing = hmm.smooth(&rows).unwrap();
        let smoothed: Vec<f64> =
            smoothing.posteriors().iter().map(|belief| belief.as_slice()[off]).collect();
        let path = hmm.viterbi(&rows).unwrap();
        let decoded: Vec<f64> =
            path.states().iter().map(|state| f64::from(u8::from(*state == off))).collect();
        for (name, scores, least) in [
            ("filter", &filtered, 0.85),
            ("fixed lag", &lagged, 0.95),
            ("smoother", &smoothed, 0.95),
            ("viterbi", &decoded, 0.8), // answers without a confidence have no curve
        ] {
            let samples: Vec<(f64, bool)> =
                scores.iter().zip(&drive).map(|(p, place)| (*p, place.is_none())).collect();
            let area = wayfix_recognition::ThresholdCurve::roc(&samples).unwrap().area();
            assert!(area >= least, "{name}, seed {seed}: {area}");
        }
        // A query infinitely far from all references is off the map.
        let mut filter = hmm.filter();
        let nowhere = log_odds(&[vec![f32::INFINITY; PLACES]]).remove(0);
        filter.step(&with_off_map(nowhere.clone())).unwrap();
        assert_eq!(filter.belief().mode(), off);
        assert_eq!(filter.belief().as_slice()[off], 1.0);
        assert!(from_anywhere(ahead(), camera()).filter().step(&nowhere).is_err());
    }
}

#[test]
fn a_stop_does_not_count_one_image_again_and_again() {
    // Place 80 looks most like 30 today.
    let drive: Vec<usize> = (60..80).chain([80; 100]).chain(80..100).collect();
    let mut rows = rows(&drive.iter().copied().map(Some).collect::<Vec<_>>(), 3);
    rows[20][30] = -4.0;
    let stop = rows[20].clone();
    rows[20..120].fill(stop);

    let speeds = Speeds::new(&[0.0, 1.0]).and_then(|speeds| speeds.with_changes(0.0, 0.1));
    let motion = RouteTransition::closed(PLACES, speeds.unwrap())
        .unwrap()
        .with_views(ViewChangeRates { standing: 0.95, moved: 0.03 })
        .unwrap();
    let sensor = OptionalLikelihood::new(camera());
    let sensor = GroupedLikelihood::new(sensor, motion.place_groups()).unwrap();
    let groups = motion.place_groups();
    let hmm = from_anywhere(motion, sensor);

    let mut views = ViewComparison::new(0.1).unwrap();
    let [mut wise, mut naive] = [hmm.filter(), hmm.filter()];
    for (row, odds) in rows.iter().zip(log_odds(&rows)).take(120) {
        let view = views.next(row).unwrap();
        let seen = (view == ViewChange::Changed).then(|| odds.clone());
        let view = Some(ViewEvidence { view, weight: 1.0 });
        wise.step_with(&RouteControl { view, ..RouteControl::default() }, &seen).unwrap();
        naive.step_with(&RouteControl::default(), &Some(odds)).unwrap();
    }
    let place = |filter: &Filter<_>| groups.marginal(&filter.belief()).unwrap().mode();
    assert_eq!(place(&naive), 30);
    assert_eq!(place(&wise), 80);
}

#[test]
fn descriptors_lead_to_a_position_at_any_length_of_stream() {
    let mut rng = rng(4);
    let descriptors: Vec<Vec<f32>> =
        (0..PLACES).map(|_| (0..32).map(|_| StandardNormal.sample(&mut rng)).collect()).collect();
    let references = ReferenceDescriptors::from_rows(&descriptors, Distance::Cosine).unwrap();
    let hmm = from_anywhere(ahead(), camera());
    let mut filter = hmm.filter();
    let mut right = 0;
    let odds = MatchOdds::default();
    let mut standard = Standardizer::new(PLACES).unwrap();
    let (mut distances, mut likelihoods) = (vec![0.0; PLACES], vec![0.0; PLACES]);
    for step in 0..2_000 {
        let place = step % PLACES;
        let noisy: Vec<f32> = descriptors[place]
            .iter()
            .map(|x| {
                let noise: f32 = StandardNormal.sample(&mut rng);
                x + noise
            })
            .collect();
        references.distances_into(&noisy, &mut distances).unwrap();
        standard.scores(&distances, &mut likelihoods).unwrap();
        standard.observe(&distances).unwrap();
        likelihoods.iter_mut().for_each(|score| *score = odds.log_odds(*score));
        filter.step(&likelihoods).unwrap();
        right += usize::from(filter.belief().mode() == place);
    }
    assert!(right > 1_900, "{right} of 2000");
}
