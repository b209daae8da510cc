//! Exponentials of rate matrices in double-double arithmetic.

use std::ops::{Add, Mul};

use super::{Matrix, matrix};

/// An unevaluated sum of two doubles (Dekker 1971).
#[derive(Debug, Clone, Copy)]
struct Long(f64, f64);

/// a + b, with its rounding error.
fn two_sum(a: f64, b: f64) -> Long {
    let sum = a + b;
    let part = sum - a;
    Long(sum, (a - (sum - part)) + (b - part))
}

impl Add for Long {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (high, low) = (two_sum(self.0, other.0), two_sum(self.1, other.1));
        let first = two_sum(high.0, high.1 + low.0);
        two_sum(first.0, first.1 + low.1)
    }
}

impl Mul for Long {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let product = self.0 * other.0;
        let error = self.0.mul_add(other.0, -product);
        two_sum(product, error + (self.0 * other.1 + self.1 * other.0))
    }
}

type LongMatrix = Vec<Vec<Long>>;

fn each(n: usize, entry: impl Fn(usize, usize) -> Long) -> LongMatrix {
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

fn times(a: &LongMatrix, b: &LongMatrix) -> LongMatrix {
    let sum = |i: usize, j: usize| (0..a.len()).map(move |k| a[i][k] * b[k][j]);
    each(a.len(), |i, j| sum(i, j).fold(Long(0.0, 0.0), Long::add))
}

/// exp(Q t), from the rates of moves `rates[to][from]`, by a Taylor series of a short time and
/// repeated squaring: 30 digits, less those lost in the squarings.
pub fn exponential(rates: &Matrix, t: f64) -> Matrix {
    let n = rates.len();
    let exit = |j: usize| {
        let others = (0..n).filter(|i| *i != j).map(|i| Long(rates[i][j], 0.0));
        others.fold(Long(0.0, 0.0), Long::add)
    };
    let largest = (0..n).map(|j| exit(j).0).fold(0.0, f64::max) * t;
    let halvings = (largest.log2() + 4.0).ceil().max(0.0);
    let short = Long(t * (-halvings).exp2(), 0.0);
    let entry = |i: usize, j: usize| {
        if i == j { exit(j) * Long(-1.0, 0.0) } else { Long(rates[i][j], 0.0) }
    };
    let q = each(n, |i, j| entry(i, j) * short);
    // 1 + q (1 + q / 2 (1 + q / 3 (…))).
    let one = |i: usize, j: usize| Long(f64::from(i == j), 0.0);
    let mut sum = each(n, one);
    for k in (1..40).rev() {
        let inverse = Long(1.0, 0.0) * inverse(f64::from(k));
        let product = times(&q, &sum);
        sum = each(n, |i, j| one(i, j) + product[i][j] * inverse);
    }
    for _ in 0..halvings as i32 {
        sum = times(&sum, &sum);
    }
    matrix(n, |i, j| sum[i][j].0)
}

fn inverse(x: f64) -> Long {
    let first = 1.0 / x;
    let rest = (-first).mul_add(x, 1.0) / x;
    two_sum(first, rest)
}
