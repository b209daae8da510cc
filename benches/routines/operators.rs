//! A product and a max-product with each structured operator.

use std::hint::black_box;

use criterion::Criterion;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::motion::{DistanceTransition, OdometryReading, OffMapTransition};
use wayfix::transition::{
    DwellTransition, KroneckerTransition, RestartTransition, WindowTransition,
};
use wayfix::{Belief, DenseTransition, SparseTransition, TransitionEntries};
use wayfix_recognition::motion::{
    OffMap, RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates, ViewEvidence,
};

use crate::timed::Group;

/// Benches of all operators, with 1,050 places.
pub(crate) fn all(criterion: &mut Criterion) {
    let n = 1050;
    let window = WindowTransition::closed(n, 0, &[0.1, 0.6, 0.2, 0.1]).expect("a window");
    let uniform = |n| Belief::uniform(n).expect("there are states");
    let turns = DenseTransition::from_fn(4, |i, j| if i == j { 0.7 } else { 0.1 }).expect("turns");
    let times = vec![[0.1, 0.4, 0.3, 0.2]; n];
    operator(criterion, "window of 4", &window);
    let sparse = SparseTransition::from_operator(&window).expect("a window");
    operator(criterion, "the same window, sparse", &sparse);
    let restart = RestartTransition::new(sparse.clone(), 0.01, uniform(n)).expect("one size");
    operator(criterion, "restart", &restart);
    let metres = |to: usize, from: usize| 100.0 * ((to + n - from) % n) as f64;
    let distance = DistanceTransition::new(sparse.clone(), metres).expect("lengths");
    let driven = OdometryReading { distance: 120.0, variance: 400.0 };
    operator_with(criterion, "by distance", &distance, &Some(driven));
    let off_map = OffMapTransition::new(sparse, 0.01, 0.1, uniform(n)).expect("one size");
    operator(criterion, "off the map", &off_map);
    let kronecker = KroneckerTransition::new(window.clone(), turns).expect("few states");
    operator(criterion, "kronecker with 4 headings", &kronecker);
    let dwell = DwellTransition::new(window, &times).expect("distributions");
    operator(criterion, "dwell of 4 steps", &dwell);
    route(criterion, n);
}

/// The usual speeds.
fn route(criterion: &mut Criterion, n: usize) {
    let route = RouteTransition::open(n, Speeds::default()).expect("few states");
    let route = route.with_views(ViewChangeRates::default()).expect("valid rates");
    let odometry = Some(0.8);
    let view = Some(ViewEvidence { view: ViewChange::Changed, weight: 0.5 });
    for (name, odometry, view) in [
        ("route at 15 speeds", None, None),
        ("route, odometry", odometry, None),
        ("route, views", None, view),
        ("route, odometry and views", odometry, view),
    ] {
        operator_with(criterion, name, &route, &RouteControl { odometry, view, before: None });
    }
    let off_map = route.with_off_map(OffMap::default()).expect("valid rates");
    let control = RouteControl { odometry, view, before: None };
    operator_with(criterion, "route, odometry, views and off the map", &off_map, &control);
}

fn operator<A: TransitionEntries<Control = ()>>(criterion: &mut Criterion, name: &str, a: &A) {
    operator_with(criterion, name, a, &());
}

fn operator_with<A: TransitionEntries>(
    criterion: &mut Criterion,
    name: &str,
    a: &A,
    control: &A::Control,
) {
    let n = a.states();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let x: Vec<f64> = (0..n).map(|_| Exp1.sample(&mut rng)).collect();
    let scores: Vec<f64> = x.iter().map(|x| -10.0 * x).collect();
    let mut group = Group::new(criterion, format!("operator {name}"));
    group.single("product", 1, || {
        let (x, mut out) = (&x, vec![0.0; n]);
        move || a.apply(control, black_box(x), black_box(&mut out))
    });
    if name != "power of 3" {
        group.single("max product", 1, || {
            let (scores, mut out, mut from) = (&scores, vec![0.0; n], vec![0; n]);
            move || {
                let (out, from) = (black_box(&mut out), black_box(&mut from));
                a.max_product(control, black_box(scores), out, from);
            }
        });
    }
}
