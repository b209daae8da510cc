//! Random operators with the matrices that they must equal.

use wayfix::motion::{DistanceTransition, OdometryReading};
use wayfix::transition::{
    EvidenceTransition, KroneckerTransition, RestartTransition, SwitchedTransition,
    WindowTransition,
};
use wayfix::{Belief, DenseTransition, SparseTransition, TransitionEntries};
use wayfix_learn::GeneratorTransition;
use wayfix_recognition::motion::{
    OdometryModel, OffMap, RouteControl, RouteTransition, Speeds, ViewChange, ViewChangeRates,
    ViewEvidence,
};

use crate::draw::Draw;
use crate::model::{Matrix, Range, weight};
use crate::operators::{Driven, Measured, Measurement, OneOfTwo, Plain};
use crate::reference::logarithms;

pub(crate) fn matrix(draw: &mut Draw<'_>, n: usize, range: Range) -> Matrix {
    let columns: Vec<Vec<f64>> =
        (0..n).map(|_| draw.distribution(n, |draw| weight(draw, range))).collect();
    (0..n).map(|to| (0..n).map(|from| columns[from][to]).collect()).collect()
}

fn sparse(matrix: &Matrix) -> SparseTransition {
    SparseTransition::from_rows(matrix).expect("a stochastic matrix")
}

/// The entries that an operator lists, if its definition is too long to repeat here. Its products
/// are checked against these.
fn listed<A: TransitionEntries>(a: &A, control: &A::Control) -> Matrix {
    let n = a.states();
    let mut matrix = vec![vec![0.0; n]; n];
    for from in 0..n {
        a.outgoing(control, from).for_each(|(to, p)| matrix[to][from] = p);
    }
    matrix
}

/// An operator over `n` states.
pub(crate) fn plain(draw: &mut Draw<'_>, n: usize, range: Range) -> (Plain, Matrix) {
    let inner = matrix(draw, n, range);
    match draw.below(10) {
        0..=2 | 6 => (Plain::Sparse(sparse(&inner)), inner),
        3..=5 => {
            let dense = DenseTransition::from_rows(&inner);
            (Plain::Dense(dense.expect("a stochastic matrix")), inner)
        }
        7 => {
            let rate = draw.pick(&[0.0, 0.25, 1e-9, 1.0]);
            let belief = draw.distribution(n, |draw| weight(draw, Range::Plain));
            let all = |to: usize, from: usize| (1.0 - rate) * inner[to][from] + rate * belief[to];
            let all = (0..n).map(|to| (0..n).map(|from| all(to, from)).collect()).collect();
            let belief = Belief::new(belief.clone()).expect("a distribution");
            let restart = RestartTransition::new(sparse(&inner), rate, belief);
            (Plain::Restart(restart.expect("a rate")), all)
        }
        _ => window(draw, n, range).unwrap_or_else(|| (Plain::Sparse(sparse(&inner)), inner)),
    }
}

fn window(draw: &mut Draw<'_>, n: usize, range: Range) -> Option<(Plain, Matrix)> {
    let closed = draw.one_in(2);
    let first = draw.below(9).cast_signed() - 4;
    let count = 1 + draw.below(6);
    let weights = draw.distribution(count, |draw| weight(draw, range));
    let made = if closed { WindowTransition::closed } else { WindowTransition::open };
    let window = made(n, first, &weights).ok()?;
    let mut all = vec![vec![0.0; n]; n];
    let length = n.cast_signed();
    for from in 0..n {
        for (to, weight) in (from.cast_signed() + first..).zip(&weights) {
            let to = if closed { to.rem_euclid(length) } else { to.clamp(0, length - 1) };
            all[to.cast_unsigned()][from] += weight;
        }
    }
    Some((Plain::Window(window), all))
}

/// An operator over `n` states (or as many as a route then has), and the logarithms of the
/// matrix of each of its controls.
pub(crate) fn driven(draw: &mut Draw<'_>, n: usize, range: Range) -> (Driven, Vec<Matrix>) {
    let count = 1 + draw.below(3);
    match draw.below(8) {
        0 | 1 => {
            let matrices: Vec<Matrix> = (0..count).map(|_| matrix(draw, n, range)).collect();
            let switched = SwitchedTransition::new(matrices.iter().map(sparse).collect());
            (
                Driven::Switched(switched.expect("as many states each"), (0..count).collect()),
                matrices.iter().map(logarithms).collect(),
            )
        }
        2 => {
            let lengths = [0.0, 1.0, 2.5, 100.0];
            let lengths: Vec<f64> = (0..n * n).map(|_| draw.pick(&lengths)).collect();
            // Multiplied by a density, entries outside the ordinary range would leave that of
            // doubles, where products in logarithms keep more than the matrix.
            let base = sparse(&matrix(draw, n, Range::Plain));
            let distance = DistanceTransition::new(base, |to, from| lengths[to * n + from]);
            let distance = distance.expect("valid lengths");
            // So that no density is below the smallest double.
            let odometry = |draw: &mut Draw<'_>| {
                let distance = draw.pick(&[0.0, 1.0, 1.7, -2.0, 90.0, 150.0, 1e-3, 2.0]);
                let variance = draw.pick(&[30.0, 100.0, 1e4]);
                (!draw.one_in(4)).then_some(OdometryReading { distance, variance })
            };
            let controls: Vec<_> = (0..count).map(|_| odometry(draw)).collect();
            let matrices = controls.iter().map(|u| logarithms(&listed(&distance, u))).collect();
            (Driven::Distance(distance, controls), matrices)
        }
        3 | 4 => measured(draw, n, range, count),
        7 => {
            // Times after which no entry is below the least double.
            let rates = [0.0, 0.0, 1e-3, 0.1, 1.0, 2.5];
            let rates: Vec<_> = (0..n * n).map(|at| (at / n, at % n, draw.pick(&rates))).collect();
            let moves = rates.into_iter().filter(|(to, from, _)| to != from);
            let generator = GeneratorTransition::from_triplets(n, moves).expect("rates");
            let times = [0.0, 1e-3, 0.4, 1.0, 3.0, 25.0];
            let times: Vec<f64> = (0..count).map(|_| draw.pick(&times)).collect();
            let matrices = times.iter().map(|u| logarithms(&listed(&generator, u))).collect();
            (Driven::Generator(generator, times), matrices)
        }
        5 if n.is_multiple_of(2) => pairs(draw, n, range, count),
        _ => {
            let route = route(draw, n);
            let control = |draw: &mut Draw<'_>| {
                let odometry = draw.pick(&[None, Some(0.0), Some(1.0), Some(1.7), Some(-2.0)]);
                let odometry = if draw.one_in(8) { Some(1e6) } else { odometry };
                let view =
                    draw.pick(&[None, Some(ViewChange::Changed), Some(ViewChange::Unchanged)]);
                let weight = draw.pick(&[1.0, 0.5, 0.0, 0.1]);
                let view = view.map(|view| ViewEvidence { view, weight });
                RouteControl { odometry, view, before: None }
            };
            // One without evidence, whose columns sum to one.
            let mut controls = vec![RouteControl::default()];
            controls.extend((1..count).map(|_| control(draw)));
            let matrices = controls.iter().map(|u| logarithms(&listed(&route, u))).collect();
            (Driven::Route(route, controls), matrices)
        }
    }
}

/// A measurement of moves between `n` states.
fn measurement(draw: &mut Draw<'_>, n: usize, range: Range) -> Measurement {
    let shift = draw.pick(&[0.0, -60.0, -150.0, -300.0, 100.0]);
    let log = |draw: &mut Draw<'_>| match (draw.below(8), range) {
        (7, _) => f64::NEG_INFINITY,
        (6, Range::Wide) => draw.unit() * 300.0 - 150.0,
        _ => draw.unit().ln(),
    };
    let logs = (0..n).map(|_| (0..n).map(|_| log(draw) + shift).collect()).collect();
    (logs, draw.pick(&[0.0, shift, shift + 3.0, shift - 40.0]))
}

type MovesOfTwo = fn(&[Measurement; 2], usize, usize) -> f64;
type FactorOfTwo = fn(&[Measurement; 2]) -> f64;

/// Two chains side by side, each with its own evidence. Entries may be beyond doubles although
/// neither chain's are.
fn pairs(draw: &mut Draw<'_>, n: usize, range: Range, count: usize) -> (Driven, Vec<Matrix>) {
    let sizes = [2, n / 2];
    let bases = sizes.map(|size| matrix(draw, size, Range::Plain));
    let controls: Vec<[Measurement; 2]> =
        (0..count).map(|_| sizes.map(|size| measurement(draw, size, range))).collect();
    let parts: [(MovesOfTwo, FactorOfTwo); 2] = [
        (|u, to, from| u[0].0[to][from], |u| u[0].1),
        (|u, to, from| u[1].0[to][from], |u| u[1].1),
    ];
    let part = |which: usize| -> OneOfTwo {
        EvidenceTransition::new(sparse(&bases[which]), parts[which].0)
            .expect("a stochastic matrix")
            .with_log_factor(parts[which].1)
    };
    let entry = |u: &[Measurement; 2], to: usize, from: usize| {
        let log = |which: usize, to: usize, from: usize| {
            bases[which][to][from].ln() + u[which].0[to][from] - u[which].1
        };
        let half = n / 2;
        log(0, to / half, from / half) + log(1, to % half, from % half)
    };
    let matrices = controls
        .iter()
        .map(|u| (0..n).map(|to| (0..n).map(|from| entry(u, to, from)).collect()).collect());
    let matrices = matrices.collect();
    let both = KroneckerTransition::new(part(0), part(1)).expect("few states");
    (Driven::Pairs(both, controls), matrices)
}

/// Arbitrary evidence on the moves of a matrix, with restarts or without. Likelihoods are outside
/// the ordinary range, but within that of doubles.
fn measured(draw: &mut Draw<'_>, n: usize, range: Range, count: usize) -> (Driven, Vec<Matrix>) {
    let base = matrix(draw, n, Range::Plain);
    let controls: Vec<Measurement> = (0..count).map(|_| measurement(draw, n, range)).collect();
    let moves: fn(&Measurement, usize, usize) -> f64 = |u, to, from| u.0[to][from];
    let factor: fn(&Measurement) -> f64 = |u| u.1;
    let operator: Measured = EvidenceTransition::new(sparse(&base), moves)
        .expect("a stochastic matrix")
        .with_log_factor(factor);
    let entry = |(logs, factor): &Measurement, to: usize, from: usize| {
        base[to][from] * (logs[to][from] - factor).exp()
    };
    let all = |entry: &dyn Fn(&Measurement, usize, usize) -> f64| -> Vec<Matrix> {
        let rows = |u| (0..n).map(|i| (0..n).map(|j| entry(u, i, j).ln()).collect()).collect();
        controls.iter().map(rows).collect()
    };
    if draw.one_in(2) {
        let matrices = all(&entry);
        return (Driven::Measured(operator, controls), matrices);
    }
    let rate = draw.pick(&[0.25, 1e-9, 1.0, 0.0]);
    let belief = draw.distribution(n, |draw| weight(draw, Range::Plain));
    let log = draw.pick(&[None, Some(0.0), Some(-150.0), Some(-7.0), Some(90.0)]);
    let matrices = all(&|u, to, from| {
        let restart = rate * belief[to] * (log.unwrap_or(u.1) - u.1).exp();
        (1.0 - rate) * entry(u, to, from) + restart
    });
    let belief = Belief::new(belief.clone()).expect("a distribution");
    let restart = RestartTransition::new(operator, rate, belief).expect("a rate");
    let restart = match log {
        Some(log) => restart.with_evidence(log).expect("a number"),
        None => restart,
    };
    (Driven::Restart(restart, controls), matrices)
}

/// Speeds in ascending order: the usual ones, or arbitrary ones, some of them nearly equal and
/// others far apart.
fn grid(draw: &mut Draw<'_>, count: usize) -> Vec<f64> {
    let usual = [0.0, 1.0, -0.4, 0.5, -1.0, 2.0, 0.25, 3.0, 0.95, 0.99];
    let (even, farthest) = (draw.one_in(2), draw.pick(&[1.5, 4.0, 64.0]));
    let mut grid: Vec<f64> = Vec::new();
    while grid.len() < count {
        let speed = match grid.last() {
            Some(last) if draw.one_in(3) => last + draw.pick(&[1e-15, 1e-9, 0.01, 0.1]),
            _ if even => draw.pick(&usual),
            _ => farthest * (2.0 * draw.unit() - 1.0),
        };
        // Without bytes left, each draw is the first choice again.
        let unlike = |speed: f64| grid.iter().all(|other| *other != speed);
        let upwards = || (0..64).map(f64::from).find(|speed| unlike(*speed));
        let speed = if unlike(speed) && speed <= 64.0 { Some(speed) } else { upwards() };
        grid.extend(speed);
    }
    grid.sort_by(f64::total_cmp);
    grid
}

/// A route with `n` states: `n` places at one speed, or fewer places at several speeds, with or
/// without a state off the map.
fn route(draw: &mut Draw<'_>, n: usize) -> RouteTransition {
    let fits: Vec<usize> = (1..=6).filter(|layers| n.is_multiple_of(*layers)).collect();
    let layers = draw.pick(&fits);
    let (places, off_map) = (n / layers, layers > 1 && draw.one_in(3));
    let grid = grid(draw, layers - usize::from(off_map));
    let (nearby, anywhere) = draw.pick(&[(0.01, 0.005), (0.5, 0.25), (0.0, 0.0), (0.0, 1.0)]);
    let speeds = Speeds::new(&grid)
        .and_then(|speeds| speeds.with_changes(nearby, anywhere))
        .and_then(|speeds| speeds.with_slack(draw.pick(&[0.02, 0.0, 0.5])))
        .expect("valid speeds");
    let odometry = OdometryModel { scale: 1.1, bias: 0.1, deviation: draw.pick(&[0.3, 0.01, 5.0]) };
    let made = if draw.one_in(2) { RouteTransition::closed } else { RouteTransition::open };
    let route = made(places, speeds)
        .and_then(|route| route.with_odometry(odometry))
        .expect("a valid route");
    let route = if draw.one_in(2) {
        let rates = [0.5, 1e-9, 0.999, 0.1];
        let (standing, moved) = (draw.pick(&rates), draw.pick(&rates));
        let rates = ViewChangeRates { standing, moved };
        route.with_views(rates).expect("valid rates")
    } else {
        route
    };
    if !off_map {
        return route;
    }
    let rates = [0.1, 0.5, 1.0, 1e-9];
    let (leave, back) = (draw.pick(&rates), draw.pick(&rates));
    let (near, within) = (draw.pick(&[0.7, 0.0, 1.0]), draw.below(6));
    route.with_off_map(OffMap { leave, back, near, within }).expect("valid rates")
}
