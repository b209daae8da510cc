//! Distance driven in a step, by odometry.

use crate::error::TransitionError;

/// Odometry reading of a step: a distance and the variance of its error, in the unit
/// of the lengths of a [`DistanceTransition`](crate::motion::DistanceTransition), such as metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OdometryReading {
    /// The distance driven; finite.
    pub distance: f64,
    /// The variance of the distance, in squared units; finite and above 0.
    pub variance: f64,
}

impl OdometryReading {
    /// Checks that the distance is finite, and the variance finite and above 0.
    pub(crate) fn check(&self) -> Result<(), TransitionError> {
        let Self { distance, variance } = self;
        if !distance.is_finite() {
            let text = format!("an odometry distance of {distance}, expected a finite value");
            return Err(TransitionError::Control(text));
        }
        if !(*variance > 0.0 && variance.is_finite()) {
            let text =
                format!("an odometry variance of {variance}, expected a finite value above 0");
            return Err(TransitionError::Control(text));
        }
        Ok(())
    }
}
