//! After it is made, a filter allocates nothing.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::likelihood::{LogLikelihoodFn, SparseTableLikelihood};
use wayfix::{Filter, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, canberra};

use crate::allocations;

#[test]
fn a_step_allocates_nothing() {
    let plain = canberra::hmm(5, 1.0).unwrap();
    let ys: Vec<usize> = (0..200).map(|k| [4, 5, 6, 80][k % 4]).collect();
    let mut filter = plain.filter();
    let found = allocations(|| {
        for y in &ys {
            // An impossible observation allocates nothing, either.
            if filter.step(y).is_err() {
                filter.predict().unwrap();
            }
            std::hint::black_box(filter.belief().mode());
        }
        filter.update(&5).unwrap();
    });
    assert_eq!(found, 0, "table, from the first step on");

    let mut snapshot = filter.snapshot();
    assert_eq!(allocations(|| filter.restore(&snapshot).unwrap()), 0, "restore");
    assert_eq!(allocations(|| filter.snapshot_to(&mut snapshot)), 0, "snapshot");

    // The other streams, once their window is full or their tree has grown.
    let mut smoother = plain.fixed_lag(20);
    let mut decoder = plain.online_viterbi();
    let drive = plain.simulate(2000, &mut ChaCha8Rng::seed_from_u64(1));
    for y in &drive.observations()[..1000] {
        smoother.step(y).unwrap();
        decoder.step(y).unwrap();
    }
    let found = allocations(|| {
        for y in &drive.observations()[1000..] {
            smoother.step(y).unwrap();
        }
    });
    assert_eq!(found, 0, "fixed lag, once the window is full");
    let elsewhere = plain.prior().belief();
    smoother.relocate(elsewhere).unwrap(); // the first one allocates a list
    drive.observations()[..30].iter().for_each(|y| _ = smoother.step(y));
    let found = allocations(|| {
        smoother.relocate(elsewhere).unwrap();
        for y in &drive.observations()[..100] {
            smoother.step(y).unwrap();
            smoother.update(y).unwrap();
        }
        smoother.relocate(elsewhere).unwrap();
        for y in &drive.observations()[1100..1200] {
            // (The new position may contradict the observations.)
            if smoother.step(y).is_err() {
                smoother.relocate(elsewhere).unwrap();
            }
        }
    });
    assert_eq!(found, 0, "updates and relocations");
    // A level of the tree has two vectors, and levels are reused.
    let mut most = [0, 0];
    let mut other = plain.online_viterbi();
    for (k, y) in drive.observations().iter().enumerate() {
        other.step(y).unwrap();
        most[k / 1000] = most[k / 1000].max(other.undecided().len());
    }
    let found = allocations(|| {
        for y in &drive.observations()[1000..] {
            std::hint::black_box(decoder.step(y).unwrap());
        }
    });
    let grown = 2 * most[1].saturating_sub(most[0]);
    assert!(found <= grown + 4, "online Viterbi: {found}, for a tree of {most:?} levels");

    // Sensors that fill their own memory have it after the first step.
    let n = canberra::PLACES;
    let camera = OptionalLikelihood::new(canberra::sensor(1.0).unwrap());
    let odometer = LogLikelihoodFn::new(n, |&y: &f64, i| -(y - i as f64).powi(2) * 1e-3);
    let given = LikelihoodVector::linear(n).owned();
    let fused = FusedLikelihood::new(camera, FusedLikelihood::new(odometer, given).unwrap());
    let hmm =
        Hmm::new(plain.prior().clone(), canberra::turning().into_transition(), fused.unwrap())
            .unwrap();
    let mut filter = Filter::new(Box::new(hmm));
    let given: Vec<f64> = (0..n).map(|i| 1e-200 * (1.0 + i as f64)).collect();
    let sightings = [(Some(5), (3.0, given.clone())), (None, (90.0, given))];
    filter.step(&sightings[0]).unwrap();
    let found = allocations(|| {
        for k in 0..200 {
            filter.step(&sightings[k % 2]).unwrap();
        }
    });
    assert_eq!(found, 0, "fused sensors, after the first step");

    // A sensor that lists a few states has it after the longest list.
    let lists: Vec<_> = (0..n).map(|i| (vec![(i, 0.9), ((i + 7) % n, 0.1)], 1e-3)).collect();
    let tags = SparseTableLikelihood::from_lists(n, &lists).unwrap();
    let hmm = Hmm::new(plain.prior().clone(), canberra::turning().into_transition(), tags).unwrap();
    let mut filter = hmm.filter();
    filter.step(&4).unwrap();
    let found = allocations(|| {
        for y in 0..200 {
            filter.step(&(y % n)).unwrap();
        }
    });
    assert_eq!(found, 0, "a sparse table, after the first step");

    // A position sensor far off: beliefs that are kept in logarithms.
    let metres = LogLikelihoodFn::new(n, |&y: &f64, i| -(y - i as f64).powi(2) * 10.0);
    let motion = canberra::turning().into_transition();
    let hmm = Hmm::new(plain.prior().clone(), motion, metres).unwrap();
    let mut filter = hmm.filter();
    filter.step(&4.0).unwrap();
    let found = allocations(|| {
        for k in 0..200 {
            filter.step(&f64::from(k % 100)).unwrap();
            filter.predict().unwrap();
        }
    });
    assert_eq!(found, 0, "steps in logarithms");
}
