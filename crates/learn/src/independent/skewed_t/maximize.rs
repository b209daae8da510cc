//! The M step of a skewed Student's t distribution.

use super::SkewedT;
use crate::EmissionError;
use crate::check::spread;
use crate::special::inverse_ln_minus_digamma;

/// Returns the distribution after a step that does not lower the expected log density of
/// observations and their precisions.
///
/// That is, at this location and with σ₁ = σ / γ and σ₂ = σ γ, up to constants
/// −ln(σ₁ + σ₂) − A₁ / 2σ₁² − A₂ / 2σ₂², where the A are the means of u (y − μ)² on either side; its
/// maximum has (σ₂ / σ₁)³ = A₂ / A₁ and σ₁² = A₁ (1 + σ₂ / σ₁). The location then takes a step to the
/// maximum of a quadratic bound, in which observations that it may pass are as steep as on the
/// steeper side.
pub(super) fn maximize(from: &SkewedT, sums: &[f64; 9]) -> Result<SkewedT, EmissionError> {
    let weight = sums[0];
    let [_, low_u, low_z, low_square, high_u, high_z, high_square, excess, _] =
        sums.map(|sum| sum / weight);
    let square = low_square + high_square;
    let mean = (low_z + high_z) / (low_u + high_u);
    spread("scale", weight, square - mean * (low_z + high_z), square)?;
    // All on one side say nothing of the other, before the location has moved.
    let [low, high] = if low_square > 0.0 && high_square > 0.0 {
        let ratio = (high_square / low_square).cbrt();
        let low = (low_square * (1.0 + ratio)).sqrt();
        [low, low * ratio]
    } else {
        [from.skewness.recip(), from.skewness]
    };
    let (steepest, of_low, of_high) = (low.min(high).powi(-2), low.powi(-2), high.powi(-2));
    let pull = low_z * of_low + high_z * of_high;
    let curvature = if pull > 0.0 {
        low_u * of_low + high_u * steepest
    } else {
        low_u * steepest + high_u * of_high
    };
    let location = from.location + from.scale * (pull / curvature);
    let degrees = 2.0 * inverse_ln_minus_digamma(excess, 0.5 * from.degrees);
    let scale = from.scale * (low.sqrt() * high.sqrt());
    SkewedT::new(location, scale, (high / low).sqrt(), degrees).map_err(|error| match error {
        EmissionError::Parameter { what, state, component, .. } => {
            let reason = "its likelihood grows without end; give a prior";
            EmissionError::TooFew { state, component, what, weight, reason }
        }
        other => other,
    })
}
