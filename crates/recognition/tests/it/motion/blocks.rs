//! Long routes, whose products are taken block by block.

use wayfix::likelihood::GroupedLikelihood;
use wayfix::{Hmm, HmmError, LikelihoodVector, Prior, Transition, TransitionEntries};
use wayfix_recognition::motion::{
    OffMap, RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates, ViewEvidence,
};

/// Several blocks, the last one short.
const PLACES: usize = 1291;

fn routes() -> Vec<RouteTransition> {
    let made = [RouteTransition::open, RouteTransition::closed];
    let mut routes = made.map(|make| make(PLACES, Speeds::default()).unwrap()).to_vec();
    for route in routes.clone() {
        let route = route.with_views(ViewChangeRates::default()).unwrap();
        let never_near = OffMap { near: 0.0, ..OffMap::default() };
        routes.push(route.clone().with_off_map(never_near).unwrap());
        let wherever = OffMap { within: usize::MAX, ..OffMap::default() };
        routes.push(route.clone().with_off_map(wherever).unwrap());
        routes.push(route.with_off_map(OffMap::default()).unwrap());
    }
    routes
}

fn control(step: usize) -> RouteControl {
    let view = [ViewChange::Changed, ViewChange::Unchanged][step % 3 % 2];
    let view = (!step.is_multiple_of(4)).then_some(ViewEvidence { view, weight: 0.7 });
    RouteControl { odometry: (step % 5 < 3).then_some(1.0 + 0.1 * step as f64), view, before: None }
}

fn numbers(count: usize, factor: f64) -> Vec<f64> {
    (1..=count).map(|i| 0.01 + (i as f64 * factor).fract()).collect()
}

#[test]
fn blocks_are_the_operator() {
    for route in routes() {
        let n = route.states();
        let (x, y) = (numbers(n, 0.618_033_988_7), numbers(n, 0.414_213_562_3));
        let (mut ax, mut ay) = (vec![0.0; n], vec![0.0; n]);
        for step in 0..6 {
            let control = control(step);
            route.apply(&control, &x, &mut ax);
            route.apply_transpose(&control, &y, &mut ay);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (one, other) = (dot(&y, &ax), dot(&x, &ay));
            assert!((one / other - 1.0).abs() < 1e-12, "{one} {other}");
            for place in [0, 3, 509, 511, 512, 514, 1023, 1025, PLACES - 2, PLACES - 1] {
                for speed in [0, 4, 12, 13] {
                    let state = speed * PLACES + place;
                    if state >= n {
                        continue;
                    }
                    let sum: f64 = route.incoming(&control, state).map(|(j, p)| p * x[j]).sum();
                    assert!((ax[state] - sum).abs() <= 1e-12 * sum, "{state}");
                }
            }
        }
    }
}

/// With one likelihood for each place, and with one for each state.
#[test]
fn a_step_by_blocks_is_a_step() {
    for route in routes() {
        let (n, groups) = (route.states(), route.place_groups());
        let prior = || Prior::AtFirstObservation(route.anywhere());
        let of_groups = LikelihoodVector::linear(groups.count()).owned();
        let by_groups = GroupedLikelihood::new(of_groups, groups.clone()).unwrap();
        let by_groups = Hmm::new(prior(), &route, by_groups).unwrap();
        let by_states = Hmm::new(prior(), &route, LikelihoodVector::linear(n).owned()).unwrap();
        let (mut blocks, mut states) = (by_groups.filter(), by_states.filter());
        for step in 0..40 {
            let mut seen = numbers(groups.count(), 0.1 + 0.618_033_988_7 * step as f64);
            // Some states are ruled out, and some are nearly so.
            seen.iter_mut().skip(step % 11).step_by(11).for_each(|b| *b = 0.0);
            if step % 7 == 6 {
                seen.iter_mut().step_by(2).for_each(|b| *b *= 1e-300);
            }
            let expanded: Vec<f64> = groups.as_slice().iter().map(|group| seen[*group]).collect();
            let control = control(step);
            let one = blocks.step_with(&control, &seen).unwrap();
            let other = states.step_with(&control, &expanded).unwrap();
            assert!((one - other).abs() < 1e-11 * other.abs().max(1.0), "{step}: {one} {other}");
            let pairs = blocks.belief().to_owned().into_vec().into_iter();
            for (a, b) in pairs.zip(states.belief().as_slice()) {
                assert!((a - b).abs() <= 1e-11 * b + 1e-305, "{step}: {a} {b}");
            }
        }
        let before = blocks.snapshot();
        let nothing = blocks.step_with(&control(1), &vec![0.0; groups.count()]).unwrap_err();
        assert!(matches!(nothing, HmmError::Impossible { step: 41 }), "{nothing}");
        let mut wrong = vec![1.0; groups.count()];
        wrong[700] = f64::NAN;
        assert!(blocks.step_with(&control(1), &wrong).is_err());
        assert!(blocks.step_with(&control(1), &wrong[1..].to_vec()).is_err());
        assert_eq!(blocks.snapshot(), before);
    }
}
