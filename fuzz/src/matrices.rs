//! Random operators with the matrices that they must equal.

use wayfix::{
    Belief, DenseTransition, DistanceTransition, Ends, Gear, Odometry, RestartTransition,
    RouteControl, RouteTransition, SparseTransition, SwitchedTransition, TransitionEntries, View,
    ViewRates, WindowTransition,
};

use crate::draw::Draw;
use crate::model::{Matrix, Range, weight};
use crate::operators::{Driven, Plain};

pub(crate) fn matrix(draw: &mut Draw<'_>, n: usize, range: Range) -> Matrix {
    let columns: Vec<Vec<f64>> =
        (0..n).map(|_| draw.distribution(n, |draw| weight(draw, range))).collect();
    (0..n).map(|to| (0..n).map(|from| columns[from][to]).collect()).collect()
}

fn sparse(matrix: &Matrix) -> SparseTransition {
    SparseTransition::from_rows(matrix.len(), &matrix.concat()).expect("a stochastic matrix")
}

/// What an operator lists, where its definition is too long to repeat here. Its
/// products are checked against this.
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
        0..=2 => (Plain::Sparse(sparse(&inner)), inner),
        3..=5 => {
            let dense = DenseTransition::from_rows(n, &inner.concat());
            (Plain::Dense(dense.expect("a stochastic matrix")), inner)
        }
        6 => {
            let single = sparse(&inner).with_single_values();
            let rounded = listed(&single, &());
            (Plain::Sparse(single), rounded)
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
    let ends = draw.pick(&[Ends::Loop, Ends::Stop, Ends::Renormalise]);
    let first = draw.below(9).cast_signed() - 4;
    let count = 1 + draw.below(6);
    let weights = draw.distribution(count, |draw| weight(draw, range));
    let window = WindowTransition::new(n, first, &weights, ends).ok()?;
    let mut all = vec![vec![0.0; n]; n];
    let length = n.cast_signed();
    for from in 0..n {
        for (to, weight) in (from.cast_signed() + first..).zip(&weights) {
            let to = match ends {
                Ends::Loop => to.rem_euclid(length),
                Ends::Stop => to.clamp(0, length - 1),
                Ends::Renormalise if (0..length).contains(&to) => to,
                Ends::Renormalise => continue,
            };
            all[to.cast_unsigned()][from] += weight;
        }
        let sum: f64 = all.iter().map(|row| row[from]).sum();
        if ends == Ends::Renormalise {
            all.iter_mut().for_each(|row| row[from] /= sum);
        }
    }
    Some((Plain::Window(window), all))
}

/// An operator over `n` states (or as many as a route then has), and the matrix
/// of each of its controls.
pub(crate) fn driven(draw: &mut Draw<'_>, n: usize, range: Range) -> (Driven, Vec<Matrix>) {
    let count = 1 + draw.below(3);
    match draw.below(4) {
        0 | 1 => {
            let matrices: Vec<Matrix> = (0..count).map(|_| matrix(draw, n, range)).collect();
            let switched = SwitchedTransition::new(matrices.iter().map(sparse).collect());
            (
                Driven::Switched(switched.expect("as many states each"), (0..count).collect()),
                matrices,
            )
        }
        2 => {
            let lengths = [0.0, 1.0, 2.5, 100.0];
            let lengths: Vec<f64> = (0..n * n).map(|_| draw.pick(&lengths)).collect();
            let base = sparse(&matrix(draw, n, range));
            let distance = DistanceTransition::new(base, |to, from| lengths[to * n + from]);
            let distance = distance.expect("valid lengths");
            // So that no density is below the smallest double.
            let odometry = |draw: &mut Draw<'_>| {
                let distance = draw.pick(&[0.0, 1.0, 1.7, -2.0, 90.0, 150.0, 1e-3, 2.0]);
                let variance = draw.pick(&[30.0, 100.0, 1e4]);
                (!draw.one_in(4)).then_some(Odometry { distance, variance })
            };
            let controls: Vec<_> = (0..count).map(|_| odometry(draw)).collect();
            let matrices = controls.iter().map(|u| listed(&distance, u)).collect();
            (Driven::Distance(distance, controls), matrices)
        }
        _ => {
            let route = route(draw, n, range);
            let control = |draw: &mut Draw<'_>| {
                let odometry = odometry(draw);
                let view = draw.pick(&[None, Some(View::Changed), Some(View::Unchanged)]);
                RouteControl { odometry, view }
            };
            let controls: Vec<_> = (0..count).map(|_| control(draw)).collect();
            let matrices = controls.iter().map(|u| listed(&route, u)).collect();
            (Driven::Route(route, controls), matrices)
        }
    }
}

fn odometry(draw: &mut Draw<'_>) -> Option<Odometry> {
    let distance = draw.pick(&[0.0, 1.0, 1.7, -2.0, 90.0, 1e7, 1e-3, 2.0]);
    let variance = draw.pick(&[0.5, 0.0, 1e-6, 1e4, 1e-300, 1.0]);
    (!draw.one_in(4)).then_some(Odometry { distance, variance })
}

/// A route of `n` places, or of half as many in two gears.
fn route(draw: &mut Draw<'_>, n: usize, range: Range) -> RouteTransition {
    let gears = if n.is_multiple_of(2) && draw.one_in(2) { 2 } else { 1 };
    let places = n / gears;
    // With views, products may be too small to be listed, and are said to be lost.
    let views = draw.one_in(2);
    let range = if views { Range::Plain } else { range };
    let gear = |draw: &mut Draw<'_>| {
        let count = 1 + draw.below(places.min(4));
        let first = draw.below(5).cast_signed() - 2;
        let weights = draw.distribution(count, |draw| match draw.below(12) {
            11 if range == Range::Wide => draw.pick(&[1e-310, 5e-324, 1e-200, 1e-240]),
            _ => weight(draw, Range::Plain),
        });
        // What is too small may be refused.
        Gear::new(first, &weights).or_else(|_| Gear::new(first, &[1.0])).expect("a gear")
    };
    let list = (0..gears).map(|_| gear(draw)).collect();
    let keep = draw.pick(&[0.9, 1.0, 0.0, 0.5]);
    let route = RouteTransition::new(places, draw.one_in(2), list, keep).expect("a valid route");
    if views {
        let stretches: Vec<usize> = (0..places).map(|_| draw.below(3)).collect();
        let rates = [0.5, 1e-30, 0.999, 0.1];
        let (standing, alike, moved) = (draw.pick(&rates), draw.pick(&rates), draw.pick(&rates));
        let rates = ViewRates { standing, alike, moved };
        return route.with_views(&stretches, rates).expect("valid rates");
    }
    route
}
