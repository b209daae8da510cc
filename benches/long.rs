//! One long sequence compared with the same steps in a thousand sequences, for learning and
//! smoothing:
//!
//! ```text
//! cargo bench -p wayfix-benches --bench long
//! WAYFIX_STEPS=100000 cargo bench -p wayfix-benches --bench long -- learn
//! ```
//!
//! The thousand sequences lose the information across their ends; the long one must not. Times
//! are the least of five, in turn, and the last column is their ratio. The last model never
//! forgets: it is taken in one piece, and in logarithms once one of its halves is too improbable.

#[path = "models/mod.rs"]
mod models;

use std::hint::black_box;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;
use wayfix::{Belief, DenseTransition, Hmm, Likelihood, Prior, TableLikelihood};

use models::Model;

const RUNS: usize = 5;
const PIECES: usize = 1000;

/// Least times of two routines, in turn, in seconds.
fn times(mut one: impl FnMut(), mut many: impl FnMut()) -> [f64; 2] {
    let mut least = [f64::INFINITY; 2];
    let time = |least: &mut f64, work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        *least = least.min(start.elapsed().as_secs_f64());
    };
    for _ in 0..RUNS {
        time(&mut least[0], &mut one);
        time(&mut least[1], &mut many);
    }
    least
}

/// Prints the times of both routines with a model.
fn bench<A, B>(name: &str, steps: usize, Model { hmm, seen }: &Model<A, B>)
where
    A: LearnTransition<Control = ()> + Sync,
    B: LearnLikelihood + Likelihood<Observation: Sized + Sync> + Sync,
{
    let filter = std::env::args().nth(1).unwrap_or_default();
    let pieces: Vec<_> = seen.chunks(steps / PIECES).collect();
    let one = [&seen[..steps]];
    let print = |routine: &str, [one, many]: [f64; 2]| {
        println!(
            "{name:>20} {routine:>7} {:>8.1} ms {:>8.1} ms {:>7.2}",
            one * 1e3,
            many * 1e3,
            one / many
        );
    };
    if "learn".contains(&filter) || filter.starts_with('-') {
        let learn = || drop(black_box(hmm.expectations(&one)));
        print("learn", times(learn, || drop(black_box(hmm.expectations(&pieces)))));
    }
    if "smooth".contains(&filter) || filter.starts_with('-') {
        let smooth = || drop(black_box(hmm.smooth(one[0])));
        print("smooth", times(smooth, || drop(black_box(hmm.smooth_all(&pieces)))));
    }
}

/// A table model with the moves that a function gives.
fn table(
    n: usize,
    steps: usize,
    entry: impl Fn(usize, usize) -> f64,
) -> Model<DenseTransition, TableLikelihood> {
    let (_, _, sensor) = models::table(n, 1).hmm.into_parts();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).expect("there are states"));
    let moves = DenseTransition::from_fn(n, entry).expect("a stochastic matrix");
    let hmm = Hmm::new(prior, moves, sensor).expect("one size");
    let seen = hmm.simulate(steps, &mut ChaCha8Rng::seed_from_u64(7)).observations().to_vec();
    Model { hmm, seen }
}

fn main() {
    let steps = std::env::var("WAYFIX_STEPS").ok().and_then(|steps| steps.parse().ok());
    let steps: usize = steps.unwrap_or(1_000_000);
    println!("{steps} steps: one sequence, {PIECES} sequences, ratio");
    bench("8 states", steps, &models::table(8, steps));
    bench("4 states", steps, &models::table(4, steps));
    bench("16 states", steps, &models::table(16, steps));
    bench("105 places", steps / 10, &models::canberra_table(steps / 10));
    let rare = |to: usize, from: usize| if to == from { 0.993 } else { 0.001 };
    bench("8, rare moves", steps, &table(8, steps, rare));
    let ring = |to: usize, from: usize| if to == (from + 1) % 8 { 1.0 - 7e-9 } else { 1e-9 };
    bench("8, nearly a ring", steps, &table(8, steps, ring));
    let apart = |to: usize, from: usize| if to / 4 == from / 4 { 0.25 } else { 0.0 };
    bench("8, two components", steps, &table(8, steps, apart));
}
