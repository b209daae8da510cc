//! Queries against the descriptors of reference images:
//!
//! ```text
//! cargo bench --bench descriptors
//! cargo bench --bench descriptors --features faer
//! ```
//!
//! The name says how many references there are, of which dimension; bytes per
//! second are those of the references, 4 N d, for each query. Times are for all
//! the queries of a call.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wayfix::observation::{Distance, ReferenceDescriptors};

/// Queries of the largest call.
const MOST: usize = 64;

fn descriptors(criterion: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut normal =
        |n: usize| -> Vec<f32> { (0..n).map(|_| StandardNormal.sample(&mut rng)).collect() };
    for (count, dimension) in [(100_000, 128), (3576, 512)] {
        let (values, queries) = (normal(count * dimension), normal(MOST * dimension));
        let mut out = vec![0.0; MOST * count];
        for distance in [Distance::Cosine, Distance::Euclidean] {
            let references = ReferenceDescriptors::new(dimension, values.clone(), distance)
                .expect("the references are valid");
            let size = format!("{count} x {dimension}, {distance:?}");
            let mut group = criterion.benchmark_group("descriptors");
            for together in [1, 4, 16, MOST] {
                group.throughput(Throughput::Bytes((together * count * dimension * 4) as u64));
                group.bench_function(BenchmarkId::new(format!("{together} queries"), &size), |b| {
                    let queries = &queries[..together * dimension];
                    let out = &mut out[..together * count];
                    b.iter(|| references.distances_all_into(black_box(queries), black_box(out)));
                });
            }
            group.finish();
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = descriptors
}
criterion_main!(benches);
