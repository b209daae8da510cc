//! Filter, smoother and Viterbi on the Canberra map, on a dense model of its
//! size, and on a road graph of your own:
//!
//! ```text
//! cargo bench
//! WAYFIX_GRAPH=path/to/folder cargo bench -- graph
//! ```
//!
//! The folder holds `nodes.csv` (node, longitude, latitude) and `edges.csv`
//! (from, to, class, metres), with nodes numbered from 0 and classes from 0 to
//! 3. Times of smoother and Viterbi are per sequence; divide by the elements,
//! or read elements per second.

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::{
    Belief, DenseTransition, Hmm, Likelihood, LikelihoodVector, Prior, SparseTransition,
    TransitionEntries, canberra,
};

/// One model and a sequence of observations for it.
fn bench<A, B>(criterion: &mut Criterion, name: &str, hmm: &Hmm<A, B>, ys: &[B::Observation])
where
    A: TransitionEntries<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    // What a step cannot do without: one product with A.
    let (x, mut out) = (hmm.prior().belief().as_slice().to_vec(), vec![0.0; hmm.states()]);
    let mut group = criterion.benchmark_group("product");
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| hmm.transition().apply(&(), black_box(&x), black_box(&mut out)));
    });
    group.finish();

    let mut group = criterion.benchmark_group("filter step");
    let mut filter = hmm.filter();
    let mut next = ys.iter().cycle();
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| {
            if let Some(y) = next.next() {
                filter.step(black_box(y)).expect("the observation is possible");
            }
        });
    });
    group.finish();

    let mut group = criterion.benchmark_group("smoother");
    group.throughput(Throughput::Elements(ys.len() as u64));
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| hmm.smooth(black_box(ys)));
    });
    group.finish();

    let mut group = criterion.benchmark_group("viterbi");
    group.throughput(Throughput::Elements(ys.len() as u64));
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| hmm.viterbi(black_box(ys)));
    });
    group.finish();
}

fn map(criterion: &mut Criterion) {
    let hmm = canberra::hmm(5, 1.0).expect("place 5 exists");
    let drive = hmm.simulate(1000, &mut ChaCha8Rng::seed_from_u64(1));
    bench(criterion, "canberra-105", &hmm, drive.observations());
}

/// Columns and likelihoods of independent exponential weights.
fn dense(criterion: &mut Criterion) {
    let n = canberra::PLACES;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut weights = || -> Vec<f64> { (0..n).map(|_| Exp1.sample(&mut rng)).collect() };
    let columns: Vec<Belief> =
        (0..n).map(|_| Belief::from_weights(weights()).expect("weights are positive")).collect();
    let transition = DenseTransition::from_fn(n, |i, j| columns[j].as_slice()[i])
        .expect("columns are distributions");
    let prior = Prior::BeforeFirstTransition(Belief::uniform(n).expect("there are states"));
    let hmm = Hmm::new(prior, transition, LikelihoodVector::linear(n).owned())
        .expect("the parts have one size");
    let ys: Vec<Vec<f64>> = (0..200).map(|_| weights()).collect();
    bench(criterion, "dense-105", &hmm, &ys);
}

fn graph(criterion: &mut Criterion) {
    let Some(folder) = std::env::var_os("WAYFIX_GRAPH") else { return };
    let folder = Path::new(&folder);
    let read = |name: &str| csv::Reader::from_path(folder.join(name)).expect("the file opens");
    let nodes = read("nodes.csv").into_records().count();
    // A random walk: stop with 0.1, else any road alike.
    let mut ways = vec![Vec::new(); nodes];
    for edge in read("edges.csv").into_records() {
        let edge = edge.expect("a record");
        let end = |column: usize| edge[column].parse::<usize>().expect("a node number");
        if end(0) != end(1) && !ways[end(0)].contains(&end(1)) {
            ways[end(0)].push(end(1));
        }
    }
    let entries = ways.iter().enumerate().flat_map(|(from, ways)| {
        let stop = if ways.is_empty() { 1.0 } else { 0.1 };
        let go = (1.0 - stop) / ways.len().max(1) as f64;
        std::iter::once((from, from, stop)).chain(ways.iter().map(move |&to| (to, from, go)))
    });
    let transition = SparseTransition::from_triplets(nodes, entries).expect("a stochastic matrix");
    let name = format!("graph-{nodes} ({} entries)", transition.entries());
    let prior = Prior::BeforeFirstTransition(Belief::uniform(nodes).expect("there are states"));
    let hmm = Hmm::new(prior, transition, LikelihoodVector::linear(nodes).owned())
        .expect("the parts have one size");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut weights = || -> Vec<f64> { (0..nodes).map(|_| Exp1.sample(&mut rng)).collect() };
    let ys: Vec<Vec<f64>> = (0..50).map(|_| weights()).collect();
    bench(criterion, &name, &hmm, &ys);
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = map, dense, graph
}
criterion_main!(benches);
