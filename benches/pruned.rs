//! Pruned tracking on a made-up town and on a made-up country: grids of streets
//! of 27,143 and of 10,000,000 places, with the same drive and the same sensor.
//!
//! ```text
//! cargo bench -p wayfix-benches --bench pruned
//! ```
//!
//! The country takes about 3 GB and half a minute. From a start anywhere, the first steps go
//! through all places: three of them are compared with the exact filter, and then later steps.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use rand::RngExt;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::Pruning;
use wayfix::likelihood::SparseObservation;
use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition};

type Model = Hmm<SparseTransition, SparseLikelihood>;

/// Streets of a grid: stop with 0.1, or go on to any neighbour with equal probability.
fn streets(places: usize, width: usize) -> SparseTransition {
    let neighbors = move |at: usize| {
        let column = at % width;
        let (left, right) = (column > 0, column + 1 < width);
        let ways =
            [at.checked_sub(width), left.then(|| at - 1), right.then(|| at + 1), Some(at + width)];
        ways.into_iter().flatten().filter(move |&to| to < places)
    };
    let entries = (0..places).flat_map(move |from| {
        let go = 0.9 / neighbors(from).count() as f64;
        std::iter::once((from, from, 0.1)).chain(neighbors(from).map(move |to| (to, from, go)))
    });
    SparseTransition::from_triplets(places, entries).expect("a stochastic matrix")
}

/// A way there and back, which stays within 70 blocks of where it starts.
fn drive(steps: usize) -> Vec<(isize, isize)> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut at, mut heading) = ((0_isize, 0_isize), (1, 0));
    let mut way = Vec::new();
    while way.len() < steps / 2 {
        way.push(at);
        if rng.random_bool(0.2) {
            let (x, y) = heading;
            heading = if rng.random_bool(0.5) { (y, -x) } else { (-y, x) };
        }
        let next = (at.0 + heading.0, at.1 + heading.1);
        if next.0.abs().max(next.1.abs()) > 70 {
            heading = (-heading.0, -heading.1);
        } else if rng.random_bool(0.9) {
            at = next;
        }
    }
    let back: Vec<_> = way.iter().rev().copied().collect();
    way.extend(back);
    way
}

/// Eight places named at each step: the right one and its neighbours (except at one step in
/// twenty), and random others.
fn sightings(way: &[(isize, isize)], places: usize, width: usize) -> Vec<SparseObservation> {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let centre = places / 2 / width * width + width / 2;
    let seen = way.iter().map(|(x, y)| {
        let at = centre.wrapping_add_signed(x + y * width.cast_signed());
        let mut listed: Vec<(usize, f64)> = Vec::new();
        if rng.random_bool(0.95) {
            listed.extend([(at, 0.5), (at - 1, 0.1), (at + 1, 0.1)]);
        }
        while listed.len() < 8 {
            let other = rng.random_range(0..places);
            if listed.iter().all(|entry| entry.0 != other) {
                listed.push((other, 0.2));
            }
        }
        SparseObservation::new(listed, 1e-4).expect("valid likelihoods")
    });
    seen.collect()
}

fn tracking(criterion: &mut Criterion) {
    let way = drive(20_000);
    for (places, width) in [(27_143, 165), (10_000_000, 3163)] {
        let begun = Instant::now();
        let seen = sightings(&way, places, width);
        let prior = Prior::AtFirstObservation(Belief::uniform(places).expect("there are places"));
        let hmm: Model = Hmm::new(prior, streets(places, width), SparseLikelihood::new(places))
            .expect("the parts have one size");
        let mut filter = hmm.pruned_filter(Pruning::default());
        println!("{places} places: built in {:.1?}", begun.elapsed());
        let (begun, mut worst, mut active) = (Instant::now(), 0.0_f64, 0);
        for (k, y) in seen.iter().enumerate() {
            let certificate = filter.step(y).expect("no place is ruled out");
            if k >= 10 {
                worst = worst.max(certificate.bound());
                active += filter.active().len();
            }
        }
        println!(
            "{places} places: {} steps from anywhere in {:.1?}; after ten, {} places active, bound {worst:.1e}",
            seen.len(),
            begun.elapsed(),
            active / (seen.len() - 10)
        );
        let mut group = criterion.benchmark_group("three steps from anywhere");
        let mut exact = hmm.filter();
        group.bench_function(BenchmarkId::new("exact", places), |bencher| {
            bencher.iter(|| {
                exact.restart();
                seen[..3].iter().for_each(|y| _ = black_box(exact.step(y)));
            });
        });
        group.bench_function(BenchmarkId::new("pruned", places), |bencher| {
            bencher.iter(|| {
                filter.restart();
                seen[..3].iter().for_each(|y| _ = black_box(filter.step(y)));
            });
        });
        group.finish();
        drop(exact);
        // Runs until few places are active again.
        seen[3..100].iter().for_each(|y| _ = black_box(filter.step(y)));
        let begun = Instant::now();
        let found = hmm.beam_viterbi(&seen, 60.0).expect("no place is ruled out");
        println!(
            "{places} places: beam of 60 nats in {:.1?}, proven: {}",
            begun.elapsed(),
            found.is_optimal()
        );
        let mut next = seen.iter().cycle().skip(100);
        let mut group = criterion.benchmark_group("pruned filter step");
        group.bench_function(BenchmarkId::from_parameter(places), |bencher| {
            bencher.iter(|| black_box(filter.step(next.next().expect("there are sightings"))));
        });
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = tracking
}
criterion_main!(benches);
