//! Rows of distances of several kinds, and their scores by definition.

use proptest::collection::vec;
use proptest::prelude::*;

pub(super) const INF: f32 = f32::INFINITY;

/// The upper median.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Scores within a row: differences from the median, in median deviations; beyond three
/// logarithmic, up to 1000.
pub(super) fn within(row: &[f32]) -> Vec<f64> {
    let finite: Vec<f64> = row.iter().filter(|d| d.is_finite()).map(|d| f64::from(*d)).collect();
    if finite.is_empty() {
        return vec![f64::INFINITY; row.len()];
    }
    let centre = median(finite.clone());
    // Differences are in 32 bits.
    let most = f64::from(f32::MAX);
    let apart: Vec<f64> = finite.iter().map(|d| (d - centre).abs().min(most)).collect();
    let others: Vec<f64> = apart.iter().copied().filter(|d| *d > 0.0).collect();
    let unit = match 1.4826 * median(apart) {
        unit if unit > 0.0 => unit,
        _ if others.is_empty() => f64::INFINITY,
        _ => median(others),
    };
    let score = |d: &f32| {
        let score = (f64::from(*d) - centre) / unit;
        let size = score.abs().min(1000.0);
        let bent = if size > 3.0 { 3.0 + (size - 2.0).ln() } else { size };
        if *d == INF { f64::INFINITY } else { bent.copysign(score) }
    };
    row.iter().map(score).collect()
}

/// Distances of one row, of several kinds, including infinite ones.
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
