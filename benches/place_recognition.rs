//! Place recognition: queries against the descriptors of reference images, and
//! live steps of a filter along them.
//!
//! ```text
//! cargo bench -p wayfix-benches --bench place_recognition
//! cargo bench -p wayfix-benches --bench place_recognition --features faer
//! ```
//!
//! For descriptors, the name has the number and the dimension of the references; bytes per second
//! are those of the references, 4 N d, for each query. Times are for all queries of a call.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use wayfix::likelihood::GroupedLikelihood;
use wayfix::transition::WindowTransition;
use wayfix::{Belief, Hmm, Likelihood, LikelihoodVector, Prior, Transition};
use wayfix_recognition::motion::{
    RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates, ViewEvidence,
};
use wayfix_recognition::observation::{Distance, ReferenceDescriptors};
use wayfix_recognition::{Options, Recognizer};

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

/// Steps of a filter on 3,576 references, in several ways.
fn live(criterion: &mut Criterion) {
    const PLACES: usize = 3576;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut row = |_| -> Vec<f32> {
        let noise = (0..PLACES).map(|_| StandardNormal.sample(&mut rng));
        noise.map(|x: f32| 1.0 + 0.2 * x).collect()
    };
    let rows: Vec<Vec<f32>> = (0..50).map(&mut row).collect();
    let linear = |row: &Vec<f32>| row.iter().map(|d| f64::from(-d).exp()).collect();
    let likelihoods: Vec<Vec<f64>> = rows.iter().map(linear).collect();

    let window = WindowTransition::open(PLACES, -1, &[0.05, 0.15, 0.6, 0.15, 0.05])
        .expect("the weights sum to one");
    let given = LikelihoodVector::linear(PLACES).owned();
    step(criterion, "window of 5, likelihoods given", &window, given, &(), &likelihoods);

    let route = RouteTransition::open(PLACES, Speeds::default())
        .and_then(|route| route.with_views(ViewChangeRates::default()))
        .expect("a route");
    let camera = GroupedLikelihood::new(given, route.place_groups()).expect("a group a place");
    let view = Some(ViewEvidence { view: ViewChange::Changed, weight: 1.0 });
    let control = RouteControl { view, ..RouteControl::default() };
    step(criterion, "15 speeds, likelihoods given", &route, camera, &control, &likelihoods);

    let recognizer = Recognizer::from_distances(PLACES, Options::default()).expect("references");
    let mut track = recognizer.track();
    let mut rows = rows.iter().cycle();
    criterion.bench_function("live step on 3576 references/track, rows of distances", |b| {
        b.iter(|| track.step_with(1.0, rows.next().expect("there are rows")).expect("possible"));
    });
}

fn step<A: Transition, B: Likelihood<Observation: Sized>>(
    criterion: &mut Criterion,
    name: &str,
    motion: &A,
    sensor: B,
    control: &A::Control,
    rows: &[B::Observation],
) {
    let start = Belief::uniform(motion.states()).expect("there are states");
    let hmm = Hmm::new(Prior::AtFirstObservation(start), motion, sensor).expect("they fit");
    let hmm = hmm.with_rounded_tails();
    let mut filter = hmm.filter();
    let mut rows = rows.iter().cycle();
    criterion.bench_function(&format!("live step on 3576 references/{name}"), |b| {
        b.iter(|| {
            filter.step_with(control, rows.next().expect("there are rows")).expect("possible")
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = descriptors, live
}
criterion_main!(benches);
