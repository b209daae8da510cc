//! Rows of distances of several kinds, and their moments by definition.

use proptest::collection::vec;
use proptest::prelude::*;

pub(super) const INF: f32 = f32::INFINITY;

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(super) fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: Vec<f64> = values.iter().map(|v| (v - mean).powi(2)).collect();
    squares.iter().sum::<f64>().sqrt() / (values.len() as f64).sqrt()
}

/// Distances of one row, of several kinds; infinite ones among them.
pub(super) fn row(n: usize) -> impl Strategy<Value = Vec<f32>> {
    let wild = (-38..38_i32, -9.9_f32..9.9).prop_map(|(e, m)| m * 10_f32.powi(e));
    let kind = prop_oneof![
        3 => vec(0.0_f32..1.0, n),
        2 => vec((0..3_u8).prop_map(f32::from), n),
        1 => (-1e6_f32..1e6).prop_map(move |d| vec![d; n]),
        1 => vec((0.0_f32..1.0).prop_map(|d| 1e3 + d), n),
        1 => vec(-1.0_f32..0.0, n),
        1 => vec(wild, n),
        // A few that stand out among equal ones.
        1 => vec(prop_oneof![5 => Just(0.1_f32), 1 => Just(0.7), 1 => Just(1e4)], n),
        1 => vec(prop_oneof![Just(f32::MAX), Just(f32::MIN), Just(1e-45_f32), Just(0.0)], n),
    ];
    let holes = prop_oneof![
        3 => Just(vec![false; n]),
        1 => vec(prop::bool::weighted(0.3), n),
    ];
    (kind, holes, 0..n).prop_map(|(mut row, holes, kept)| {
        for (i, hole) in holes.iter().enumerate() {
            if *hole && i != kept {
                row[i] = INF;
            }
        }
        row
    })
}
