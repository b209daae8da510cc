//! A filter step on a map of a million places, compared with the time that two threads take to
//! move its bytes.
//!
//! ```text
//! cargo bench -p wayfix-benches --features rayon --bench large
//! WAYFIX_PLACES=10000000 cargo bench -p wayfix-benches --features rayon --bench large
//! ```
//!
//! Bytes are those that a step needs: a value and an index of 32 bits for each road, and the
//! vectors that it reads and writes. The memory is timed with the triad a = b + s c (McCalpin
//! 1995), on the same number of threads. Times are the least of many, and the median.

use std::hint::black_box;
use std::time::Instant;

use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition, Transition};

/// The least time of `runs` runs, in seconds, and the median.
fn time(runs: usize, mut work: impl FnMut()) -> [f64; 2] {
    let timed = (0..runs).map(|_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    });
    let mut timed: Vec<f64> = timed.collect();
    timed.sort_unstable_by(f64::total_cmp);
    [timed[0], timed[runs / 2]]
}

/// Bytes per second of the triad, on two threads.
fn triad() -> f64 {
    const LENGTH: usize = 24_000_000;
    let (b, c) = (vec![1.0; LENGTH], vec![2.0; LENGTH]);
    let mut a = vec![0.0; LENGTH];
    let [seconds, _] = time(10, || {
        let (parts, b, c) = (a.chunks_mut(LENGTH / 2), b.chunks(LENGTH / 2), c.chunks(LENGTH / 2));
        std::thread::scope(|scope| {
            for ((a, b), c) in parts.zip(b).zip(c) {
                scope.spawn(move || {
                    for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                        *a = b + 3.0 * c;
                    }
                });
            }
        });
        black_box(&a);
    });
    (3 * 8 * LENGTH) as f64 / seconds
}

/// Roads of a town like a grid, numbered street by street: from each place it
/// stays, or goes to one of four others. Three of a hundred roads lead elsewhere in the
/// neighbourhood.
fn roads(places: usize) -> impl Iterator<Item = (usize, usize, f64)> {
    let width = places.isqrt();
    let mut random = 1_u64;
    let mut draw = move |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695);
        (random >> 33) as usize % below
    };
    (0..places).flat_map(move |from| {
        let mut to = [0, 1, places - 1, width, places - width].map(|step| (from + step) % places);
        if draw(100) < 15 {
            to[1 + draw(4)] = (from + 2 + draw(width - 4)) % places;
        }
        to.map(|to| (to, from, 0.2))
    })
}

/// Resident memory and its peak, in MB, if the system reports them.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let field = |name: &str| {
        let line = status.lines().find(|line| line.starts_with(name))?;
        line.split_whitespace().nth(1)?.parse::<usize>().ok()
    };
    let megabytes = |name: &str| field(name).map_or(0, |kilobytes| kilobytes / 1024);
    format!("{} MB, at most {} MB", megabytes("VmRSS:"), megabytes("VmHWM:"))
}

fn main() {
    let places: usize = std::env::var("WAYFIX_PLACES")
        .map_or(1_000_000, |places| places.parse().expect("WAYFIX_PLACES is a number"));
    let start = Instant::now();
    let transition = SparseTransition::from_triplets(places, roads(places)).expect("a town");
    println!("{places} places, {} roads", transition.entries());
    println!("loaded in {:.1} s; memory {}", start.elapsed().as_secs_f64(), memory());
    let (x, mut out) = (vec![1.0; places], vec![0.0; places]);
    let product = time(30, || transition.apply(&(), black_box(&x), black_box(&mut out)));
    let entries = transition.entries();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(places).expect("places"));
    let hmm = Hmm::new(prior, transition, LikelihoodVector::linear(places)).expect("a model");
    let mut filter = hmm.filter();
    let seen: Vec<f64> = (0..places).map(|place| 0.5 + (place % 7) as f64 / 10.0).collect();
    let step = time(30, || {
        filter.step(&seen).expect("likelihoods above 0");
    });
    println!("with a filter and likelihoods: {}", memory());
    let bandwidth = triad();
    println!("triad: {:.1} GB/s", bandwidth / 1e9);
    // The belief and the likelihoods are read; the result is written, then read and
    // written for its sum to be one.
    let bytes = (8 + 4) * entries + (1 + 1 + 1 + 2) * 8 * places;
    let moved = bytes as f64 / bandwidth;
    println!("product: {:.3} ms (median {:.3})", product[0] * 1e3, product[1] * 1e3);
    let [step, median] = step;
    println!(
        "step: {:.3} ms (median {:.3}), {:.1} MB",
        step * 1e3,
        median * 1e3,
        bytes as f64 / 1e6
    );
    println!("time to move them: {:.3} ms; ratio {:.2}", moved * 1e3, step / moved);
}
