//! Products of structured operators allocate nothing after the first.

use wayfix::inference::Distractor;
use wayfix::likelihood::{GroupedLikelihood, Groups, PooledLikelihood, SparseObservation};
use wayfix::motion::{DistanceTransition, OdometryReading, OffMapTransition};
use wayfix::transition::{
    DistractedTransition, Distraction, DistractionRates, DwellTransition, EvidenceTransition,
    KroneckerTransition, RestartTransition, WindowTransition,
};
use wayfix::{
    Belief, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, Prior, SparseLikelihood,
    SparseTransition, TableLikelihood, TransitionEntries,
};

use crate::allocations;

fn check(name: &str, a: &impl TransitionEntries<Control = ()>) {
    check_with(name, a, &());
}

fn check_with<A: TransitionEntries>(name: &str, a: &A, control: &A::Control) {
    let mut products = wayfix_test_kit::all_products(a, control);
    products();
    assert_eq!(allocations(|| (0..3).for_each(|_| products())), 0, "{name}");
}

#[test]
fn products_allocate_nothing_after_the_first() {
    let route = || WindowTransition::open(20, -1, &[0.25, 0.25, 0.5]).unwrap();
    let gears = || SparseTransition::from_rows(&[[0.5, 0.25], [0.5, 0.75]]).unwrap();
    let lost = || RestartTransition::new(route(), 0.125, Belief::uniform(20).unwrap()).unwrap();
    let times = vec![vec![0.25, 0.25, 0.5]; 20];
    let dwell = || DwellTransition::new(lost(), &times).unwrap();
    check("window", &route());
    check("restart", &lost());
    let leaving = OffMapTransition::new(lost(), 0.125, 0.25, Belief::uniform(20).unwrap());
    check("off the map", &leaving.unwrap());
    let metres = |to: usize, from: usize| 50.0 * (from.abs_diff(to) as f64);
    let stored = SparseTransition::from_operator(&route()).unwrap();
    let on_map = DistanceTransition::new(stored, metres).unwrap();
    check_with("by distance", &on_map, &Some(OdometryReading { distance: 60.0, variance: 100.0 }));
    let near = |metres: &f64, to: usize, from: usize| {
        -0.5 * ((metres - 50.0 * (from.abs_diff(to) as f64)) / 10.0).powi(2)
    };
    let measured = EvidenceTransition::new(route(), near).unwrap();
    check_with("evidence", &measured, &60.0);
    let off = OffMapTransition::new(measured.clone(), 0.1, 0.1, Belief::uniform(20).unwrap());
    check_with("evidence off the map", &off.unwrap(), &60.0);
    check("dwell", &dwell());
    let pairs = || KroneckerTransition::new(dwell(), gears()).unwrap();
    check("kronecker", &pairs());
    check("nested", &KroneckerTransition::new(gears(), pairs()).unwrap());

    let rates = DistractionRates { begin: 0.125, end: 0.25 };
    let distracted = || DistractedTransition::new(pairs(), rates).unwrap();
    let image = Distraction { control: (), begins: 0.25, continues: 0.75 };
    check_with("distracted", &distracted(), &image);

    // A filter on them, with a sensor of places.
    let rows = (0..20).map(|i| [0.25 + f64::from(i) / 40.0, 0.75 - f64::from(i) / 40.0]);
    let camera = TableLikelihood::from_rows(&rows.collect::<Vec<_>>()).unwrap();
    let places = dwell().groups().clone();
    let sensor = GroupedLikelihood::new(camera, places).unwrap();
    let sensor =
        FusedLikelihood::new(sensor, OptionalLikelihood::new(SparseLikelihood::new(60))).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(60).unwrap());
    let hmm = Hmm::new(prior, dwell(), sensor).unwrap();
    let mut filter = hmm.filter();
    filter.step(&(1, None)).unwrap();
    let known = (0, Some(SparseObservation::known(filter.belief().mode())));
    filter.step(&known).unwrap();
    let found = allocations(|| {
        for k in 0..100 {
            filter.step(&(k % 2, None)).unwrap();
        }
    });
    let known = (0, Some(SparseObservation::known(filter.belief().mode())));
    let found = found + allocations(|| _ = filter.step(&known).unwrap());
    assert_eq!(found, 0, "filter");

    // An operator with evidence on moves, within and far beyond doubles.
    let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
    let hmm = Hmm::new(prior, measured, LikelihoodVector::linear(20)).unwrap();
    let mut filter = hmm.filter();
    filter.step_with(&50.0, &[0.5; 20]).unwrap();
    let found = allocations(|| {
        for k in 0..100 {
            filter.step_with(&[45.0, 700.0, 2.0][k % 3], &[0.5; 20]).unwrap();
            filter.predict_with(&30.0).unwrap();
        }
        assert!(filter.log_likelihood() < -1e4);
    });
    assert_eq!(found, 0, "evidence");

    // An of images, as numbers and as logarithms.
    let images = Groups::new((0..40).map(|image| image % 20).collect()).unwrap();
    for sensor in [LikelihoodVector::linear(40), LikelihoodVector::log(40)] {
        let sensor = PooledLikelihood::new(sensor, images.clone()).unwrap();
        let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
        let hmm = Hmm::new(prior, lost(), sensor).unwrap();
        let mut filter = hmm.filter();
        let seen = [[0.5; 40], [1e-310; 40]];
        for y in &seen {
            filter.step(y).unwrap();
        }
        let found = allocations(|| {
            for k in 0..100 {
                filter.step(&seen[k % 2]).unwrap();
            }
        });
        assert_eq!(found, 0, "pooled");
    }
}

#[test]
fn what_a_distracted_sensor_follows_allocates_nothing() {
    let n = 20;
    let route = || WindowTransition::open(n, -1, &[0.25, 0.25, 0.5]).unwrap();
    let rates = DistractionRates { begin: 0.125, end: 0.25 };
    let start = Belief::uniform(n).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2 * n).unwrap());
    let a = DistractedTransition::new(route(), rates).unwrap();
    let hmm = Hmm::new(prior, a, LikelihoodVector::linear(2 * n)).unwrap();
    let mut filter = hmm.filter();
    let mut distractor = Distractor::new(route(), start, rates).unwrap();
    let mut seen = vec![1.0; 2 * n];
    seen[3] = 4.0;
    let (places, mut distracted) = (seen[..n].to_vec(), 0.5);
    let found = allocations(|| _ = distractor.first(&places).unwrap());
    assert_eq!(found, 0, "first");
    filter.step_with(&Distraction::none(()), &seen[..]).unwrap();
    let mut step = || {
        let (begins, continues) = distractor.observe(&(), &places, distracted).unwrap();
        let control = Distraction { control: (), begins, continues };
        filter.step_with(&control, &seen[..]).unwrap();
        distractor.accept();
        distractor.predict(&(), distracted).unwrap();
        distracted = hmm.transition().mode_masses(filter.belief().as_slice())[1];
    };
    step();
    assert_eq!(allocations(|| (0..100).for_each(|_| step())), 0);
}
