//! After some steps a pruned filter allocates nothing.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::Pruning;
use wayfix::likelihood::SparseObservation;
use wayfix::{
    Belief, FusedLikelihood, Hmm, OptionalLikelihood, Prior, SparseLikelihood, SparseTransition,
    canberra,
};

use crate::allocations;

#[test]
fn a_pruned_step_allocates_nothing_after_the_first_ones() {
    let map = canberra::hmm(5, 1.0).unwrap();
    let drive = map.simulate(1000, &mut ChaCha8Rng::seed_from_u64(1));
    let mut filter = map.pruned_filter(Pruning::default());
    let run = |filter: &mut wayfix::PrunedFilter<_>| {
        for y in drive.observations() {
            filter.step(y).unwrap();
        }
        filter.predict().unwrap();
        for y in &drive.observations()[..10] {
            let _ = filter.update(y);
        }
        filter.restart();
    };
    run(&mut filter);
    run(&mut filter);
    let snapshot = filter.snapshot();
    assert_eq!(allocations(|| filter.restore(&snapshot).unwrap()), 0, "restore");
    assert_eq!(allocations(|| run(&mut filter)), 0, "on the map");

    let n = 5000;
    let moves = (0..n).flat_map(|j| [(j, j, 0.25), ((j + 1) % n, j, 0.75)]);
    let motion = SparseTransition::from_triplets(n, moves).unwrap();
    let camera = OptionalLikelihood::new(SparseLikelihood::new(n));
    let sensor = FusedLikelihood::new(camera.clone(), camera).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, motion, sensor).unwrap();
    let seen = |k: usize| {
        let list = vec![(k % n, 0.5), ((k * 97) % n, 0.3), ((k * 31) % n, 0.2)];
        let list = if k == 0 { vec![(0, 1.0)] } else { list };
        (k % 7 != 3).then(|| SparseObservation::new(list, 1e-7).unwrap())
    };
    let ys: Vec<_> =
        (0..300).map(|k| (seen(k), (k == 200).then(|| SparseObservation::known(200)))).collect();
    let pruning = Pruning::default().with_most_active(40);
    let mut filter = hmm.pruned_filter(pruning);
    let impossible = (None, Some(SparseObservation::known(4000)));
    let mut run = || {
        for y in &ys {
            filter.step(y).unwrap();
        }
        // An impossible observation allocates nothing, either.
        assert!(filter.step(&impossible).is_err());
        filter.restart();
    };
    // Twice, since two beliefs are swapped at each step.
    run();
    run();
    assert_eq!(allocations(&mut run), 0, "composed sensors");
}
