//! Peak of memory beyond the inputs.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::Order;
use wayfix::observation::Confusion;
use wayfix::{Belief, Hmm, Prior, SparseTransition, canberra};

use crate::{allocations, peak};

#[test]
fn memory_is_what_the_docs_say() {
    let n = canberra::PLACES;
    let block = |steps: usize| 8 * n * (steps + 1);
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let long = 100_000;
    let drive = hmm.simulate(long, &mut ChaCha8Rng::seed_from_u64(1));
    let ys = drive.observations();

    // A few vectors of n numbers, and a constant.
    let small = 16 * 8 * n + 4096;
    let steps = 20_000;
    // One more number for each step: log-likelihoods or normalisers.
    let found = peak(|| hmm.smooth(&ys[..steps]).unwrap());
    assert!((block(steps)..block(steps) + 8 * steps + small).contains(&found), "smooth: {found}");
    let found = peak(|| hmm.forward(&ys[..steps]).unwrap());
    assert!((block(steps)..block(steps) + 16 * steps + small).contains(&found), "forward: {found}");
    let found = peak(|| hmm.path_sampler(&ys[..steps]).unwrap());
    assert!((block(steps)..block(steps) + 8 * steps + small).contains(&found), "sampler: {found}");
    let found = peak(|| hmm.log_likelihood(ys).unwrap());
    assert!(found < small, "score: {found}");
    let found = peak(|| hmm.path_entropy(&ys[..steps]).unwrap());
    assert!(found < small, "entropy: {found}");

    // n × L numbers twice: filtered and smoothed.
    for lag in [10, 100, 1000] {
        let found = peak(|| {
            let mut smoother = hmm.fixed_lag(lag);
            for y in &ys[..2 * lag] {
                smoother.step(y).unwrap();
            }
            smoother
        });
        assert!(found < 2 * block(lag) + 160 * lag + small, "lag {lag}: {found}");
    }

    // n √T, a few times: less than a fiftieth of the block of 84 MB.
    for order in [Order::Backward, Order::Forward] {
        let mut visited = 0;
        let found = peak(|| hmm.smooth_each(ys, order, |_| visited += 1).unwrap());
        assert_eq!(visited, long + 1);
        assert!(found < 2_000_000, "{order:?}: {found}");
        assert!(found < 7 * block(317), "{order:?}: {found}");
    }
    let counts = peak(|| hmm.expected_moves(&ys[..steps]).unwrap());
    assert!(counts < 7 * block(142) + 64 * 420, "expected moves: {counts}");
}

fn alike_neighbours(n: usize) -> Confusion {
    let places = 0..n;
    let entries =
        places.flat_map(|i| [(i, i, 0.75), (i, (i + 1) % n, 0.125), (i, (i + n - 1) % n, 0.125)]);
    Confusion::from_entries(n, entries).unwrap()
}

#[test]
fn a_confusion_takes_what_its_entries_do() {
    let n = 100_000;
    let mut confusion = None;
    let found = allocation_counter::measure(|| confusion = Some(alike_neighbours(n)));
    let places = i64::try_from(n).unwrap();
    assert!(found.bytes_current <= 24 * 3 * places + 24 * places, "{}", found.bytes_current);
    assert!(found.bytes_max <= 64 * 3 * n as u64, "{}", found.bytes_max);
    drop(confusion);

    let n = 1000;
    let stay = SparseTransition::from_triplets(n, (0..n).map(|i| (i, i, 1.0))).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, stay, alike_neighbours(n)).unwrap();
    let mut filter = hmm.filter();
    filter.step(&7).unwrap();
    assert_eq!(allocations(|| drop(filter.step(&8))), 0);
}

/// Runs work in a pool of one thread, if there are pools, since each thread has its own counters.
fn in_a_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "rayon")]
    return rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work);
    #[cfg(not(feature = "rayon"))]
    work()
}

#[test]
fn many_sequences_take_a_few_vectors_for_each_chunk() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let drive = hmm.simulate(50, &mut ChaCha8Rng::seed_from_u64(2)).observations().to_vec();
    let count = 6400;
    let drives = vec![&drive; count];
    let found = in_a_pool(|| {
        allocations(|| assert!(hmm.log_likelihood_all(&drives).iter().all(Result::is_ok)))
    });
    assert!(found < count, "{found} allocations for {count} sequences");
}
