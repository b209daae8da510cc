//! Proper scores of probabilities: in the long run, the true probabilities score best.

use super::check_probabilities;
use crate::error::OutOfRange;

/// Brier score: the mean of (p − o)², where p is the probability of an event and o is 1 if it
/// happened, else 0. From 0 to 1, lower is better. O(N).
///
/// This is the usual form for two outcomes, half of Brier's own (1950), which sums over both. A
/// probability may exceed 1 by 1e-9, as the sum of a belief may.
///
/// ```
/// use wayfix::evaluate;
///
/// assert_eq!(evaluate::brier_score(&[(0.5, true), (0.75, true), (0.25, false)])?, 0.125);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if `forecasts` is empty, or a probability is NaN or not from 0 to 1.
pub fn brier_score(forecasts: &[(f64, bool)]) -> Result<f64, OutOfRange> {
    mean(forecasts, |forecast| forecast.0, |(p, happened)| (p - f64::from(happened)).powi(2))
}

/// Log score of probabilities for two outcomes: the mean of ln p for events that happened and ln(1
/// − p) for others. At most 0, up to rounding; higher is better (Good, 1952). O(N).
///
/// It is −∞ if an outcome was ruled out even once: a probability of 0 for an event that happened,
/// or of 1 for one that did not. That is the correct value, not an error. A probability may exceed
/// 1 by 1e-9, as the sum of a belief may.
///
/// ```
/// use wayfix::evaluate;
///
/// let score = evaluate::binary_log_score(&[(0.5, true), (0.75, false)])?;
/// assert!((score - 0.125_f64.ln() / 2.0).abs() < 1e-15);
/// assert_eq!(evaluate::binary_log_score(&[(0.5, true), (1.0, false)])?, f64::NEG_INFINITY);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if `forecasts` is empty, or a probability is NaN or not from 0 to 1.
pub fn binary_log_score(forecasts: &[(f64, bool)]) -> Result<f64, OutOfRange> {
    mean(
        forecasts,
        |forecast| forecast.0,
        |(p, happened)| match happened {
            true => p.ln(),
            // Only below 1: a p that rounding took above 1 has no logarithm of 1 − p.
            false if p < 1.0 => (-p).ln_1p(),
            false => f64::NEG_INFINITY,
        },
    )
}

/// Log score of beliefs: the mean logarithm of the mass that each gave to the true places. At most
/// 0, up to rounding; higher is better (Good, 1952). O(N).
///
/// It is −∞ if a mass is 0, from a belief that ruled out the truth. That is the correct value, not
/// an error. A mass may exceed 1 by 1e-9, as the sum of a belief may.
///
/// ```
/// use wayfix::{Belief, evaluate};
///
/// let beliefs = [Belief::new(vec![0.5, 0.25, 0.25])?, Belief::new(vec![0.0, 0.5, 0.5])?];
/// let truth = [0..=1, 2..=2];
/// let masses = beliefs.iter().zip(truth).map(|(belief, places)| belief.mass(places));
/// let score = evaluate::log_score(&masses.collect::<Result<Vec<_>, _>>()?)?;
/// assert!((score - 0.375_f64.ln() / 2.0).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if `masses` is empty, or one is NaN or not from 0 to 1.
pub fn log_score(masses: &[f64]) -> Result<f64, OutOfRange> {
    mean(masses, |p| p, f64::ln)
}

fn mean<T: Copy>(
    samples: &[T],
    probability: impl Fn(T) -> f64,
    score: impl Fn(T) -> f64,
) -> Result<f64, OutOfRange> {
    if samples.is_empty() {
        return Err(OutOfRange::none("the number of probabilities"));
    }
    check_probabilities("probability", samples.iter().copied().map(probability))?;
    // The sum starts at 0, since an empty sum is −0: a perfect score is then 0.
    let sum = samples.iter().fold(0.0, |sum, &sample| sum + score(sample));
    Ok(sum / samples.len() as f64)
}
