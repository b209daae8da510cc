//! Many sequences through one model.
//!
//! Times are for all sequences; divide by the elements, which are steps.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::{
    Belief, DenseTransition, Hmm, Learning, LikelihoodVector, Prior, TableLikelihood, canberra,
};

const SEQUENCES: usize = 2000;
const STEPS: usize = 50;

fn routine<R>(
    criterion: &mut Criterion,
    (group, name): (&str, &str),
    steps: usize,
    mut work: impl FnMut() -> R,
) {
    let mut group = criterion.benchmark_group(group);
    group.throughput(Throughput::Elements(steps as u64));
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| black_box(work()));
    });
    group.finish();
}

fn weights(count: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut weight = || -> f64 { Exp1.sample(rng) };
    let weights = (0..count).map(|_| 0.05 + weight()).collect();
    Belief::from_weights(weights).expect("weights are positive").into_vec()
}

fn dense(n: usize, rng: &mut ChaCha8Rng) -> DenseTransition {
    let columns: Vec<_> = (0..n).map(|_| weights(n, rng)).collect();
    DenseTransition::from_fn(n, |to, from| columns[from][to]).expect("a matrix")
}

/// 2,000 sequences on the road map.
fn road_map(criterion: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let table = canberra::hmm(5, 1.0).expect("a model");
    let n = canberra::PLACES;
    let drives: Vec<Vec<usize>> =
        (0..SEQUENCES).map(|_| table.simulate(STEPS, &mut rng).observations().to_vec()).collect();
    let likelihoods: Vec<Vec<f64>> = (0..SEQUENCES * STEPS).map(|_| weights(n, &mut rng)).collect();
    let given: Vec<&[Vec<f64>]> = likelihoods.chunks(STEPS).collect();
    let uniform = || Prior::BeforeFirstTransition(Belief::uniform(n).expect("there are states"));
    let (_, matrix, sensor) = table.into_parts();
    let table = Hmm::new(uniform(), matrix.clone(), sensor).expect("one size");
    let elsewhere = Hmm::new(uniform(), matrix, LikelihoodVector::linear(n)).expect("one size");
    let steps = SEQUENCES * STEPS;
    routine(criterion, ("road map", "smooth, table"), steps, || table.smooth_all(&drives));
    routine(criterion, ("road map", "smooth"), steps, || elsewhere.smooth_all(&given));
    routine(criterion, ("road map", "smooth one by one"), steps, || {
        given.iter().map(|ys| elsewhere.smooth(ys)).collect::<Vec<_>>()
    });
    routine(criterion, ("road map", "forward"), steps, || elsewhere.forward_all(&given));
    routine(criterion, ("road map", "score, table"), steps, || table.score_all(&drives));
    routine(criterion, ("road map", "score"), steps, || elsewhere.score_all(&given));
    routine(criterion, ("road map", "viterbi, table"), steps, || table.viterbi_all(&drives));
    routine(criterion, ("road map", "viterbi"), steps, || elsewhere.viterbi_all(&given));
    routine(criterion, ("road map", "viterbi one by one"), steps, || {
        drives.iter().map(|ys| table.viterbi(ys)).collect::<Vec<_>>()
    });

    let full = Hmm::new(uniform(), dense(n, &mut rng), LikelihoodVector::linear(n));
    let (full, some) = (full.expect("one size"), &given[..200]);
    let steps = some.len() * STEPS;
    routine(criterion, ("105 dense", "smooth"), steps, || full.smooth_all(some));
    routine(criterion, ("105 dense", "viterbi"), steps, || full.viterbi_all(some));
}

/// A re-estimation with 10 states and 20 symbols, from 50 sequences of 100 steps: that
/// of ten, with the E-step that comes first, for 11.
fn learning(criterion: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut model = || {
        let rows: Vec<_> = (0..10).map(|_| weights(20, &mut rng)).collect();
        let table = TableLikelihood::from_rows(&rows).expect("a table");
        let prior = Prior::AtFirstObservation(Belief::uniform(10).expect("there are states"));
        Hmm::new(prior, dense(10, &mut rng), table).expect("one size")
    };
    let (truth, start) = (model(), model());
    let seen: Vec<Vec<usize>> = (0..50)
        .map(|k| truth.simulate(100, &mut ChaCha8Rng::seed_from_u64(k)).observations().to_vec())
        .collect();
    let learning = Learning { iterations: 10, tolerance: 0.0, ..Learning::default() };
    routine(criterion, ("learn", "10 dense"), 11 * 50 * 100, || start.learn(&seen, &learning));
    routine(criterion, ("10 dense", "smooth"), 50 * 100, || start.smooth_all(&seen));
    routine(criterion, ("10 dense", "score"), 50 * 100, || start.score_all(&seen));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    targets = road_map, learning
}
criterion_main!(benches);
