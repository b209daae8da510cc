//! Every routine on every model, for one sequence and for many:
//!
//! ```text
//! cargo bench -p wayfix-benches --bench routines
//! cargo bench -p wayfix-benches --bench routines -- viterbi
//! cargo bench -p wayfix-benches --bench routines -- 'dense 1000/smooth'
//! cargo bench -p wayfix-benches --bench routines -- /batch
//! WAYFIX_GRAPH=path/to/folder cargo bench -p wayfix-benches --bench routines -- metro
//! ```
//!
//! `benches/compare OLD [NEW]` compares two commits, or a commit with the working tree.
//!
//! A name is `model/routine/single` or `model/routine/batch`; criterion takes a regular
//! expression that matches any part of it, and only models with a match are made. Times are for
//! all steps of a measurement; elements per second are steps per second.
//!
//! | model | states, entries | sensor | single | batch |
//! |---|---|---|---|---|
//! | `dense 2`, `3`, `4`, `8`, `10` | all moves possible | a table of 6 symbols | 100,000 steps | 64 × 1,000 |
//! | `dense 2 given`, `8 given` | the same | likelihoods given | 100,000 | 64 × 1,000 |
//! | `sparse 105` | Canberra, 420 | likelihoods given | 1,000 | 64 × 50 |
//! | `sparse 105 table` | the same | the place that is seen | 1,000 | 64 × 50 |
//! | `dense 105` | 11,025 | likelihoods given | 200 | 64 × 50 |
//! | `dense 1000` | 1,000,000 | likelihoods given | 20 | 16 × 10 |
//! | `metro` | a road graph of your own | likelihoods given | 50 | 16 × 5 |
//! | `sparse 1000000` | a made-up town, 5,000,000 | likelihoods given | 4 | 4 × 1 |
//!
//! | routine | measurement |
//! |---|---|
//! | `product` | A x alone, which every step needs |
//! | `filter`, `fixed lag` | a step of a stream, with a lag of 10: single only |
//! | `forward`, `score`, `smooth`, `viterbi` | one sequence; in a batch, the verb in `_all` |
//! | `scalar filter` | a plain loop over compressed rows for comparison (`scalar.rs`): sparse models only |
//! | `learn` | one iteration of Baum–Welch: two E-steps and an M-step, so that elements are twice the steps |
//!
//! With 1,000,000 places, the fixed lag and learning are left out, since they take seconds.
//! Batches of that model and of models of few states don't run in lock-step, but one by one.
//! Further benches are rarer routines with `sparse 105` and `metro` (`rarer.rs`), and products
//! with structured operators, whose names begin with `operator` (`operators.rs`). With the
//! feature `rayon`, batches, and steps with 1,000,000 places, run on all processors. All benches
//! together take about five minutes.
//!
//! The graph's folder holds `nodes.csv` (node, longitude, latitude) and `edges.csv`
//! (from, to, class, metres), with nodes numbered from 0.

#[path = "../models/mod.rs"]
mod models;
mod operators;
mod rarer;
mod scalar;
mod timed;

use std::cell::LazyCell;
use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::LearningOptions;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;
use wayfix::{Hmm, Likelihood, TransitionEntries};

use models::Model;
use timed::{Group, POSSIBLE};

/// Number of steps of one measurement.
#[derive(Clone, Copy)]
struct Sizes {
    single: usize,
    /// Sequences, and steps of each.
    batch: (usize, usize),
}

impl Sizes {
    fn new(single: usize, batch: (usize, usize)) -> Self {
        Self { single, batch }
    }

    /// Number of observations that are needed.
    fn seen(self) -> usize {
        self.single.max(self.batch.0 * self.batch.1)
    }
}

/// Benches of the steps of streams, and of the verbs.
fn verbs<A, B, F>(group: &mut Group<'_>, sizes: Sizes, model: &LazyCell<Model<A, B>, F>)
where
    A: TransitionEntries<Control = ()> + Sync,
    B: Likelihood<Observation: Sized + Sync> + Sync,
    F: FnOnce() -> Model<A, B>,
{
    let (steps, (count, each)) = (sizes.single, sizes.batch);
    group.single("product", 1, || {
        let Model { hmm, .. } = &**model;
        let (x, mut out) = (hmm.prior().belief().as_slice(), vec![0.0; hmm.states()]);
        move || hmm.transition().apply(&(), black_box(x), black_box(&mut out))
    });
    group.single("filter", 1, || {
        let Model { hmm, seen } = &**model;
        let (mut filter, mut seen) = (hmm.filter(), seen.iter().cycle());
        move || seen.next().map(|y| filter.step(y).expect(POSSIBLE))
    });
    let one = || {
        let Model { hmm, seen } = &**model;
        (hmm, &seen[..steps])
    };
    let many = || (&model.hmm, model.sequences(count, each));
    group.single("forward", steps, || {
        let (hmm, ys) = one();
        move || hmm.forward(ys)
    });
    group.batch("forward", count * each, || {
        let (hmm, ys) = many();
        move || hmm.forward_all(&ys)
    });
    group.single("score", steps, || {
        let (hmm, ys) = one();
        move || hmm.log_likelihood(ys)
    });
    group.batch("score", count * each, || {
        let (hmm, ys) = many();
        move || hmm.log_likelihood_all(&ys)
    });
    group.single("smooth", steps, || {
        let (hmm, ys) = one();
        move || hmm.smooth(ys)
    });
    group.batch("smooth", count * each, || {
        let (hmm, ys) = many();
        move || hmm.smooth_all(&ys)
    });
    group.single("viterbi", steps, || {
        let (hmm, ys) = one();
        move || hmm.viterbi(ys)
    });
    group.batch("viterbi", count * each, || {
        let (hmm, ys) = many();
        move || hmm.viterbi_all(&ys)
    });
}

/// Benches that take too long with the largest model.
fn longer<A, B, F>(group: &mut Group<'_>, sizes: Sizes, model: &LazyCell<Model<A, B>, F>)
where
    A: LearnTransition<Control = ()> + TransitionEntries + Clone + Sync,
    B: LearnLikelihood<Observation: Sized + Sync> + Clone + Sync,
    Hmm<A, B>: Clone + Sync,
    F: FnOnce() -> Model<A, B>,
{
    group.single("fixed lag", 1, || {
        let Model { hmm, seen } = &**model;
        let (mut smoother, mut seen) = (hmm.fixed_lag(10), seen.iter().cycle());
        move || seen.next().map(|y| smoother.step(y).expect(POSSIBLE))
    });
    let once = &LearningOptions::default().with_iterations(1).with_tolerance(0.0);
    let learn = |count, steps| {
        let Model { hmm, .. } = &**model;
        let ys = model.sequences(count, steps);
        move || hmm.learn(&ys, once).expect("it can be learned")
    };
    let (steps, (count, each)) = (sizes.single, sizes.batch);
    group.single("learn", 2 * steps, || learn(1, steps));
    group.batch("learn", 2 * count * each, || learn(count, each));
}

fn few(criterion: &mut Criterion) {
    let sizes = Sizes::new(100_000, (64, 1000));
    for n in [2, 3, 4, 8, 10] {
        let model = LazyCell::new(|| models::table(n, sizes.seen()));
        let mut group = Group::new(criterion, format!("dense {n}"));
        verbs(&mut group, sizes, &model);
        longer(&mut group, sizes, &model);
    }
    for n in [2, 8] {
        let model = LazyCell::new(|| models::given(models::dense(n), sizes.seen()));
        verbs(&mut Group::new(criterion, format!("dense {n} given")), sizes, &model);
    }
}

fn canberra(criterion: &mut Criterion) {
    let sizes = Sizes::new(1000, (64, 50));
    let model = LazyCell::new(|| models::given(models::canberra(), sizes.seen()));
    let mut group = Group::new(criterion, "sparse 105");
    verbs(&mut group, sizes, &model);
    longer(&mut group, sizes, &model);
    rarer::bench(&mut group, sizes.single, &model);
    scalar::bench(&mut group, &model);
    let model = LazyCell::new(|| models::canberra_table(sizes.seen()));
    let mut group = Group::new(criterion, "sparse 105 table");
    verbs(&mut group, sizes, &model);
    longer(&mut group, sizes, &model);
    group.single("simulate", sizes.single, || {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let hmm = &model.hmm;
        move || hmm.simulate(sizes.single, &mut rng)
    });
}

fn dense(criterion: &mut Criterion) {
    for (n, sizes) in [(105, Sizes::new(200, (64, 50))), (1000, Sizes::new(20, (16, 10)))] {
        let model = LazyCell::new(|| models::given(models::dense(n), sizes.seen()));
        let mut group = Group::new(criterion, format!("dense {n}"));
        verbs(&mut group, sizes, &model);
        longer(&mut group, sizes, &model);
    }
}

fn metro(criterion: &mut Criterion) {
    let Some(folder) = models::graph_folder() else { return };
    let sizes = Sizes::new(50, (16, 5));
    let model = LazyCell::new(|| models::given(models::graph(&folder), sizes.seen()));
    let mut group = Group::new(criterion, "metro");
    verbs(&mut group, sizes, &model);
    longer(&mut group, sizes, &model);
    rarer::bench(&mut group, sizes.single, &model);
    scalar::bench(&mut group, &model);
}

fn town(criterion: &mut Criterion) {
    let sizes = Sizes::new(4, (4, 1));
    let model = LazyCell::new(|| models::given(models::town(1_000_000), sizes.seen()));
    verbs(&mut Group::new(criterion, "sparse 1000000"), sizes, &model);
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1))
        .nresamples(10_000);
    targets = few, canberra, dense, metro, town, operators::all
}
criterion_main!(benches);
