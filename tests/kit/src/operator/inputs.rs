//! Vectors that operators are applied to.

use rand::RngExt;

use super::super::{Matrix, NEVER, rng};

/// One value for each state: numbers, logarithms of a huge range, and whole scores, which tie.
#[derive(Debug, Clone)]
pub struct Inputs {
    pub numbers: Vec<f64>,
    pub logs: Vec<f64>,
    pub scores: Vec<f64>,
}

impl Inputs {
    /// Inputs for a matrix: random, but always the same ones.
    pub fn of(m: &Matrix) -> Self {
        Self::nth(0, m)
    }

    /// Other inputs for the same matrix.
    pub fn nth(k: u64, m: &Matrix) -> Self {
        let mix = |seed: u64, p: &f64| (seed ^ p.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let rng = &mut rng(m.iter().flatten().fold(k, |seed, p| mix(seed.rotate_left(29), p)));
        let n = m.len();
        let numbers =
            (0..n).map(|_| if rng.random_bool(0.25) { 0.0 } else { rng.random_range(0.0..1.0) });
        let numbers = numbers.collect();
        let logs = (0..n).map(|_| match rng.random_range(0..6) {
            0 => NEVER,
            1 => rng.random_range(-5000.0..0.0),
            2 => rng.random_range(-2000.0..2000.0),
            _ => rng.random_range(-3.0..0.0),
        });
        let logs = logs.collect();
        let scores = (0..n).map(|_| match rng.random_range(0..5) {
            0 => NEVER,
            _ => f64::from(rng.random_range(-2..3_i32)),
        });
        let scores = scores.collect();
        Self { numbers, logs, scores }
    }
}
