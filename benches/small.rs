//! Models of a few states over a long sequence: what the general routines
//! would cost there in overhead, fixed sizes spare.
//!
//! Times are per sequence of 100,000 steps; divide by the elements.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior, TableLikelihood};

const STEPS: usize = 100_000;
const SYMBOLS: usize = 6;

fn routine<R>(criterion: &mut Criterion, group: &str, name: &str, mut work: impl FnMut() -> R) {
    let mut group = criterion.benchmark_group(group);
    group.throughput(Throughput::Elements(STEPS as u64));
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| black_box(work()));
    });
    group.finish();
}

/// A dense model with a table, and one with likelihoods from elsewhere.
fn small(criterion: &mut Criterion) {
    for n in [2, 3, 4, 8] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut weights = |count: usize| -> Vec<f64> {
            let mut weight = || -> f64 { Exp1.sample(&mut rng) };
            let weights = (0..count).map(|_| 0.05 + weight()).collect();
            Belief::from_weights(weights).expect("weights are positive").into_vec()
        };
        let columns: Vec<_> = (0..n).map(|_| weights(n)).collect();
        let table: Vec<_> = (0..n).map(|_| weights(SYMBOLS)).collect();
        let matrix = DenseTransition::from_fn(n, |to, from| columns[from][to]).expect("a matrix");
        let table = TableLikelihood::from_rows(&table).expect("a table");
        let prior = Prior::AtFirstObservation(Belief::uniform(n).expect("there are states"));
        let hmm = Hmm::new(prior, matrix, table).expect("one size");
        let ys = hmm.simulate(STEPS, &mut ChaCha8Rng::seed_from_u64(2)).observations().to_vec();
        let name = n.to_string();
        routine(criterion, "score", &name, || hmm.score(&ys));
        routine(criterion, "forward", &name, || hmm.forward(&ys));
        routine(criterion, "smooth", &name, || hmm.smooth(&ys));
        routine(criterion, "viterbi", &name, || hmm.viterbi(&ys));

        let likelihoods: Vec<Vec<f64>> = (0..STEPS).map(|_| weights(n)).collect();
        let (prior, matrix, _) = hmm.into_parts();
        let sensor = LikelihoodVector::linear(n).owned();
        let hmm = Hmm::new(prior, matrix, sensor).expect("one size");
        routine(criterion, "score, from elsewhere", &name, || hmm.score(&likelihoods));
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    targets = small
}
criterion_main!(benches);
