//! Answers are compared before anything is timed.

use crate::Failure;

/// Relative tolerance of answers.
pub(crate) const TOLERANCE: f64 = 1e-9;

/// Largest error of numbers, relative to the expected ones.
pub(crate) fn of_numbers(found: &[f64], expected: &[f64]) -> f64 {
    let off = |(a, b): (&f64, &f64)| (a - b).abs() / b.abs();
    worst(found.len() == expected.len(), found.iter().zip(expected).map(off))
}

/// Largest error of distributions over n states, relative to the largest probability of each.
pub(crate) fn of_distributions(n: usize, found: &[f64], expected: &[f64]) -> f64 {
    let steps = found.chunks(n).zip(expected.chunks(n)).map(|(found, expected)| {
        let largest = expected.iter().copied().fold(0.0, f64::max);
        worst(true, found.iter().zip(expected).map(|(a, b)| (a - b).abs())) / largest
    });
    worst(found.len() == expected.len(), steps)
}

/// 0 for the same path, and infinity for another.
pub(crate) fn of_paths(found: &[usize], expected: &[usize]) -> f64 {
    if found == expected { 0.0 } else { f64::INFINITY }
}

/// Returns the difference, or an error if it exceeds the tolerance.
pub(crate) fn within(tolerance: f64, what: &str, difference: f64) -> Result<f64, Failure> {
    if difference <= tolerance {
        Ok(difference)
    } else {
        Err(format!("{what}: differs by {difference:e}, more than {tolerance:e}").into())
    }
}

/// The largest difference; infinite if one is NaN.
fn worst(same_size: bool, differences: impl Iterator<Item = f64>) -> f64 {
    let start = if same_size { 0.0 } else { f64::INFINITY };
    let counted = differences.map(|d| if d.is_nan() { f64::INFINITY } else { d });
    counted.fold(start, f64::max)
}
