//! Every routine on the Canberra map, on a dense model of its size, and on a
//! road graph of your own:
//!
//! ```text
//! cargo bench
//! WAYFIX_GRAPH=path/to/folder cargo bench -- graph
//! ```
//!
//! The folder holds `nodes.csv` (node, longitude, latitude) and `edges.csv`
//! (from, to, class, metres), with nodes numbered from 0 and classes from 0 to
//! 3. Times of what goes through a sequence are per sequence; divide by the
//! elements, or read elements per second.

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Exp1};
use wayfix::{
    Belief, DenseTransition, DistanceTransition, DwellTransition, Ends, Gear, Hmm,
    KroneckerTransition, Labelled, Learning, Likelihood, LikelihoodVector, Odometry,
    OffMapTransition, Order, PowerTransition, Prior, RestartTransition, RouteControl,
    RouteTransition, Simulation, SparseTransition, TransitionEntries, View, ViewRates,
    WindowTransition, canberra,
};

/// One routine, once for each of so many steps.
fn routine<R>(
    criterion: &mut Criterion,
    group: &str,
    name: &str,
    steps: usize,
    mut work: impl FnMut() -> R,
) {
    let mut group = criterion.benchmark_group(group);
    if steps > 1 {
        group.throughput(Throughput::Elements(steps as u64));
    }
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
        bencher.iter(|| black_box(work()));
    });
    group.finish();
}

/// One model and a sequence of observations for it.
fn bench<A, B>(criterion: &mut Criterion, name: &str, hmm: &Hmm<A, B>, ys: &[B::Observation])
where
    A: TransitionEntries<Control = ()>,
    B: Likelihood<Observation: Sized>,
{
    let steps = ys.len();
    // What a step cannot do without: one product with A.
    let (x, mut out) = (hmm.prior().belief().as_slice().to_vec(), vec![0.0; hmm.states()]);
    routine(criterion, "product", name, 1, || {
        hmm.transition().apply(&(), black_box(&x), black_box(&mut out));
    });
    let mut next = ys.iter().cycle();
    let mut y = || next.next().expect("there are observations");

    let mut filter = hmm.filter();
    routine(criterion, "filter step", name, 1, || filter.step(y()).expect(POSSIBLE));
    let mut smoother = hmm.fixed_lag(10);
    routine(criterion, "fixed lag of 10, step", name, 1, || smoother.step(y()).expect(POSSIBLE));
    let mut decoder = hmm.online_viterbi();
    routine(criterion, "online viterbi step", name, 1, || decoder.step(y()).expect(POSSIBLE).len());

    routine(criterion, "score", name, steps, || hmm.score(ys));
    routine(criterion, "forward", name, steps, || hmm.forward(ys));
    routine(criterion, "smooth", name, steps, || hmm.smooth(ys));
    for (group, order) in
        [("smooth each, forward", Order::Forward), ("smooth each, backward", Order::Backward)]
    {
        routine(criterion, group, name, steps, || {
            hmm.smooth_each(ys, order, |step| {
                black_box(step.smoothed().as_slice()[0]);
            })
        });
    }
    routine(criterion, "expected moves", name, steps, || hmm.expected_moves(ys));
    routine(criterion, "path entropy", name, steps, || hmm.path_entropy(ys));
    routine(criterion, "viterbi", name, steps, || hmm.viterbi(ys));
    routine(criterion, "10 best paths", name, steps, || hmm.k_best(ys, 10));
    let sampler = hmm.path_sampler(ys).expect(POSSIBLE);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    routine(criterion, "draw a path", name, steps, || sampler.draw(&mut rng));
    routine(criterion, "forecast of 10 steps", name, 10, || filter.forecast(10));
}

const POSSIBLE: &str = "the observation is possible";

/// What needs more of a model than all have.
fn learning(criterion: &mut Criterion) {
    let hmm = canberra::hmm(5, 1.0).expect("place 5 exists");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let simulated: Vec<Simulation<usize>> = (0..200).map(|_| hmm.simulate(50, &mut rng)).collect();
    let drives: Vec<&[usize]> = simulated.iter().map(Simulation::observations).collect();
    let labelled: Vec<Labelled<'_, [usize]>> = simulated.iter().map(Simulation::labelled).collect();
    let steps = 200 * 50;
    let once = Learning { iterations: 1, ..Learning::default() };
    routine(criterion, "learn, two E-steps and an M-step", "canberra-105", steps, || {
        hmm.learn(&drives, &once)
    });
    routine(criterion, "learn from labelled drives", "canberra-105", steps, || {
        hmm.learn_labelled(&labelled, &once)
    });
    routine(criterion, "score 200 drives", "canberra-105", steps, || hmm.score_all(&drives));
    routine(criterion, "filter 200 drives", "canberra-105", steps, || hmm.forward_all(&drives));
    routine(criterion, "smooth 200 drives", "canberra-105", steps, || hmm.smooth_all(&drives));
    routine(criterion, "viterbi of 200 drives", "canberra-105", steps, || hmm.viterbi_all(&drives));
    routine(criterion, "simulate", "canberra-105", 1000, || hmm.simulate(1000, &mut rng));
}

/// A product and a max-product with each structured operator.
fn operators(criterion: &mut Criterion) {
    let n = 1050;
    let window = WindowTransition::new(n, 0, &[0.1, 0.6, 0.2, 0.1], Ends::Loop).expect("a window");
    let uniform = |n| Belief::uniform(n).expect("there are states");
    let turns = DenseTransition::from_fn(4, |i, j| if i == j { 0.7 } else { 0.1 }).expect("turns");
    let times = vec![[0.1, 0.4, 0.3, 0.2]; n];
    operator(criterion, "window of 4", &window);
    let sparse = SparseTransition::from_operator(&window).expect("a window");
    operator(criterion, "the same window, sparse", &sparse);
    let restart = RestartTransition::new(sparse.clone(), 0.01, uniform(n)).expect("one size");
    operator(criterion, "restart", &restart);
    let metres = |to: usize, from: usize| 100.0 * ((to + n - from) % n) as f64;
    let distance = DistanceTransition::new(sparse.clone(), metres).expect("lengths");
    let driven = Odometry { distance: 120.0, variance: 400.0 };
    operator_with(criterion, "by distance", &distance, &Some(driven));
    let off_map = OffMapTransition::new(sparse, 0.01, 0.1, uniform(n)).expect("one size");
    operator(criterion, "off the map", &off_map);
    operator(criterion, "power of 3", &PowerTransition::new(window.clone(), 3));
    let kronecker = KroneckerTransition::new(window.clone(), turns).expect("few states");
    operator(criterion, "kronecker with 4 headings", &kronecker);
    let dwell = DwellTransition::new(window, &times).expect("distributions");
    operator(criterion, "dwell of 4 steps", &dwell);
    route(criterion, n);
}

/// Four gears with windows of 1 to 4 weights, and stretches of 1 to 4 places.
fn route(criterion: &mut Criterion, n: usize) {
    let gears = [(0.0, 0.0), (0.5, 0.05), (1.0, 0.05), (2.0, 0.05)];
    let gears = gears.map(|(speed, slack)| Gear::speed(speed, slack).expect("a gear"));
    let stretches: Vec<_> = (0..n).map(|place| place / (1 + place % 4)).collect();
    let rates = ViewRates { standing: 0.95, alike: 0.4, moved: 0.02 };
    let route = RouteTransition::new(n, false, gears.to_vec(), 0.9).expect("few states");
    let route = route.with_views(&stretches, rates).expect("a stretch for each place");
    let odometry = Some(Odometry { distance: 0.8, variance: 0.04 });
    for (name, odometry, view) in [
        ("route with 4 gears", None, None),
        ("route, odometry", odometry, None),
        ("route, views", None, Some(View::Changed)),
        ("route, odometry and views", odometry, Some(View::Changed)),
    ] {
        operator_with(criterion, name, &route, &RouteControl { odometry, view });
    }
}

fn operator<A: TransitionEntries<Control = ()>>(criterion: &mut Criterion, name: &str, a: &A) {
    operator_with(criterion, name, a, &());
}

fn operator_with<A: TransitionEntries>(
    criterion: &mut Criterion,
    name: &str,
    a: &A,
    control: &A::Control,
) {
    let n = a.states();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let x: Vec<f64> = (0..n).map(|_| Exp1.sample(&mut rng)).collect();
    let scores: Vec<f64> = x.iter().map(|x| -10.0 * x).collect();
    let (mut out, mut from) = (vec![0.0; n], vec![0; n]);
    routine(criterion, "operator product", name, 1, || {
        a.apply(control, black_box(&x), black_box(&mut out));
    });
    if name != "power of 3" {
        routine(criterion, "operator max-product", name, 1, || {
            a.max_product(control, black_box(&scores), black_box(&mut out), black_box(&mut from));
        });
    }
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
    targets = map, dense, learning, operators, graph
}
criterion_main!(benches);
