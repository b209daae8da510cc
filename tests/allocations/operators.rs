//! Products of structured operators allocate nothing after the first.

use wayfix::likelihood::{GroupedLikelihood, Groups, PooledLikelihood, SparseObservation};
use wayfix::map::{NetworkBuilder, PlanePosition, RoadCells, RoadClass};
use wayfix::motion::{
    CellTransition, DistanceTransition, OdometryReading, OffMapTransition, TurnWeights,
    WheelTransition, Wheels,
};
use wayfix::transition::{
    DwellTransition, EvidenceTransition, GeneratorTransition, KroneckerTransition, LearnTransition,
    LogitTransition, PowerTransition, RestartTransition, WindowTransition,
};
use wayfix::{
    Belief, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, Prior, SparseLikelihood,
    SparseTransition, TableLikelihood, TransitionEntries,
};

use crate::allocations;

fn check(name: &str, a: &impl TransitionEntries<Control = ()>) {
    check_with(name, a, &());
}

pub(crate) fn check_with<A: TransitionEntries>(name: &str, a: &A, control: &A::Control) {
    let n = a.states();
    let (x, mut out, mut from) = (vec![1.0 / n as f64; n], vec![0.0; n], vec![0; n]);
    let mut products = || {
        a.apply(control, &x, &mut out);
        a.apply_transpose(control, &x, &mut out);
        a.apply_log(control, &x, &mut out);
        a.apply_transpose_log(control, &x, &mut out);
        a.max_product(control, &x, &mut out, &mut from);
    };
    products();
    let found = allocations(|| (0..3).for_each(|_| products()));
    assert_eq!(found, 0, "{name}");
}

#[test]
fn products_allocate_nothing_after_the_first() {
    let route = || WindowTransition::new(20, -1, &[0.25, 0.25, 0.5], false).unwrap();
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
    let by_inputs = LogitTransition::new(&route(), 2).unwrap();
    let by_inputs = by_inputs.with_slopes(3, 4, &[1.0, -300.0]).unwrap();
    check_with("by inputs", &by_inputs, &vec![0.5, -1.0]);
    check_wheels();
    check_generator();
    let off = OffMapTransition::new(measured.clone(), 0.1, 0.1, Belief::uniform(20).unwrap());
    check_with("evidence off the map", &off.unwrap(), &60.0);
    check("power", &PowerTransition::new(lost(), 3));
    check("dwell", &dwell());
    let pairs = || KroneckerTransition::new(dwell(), gears()).unwrap();
    check("kronecker", &pairs());
    let power = PowerTransition::new(pairs(), 2);
    check("nested", &KroneckerTransition::new(gears(), power).unwrap());

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

    // An operator whose moves depend on inputs, within and below the range of doubles.
    let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
    let hmm = Hmm::new(prior, by_inputs, LikelihoodVector::linear(20)).unwrap();
    let mut filter = hmm.filter();
    let inputs = [vec![0.5, -1.0], vec![0.0, 4.0]];
    inputs.iter().for_each(|u| _ = filter.step_with(u, &[0.5; 20]).unwrap());
    let found = allocations(|| {
        for k in 0..100 {
            filter.step_with(&inputs[k % 2], &[0.5; 20]).unwrap();
            filter.predict_with(&inputs[0]).unwrap();
        }
    });
    assert_eq!(found, 0, "by inputs");

    // A sensor of images, as numbers and as logarithms.
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

/// With a short series, a long one, and a matrix; with a filter, and with the statistics of a step.
fn check_generator() {
    let line = |n: usize| (1..n).flat_map(|i| [(i, i - 1, 1.0), (i - 1, i, 0.5)]);
    let few = GeneratorTransition::from_triplets(20, line(20)).unwrap();
    let many = GeneratorTransition::from_triplets(600, line(600)).unwrap();
    for time in [0.0, 0.3, 40.0, 1e6] {
        check_with("generator", &few, &time);
        let (b, mut after, mut sums) = (vec![0.05; 20], vec![0.0; 20], few.statistics());
        after[0] = 20.0;
        few.add_step(&mut sums, &time, &b, &after, 1.0);
        let found = allocations(|| _ = few.add_step(&mut sums, &time, &b, &after, 1.0));
        assert_eq!(found, 0, "statistics of a step of {time}");
    }
    check_with("generator", &many, &2.0);
    let prior = Prior::AtFirstObservation(Belief::uniform(20).unwrap());
    let hmm = Hmm::new(prior, few, LikelihoodVector::linear(20)).unwrap();
    let mut filter = hmm.filter();
    let times = [0.1, 3.0, 500.0, 1e5];
    times.iter().for_each(|time| _ = filter.step_with(time, &[0.5; 20]).unwrap());
    let found = allocations(|| {
        for k in 0..100 {
            filter.step_with(&times[k % 4], &[0.5; 20]).unwrap();
        }
    });
    assert_eq!(found, 0, "generator");
}

/// A filter's step within a cell, and one in which scales change.
fn check_wheels() {
    let mut builder = NetworkBuilder::new();
    builder.node(1, PlanePosition { x: 0.0, y: 0.0 }).unwrap();
    builder.node(2, PlanePosition { x: 30.0, y: 0.0 }).unwrap();
    builder.both_ways(1, 2, RoadClass::Street).unwrap();
    let cells = RoadCells::new(builder.build().unwrap(), 1.0).unwrap();
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let motion = WheelTransition::new(motion, Wheels::default()).unwrap();
    let mut odometer = motion.odometer();
    let controls = [0.1, 1.3, 2.0].map(|metres| odometer.add(metres, 1e-3).unwrap());
    let start = motion.spread(&Belief::uniform(cells.states()).unwrap()).unwrap();
    let sensor = LikelihoodVector::linear(cells.states());
    let sensor = GroupedLikelihood::new(sensor, motion.cell_groups()).unwrap();
    let hmm = Hmm::new(Prior::AtFirstObservation(start), motion, sensor).unwrap();
    let mut filter = hmm.filter();
    let seen = vec![0.5; cells.states()];
    controls.iter().for_each(|control| _ = filter.step_with(control, &seen).unwrap());
    let found = allocations(|| {
        for k in 0..30 {
            filter.step_with(&controls[k % 3], &seen).unwrap();
        }
    });
    assert_eq!(found, 0, "wheels");
}
