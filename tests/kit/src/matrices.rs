//! Dense matrices of operators, entry by entry from their definitions.

use wayfix::transition::{SwitchedTransition, WindowTransition};
use wayfix::{DenseTransition, SparseTransition, TransitionError};

/// `matrix[to][from]`.
pub type Matrix = Vec<Vec<f64>>;

pub fn matrix(n: usize, entry: impl Fn(usize, usize) -> f64) -> Matrix {
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

pub fn sparse(m: &Matrix) -> SparseTransition {
    SparseTransition::from_rows(m).unwrap()
}

pub fn dense(m: &Matrix) -> DenseTransition {
    DenseTransition::from_rows(m).unwrap()
}

/// One matrix for each control.
pub fn switched(matrices: &[Matrix]) -> SwitchedTransition<SparseTransition> {
    SwitchedTransition::new(matrices.iter().map(sparse).collect()).unwrap()
}

/// The identity.
pub fn still(n: usize) -> SparseTransition {
    SparseTransition::from_triplets(n, (0..n).map(|i| (i, i, 1.0))).unwrap()
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    matrix(a.len(), |i, j| (0..a.len()).map(|k| a[i][k] * b[k][j]).sum())
}

/// The operator of [`window`].
pub fn window_transition(
    states: usize,
    first: isize,
    weights: &[f64],
    closed: bool,
) -> Result<WindowTransition, TransitionError> {
    if closed {
        WindowTransition::closed(states, first, weights)
    } else {
        WindowTransition::open(states, first, weights)
    }
}

pub fn power(m: &Matrix, exponent: u32) -> Matrix {
    (0..exponent).fold(matrix(m.len(), |i, j| f64::from(i == j)), |p, _| times(m, &p))
}

pub fn restart(m: &Matrix, rate: f64, r: &[f64]) -> Matrix {
    matrix(m.len(), |i, j| (1.0 - rate) * m[i][j] + rate * r[i])
}

pub fn kronecker(a: &Matrix, b: &Matrix) -> Matrix {
    let n2 = b.len();
    matrix(a.len() * n2, |i, j| a[i / n2][j / n2] * b[i % n2][j % n2])
}

/// Adds a state off the map; `back` leads from it to states of the map.
pub fn off_map(m: &Matrix, leave: f64, return_rate: f64, back: &[f64]) -> Matrix {
    let n = m.len();
    matrix(n + 1, |i, j| match (i == n, j == n) {
        (false, false) => (1.0 - leave) * m[i][j],
        (true, false) => leave,
        (false, true) => return_rate * back[i],
        (true, true) => 1.0 - return_rate,
    })
}

/// States (place, age), left with probabilities `leaving[place][age]`.
pub fn dwell(moves: &Matrix, leaving: &[Vec<f64>]) -> Matrix {
    let states: Vec<(usize, usize)> =
        (0..leaving.len()).flat_map(|i| (0..leaving[i].len()).map(move |age| (i, age))).collect();
    matrix(states.len(), |to, from| {
        let ((i, new_age), (j, age)) = (states[to], states[from]);
        let leave = leaving[j][age];
        let arrives = if new_age == 0 { leave * moves[i][j] } else { 0.0 };
        let oldest = age + 1 == leaving[j].len();
        let stays = i == j && new_age == if oldest { age } else { age + 1 };
        arrives + if stays { 1.0 - leave } else { 0.0 }
    })
}

/// The matrix of a window, move by move.
pub fn window(n: usize, first: isize, weights: &[f64], closed: bool) -> Matrix {
    let places = n.cast_signed();
    let mut m = vec![vec![0.0; n]; n];
    for from in 0..places {
        for (offset, weight) in (first..).zip(weights) {
            let mut to = from + offset;
            while closed && to < 0 {
                to += places;
            }
            while closed && to >= places {
                to -= places;
            }
            to = to.max(0).min(places - 1);
            m[to.cast_unsigned()][from.cast_unsigned()] += weight;
        }
    }
    m
}
