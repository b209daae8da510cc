//! For every grid of speeds, the columns of a route are distributions.

use proptest::prelude::*;
use wayfix::{Hmm, HmmError, LikelihoodVector, Prior, Transition, TransitionEntries};
use wayfix_recognition::motion::{OffMap, RouteControl, RouteTransition, Speeds};

use super::definition::grid;
use crate::kit::cases;

/// Sums of all columns, by the transposed product.
fn column_sums(route: &RouteTransition) -> Vec<f64> {
    let mut sums = vec![f64::NAN; route.states()];
    route.apply_transpose(&RouteControl::default(), &vec![1.0; route.states()], &mut sums);
    sums
}

fn check(route: &RouteTransition) -> Result<(), TestCaseError> {
    let (n, none) = (route.states(), RouteControl::default());
    let sums = column_sums(route);
    prop_assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-12), "{sums:?}");
    let mut out = vec![f64::NAN; n];
    for state in (0..n).step_by(n.div_ceil(16)) {
        let mut x = vec![0.0; n];
        x[state] = 1.0;
        route.apply(&none, &x, &mut out);
        let sum: f64 = out.iter().sum();
        prop_assert!((sum - 1.0).abs() < 1e-12, "product out of {state}: {sum}");
        let sum: f64 = route.outgoing(&none, state).map(|entry| entry.1).sum();
        prop_assert!((sum - 1.0).abs() < 1e-12, "entries out of {state}: {sum}");
        for (to, p) in route.outgoing(&none, state) {
            prop_assert!((out[to] - p).abs() < 1e-13, "{state} to {to}: {p}, product {}", out[to]);
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn columns_are_distributions(
        grid in grid(7),
        (places, closed) in (prop_oneof![1..9_usize, 9..300_usize], any::<bool>()),
        (nearby, anywhere) in (0.0..0.5, 0.0..0.5),
        slack in prop_oneof![Just(0.0), 0.0..=0.5],
        off_map in proptest::option::of((0.01..=1.0, 0.01..=1.0, 0.0..=1.0, 0..9_usize)),
    ) {
        let speeds = Speeds::new(&grid).unwrap().with_changes(nearby, anywhere).unwrap();
        let route = if closed { RouteTransition::closed } else { RouteTransition::open };
        let route = route(places, speeds.with_slack(slack).unwrap()).unwrap();
        check(&route)?;
        if let Some((leave, back, near, within)) = off_map {
            check(&route.with_off_map(OffMap { leave, back, near, within }).unwrap())?;
        }
    }
}

/// A speed below all of the speeds that stand for its cell.
#[test]
fn a_speed_beside_a_near_one_and_a_far_one_loses_nothing() -> Result<(), HmmError> {
    let speeds = Speeds::new(&[0.95, 0.99, 2.0]).unwrap();
    let route = RouteTransition::closed(20, speeds).unwrap();
    let sums = column_sums(&route);
    assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-15 * 16.0), "{sums:?}");
    let prior = Prior::BeforeFirstTransition(route.anywhere());
    let hmm = Hmm::new(prior, route, LikelihoodVector::linear(60)).unwrap();
    let mut filter = hmm.filter();
    for _ in 0..100 {
        filter.predict_with(&RouteControl::default())?;
    }
    Ok(())
}
