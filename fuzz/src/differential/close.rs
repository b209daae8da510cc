//! Comparisons up to rounding.

/// Relative tolerance of a probability.
const PROBABILITY: f64 = 1e-10;
/// Probabilities below this need not have any digits.
const LEAST: f64 = 1e-290;
/// Tolerance of a logarithm, relative to the terms that it is a sum of.
const LOGARITHM: f64 = 1e-12;

/// Compares a distribution with its logarithms.
pub(crate) fn belief(what: &str, step: usize, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}, step {step}");
    for (state, (&found, &log)) in found.iter().zip(expected).enumerate() {
        let expected = log.exp();
        assert!(
            (found - expected).abs() <= PROBABILITY * expected + LEAST,
            "{what}, step {step}, state {state}: {found:e}, expected {expected:e}"
        );
    }
}

/// Compares logarithms that are sums of terms of this total size.
pub(crate) fn log(what: &str, found: f64, expected: f64, size: f64) {
    let equal =
        found == expected || (found - expected).abs() <= LOGARITHM * size.max(expected.abs());
    assert!(equal, "{what}: {found}, expected {expected} (of numbers up to {size})");
}

/// Compares numbers of at least 0.
pub(crate) fn number(what: &str, found: f64, expected: f64, tolerance: f64) {
    let equal = (found - expected).abs() <= tolerance * expected.abs() + tolerance * 1e-6;
    assert!(equal, "{what}: {found:e}, expected {expected:e}");
}
