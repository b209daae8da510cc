//! M step of a skewed Student's t distribution: scales in closed form, then the location by a
//! quadratic bound, then the degrees of freedom.

use super::SkewedT;
use crate::EmissionError;
use crate::check::spread;
use crate::special::inverse_ln_minus_digamma;

/// Returns the distribution after a step that does not lower the expected log density of
/// observations and their precisions.
///
/// At the present location, with σ₁ = σ / γ and σ₂ = σ γ, this is
/// −ln(σ₁ + σ₂) − A₁ / 2σ₁² − A₂ / 2σ₂² up to constants, where A₁ and A₂ are the means of
/// u (y − μ)² on either side. Its maximum has (σ₂ / σ₁)³ = A₂ / A₁ and σ₁² = A₁ (1 + σ₂ / σ₁). The
/// location then moves to the maximum of a quadratic lower bound, in which observations that it may
/// pass have the curvature of the steeper side.
pub(super) fn maximize(from: &SkewedT, sums: &[f64; 9]) -> Result<SkewedT, EmissionError> {
    let weight = sums[0];
    let [_, low_u, low_z, low_square, high_u, high_z, high_square, excess, _] =
        sums.map(|sum| sum / weight);
    // The weighted variance about the weighted mean must be more than rounding.
    let square = low_square + high_square;
    let mean = (low_z + high_z) / (low_u + high_u);
    spread("scale", weight, square - mean * (low_z + high_z), square)?;
    // In units of the present σ. Observations all on one side say nothing about the other side
    // until the location has moved.
    let [low, high] = if low_square > 0.0 && high_square > 0.0 {
        let ratio = (high_square / low_square).cbrt();
        let low = (low_square * (1.0 + ratio)).sqrt();
        [low, low * ratio]
    } else {
        [from.skewness.recip(), from.skewness]
    };
    let (steepest, of_low, of_high) = (low.min(high).powi(-2), low.powi(-2), high.powi(-2));
    // Derivative of the expected log density at μ, and a bound of its curvature. A move up passes
    // only observations above the location, which then have the curvature of the lower side: they
    // count with the steeper of the two, the others with their own. A move down likewise.
    let pull = low_z * of_low + high_z * of_high;
    let curvature = if pull > 0.0 {
        low_u * of_low + high_u * steepest
    } else {
        low_u * steepest + high_u * of_high
    };
    let location = from.location + from.scale * (pull / curvature);
    // ln(ν/2) − ψ(ν/2) = mean of E[u − 1 − ln u], as for `StudentT`.
    let degrees = 2.0 * inverse_ln_minus_digamma(excess, 0.5 * from.degrees);
    let scale = from.scale * (low.sqrt() * high.sqrt());
    SkewedT::new(location, scale, (high / low).sqrt(), degrees).map_err(|error| match error {
        EmissionError::Parameter { what, state, component, .. } => {
            let reason = "their likelihood is unbounded; give a prior";
            EmissionError::TooFew { state, component, what, weight, reason }
        }
        other => other,
    })
}
