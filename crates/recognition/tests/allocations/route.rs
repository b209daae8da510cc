//! Motion along a route allocates nothing after the first step.

use wayfix::likelihood::GroupedLikelihood;
use wayfix::{Hmm, LikelihoodVector, Prior};
use wayfix_recognition::motion::{
    OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates,
    ViewEvidence,
};

use crate::allocations;

fn routes() -> Vec<RouteTransition> {
    let mut routes = Vec::new();
    for make in [RouteTransition::open, RouteTransition::closed] {
        let route = make(20, Speeds::default()).unwrap();
        let model = OdometryModel { scale: 1.1, bias: 0.1, deviation: 0.4 };
        let route = route.with_odometry(model).unwrap();
        let views = route.clone().with_views(ViewChangeRates::default()).unwrap();
        let off_map = views.clone().with_off_map(OffMap::default()).unwrap();
        routes.extend([route, views, off_map]);
    }
    routes
}

fn controls() -> Vec<RouteControl> {
    let views =
        [ViewChange::Changed, ViewChange::Unchanged].map(|view| ViewEvidence { view, weight: 0.3 });
    let views = || std::iter::once(None).chain(views.map(Some));
    let readings = [None, Some(0.7), Some(-9.0)].into_iter();
    readings
        .flat_map(|odometry| views().map(move |view| RouteControl { odometry, view, before: None }))
        .collect()
}

#[test]
fn products_allocate_nothing_after_the_first() {
    for route in routes() {
        for control in controls() {
            check_with("route", &route, &control);
        }
    }
}

#[test]
fn a_filter_step_allocates_nothing() {
    for route in routes() {
        let (prior, groups) = (Prior::AtFirstObservation(route.anywhere()), route.place_groups());
        let places = groups.count();
        let camera = LikelihoodVector::linear(places).owned();
        let camera = GroupedLikelihood::new(camera, groups).unwrap();
        let hmm = Hmm::new(prior, route, camera).unwrap();
        let mut filter = hmm.filter();
        let seen: Vec<f64> = (0..places).map(|i| 0.5 + (i * 7 % 5) as f64).collect();
        let controls = controls();
        filter.step_with(&controls[0], &seen).unwrap();
        filter.step_with(&controls[8], &seen).unwrap();
        let found = allocations(|| {
            for control in controls.iter().cycle().take(100) {
                filter.step_with(control, &seen).unwrap();
            }
        });
        assert_eq!(found, 0);
    }
}

fn check_with<A: wayfix::TransitionEntries>(name: &str, a: &A, control: &A::Control) {
    let mut products = wayfix_test_kit::all_products(a, control);
    products();
    assert_eq!(allocations(|| (0..3).for_each(|_| products())), 0, "{name}");
}
