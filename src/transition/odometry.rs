//! How far the vehicle has driven in a step, by its own count.

/// What the wheels say of a step: a distance, with the variance of its error.
///
/// A variance of 0 is a distance without error.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Odometry {
    /// How far it has driven; finite.
    pub distance: f64,
    /// The variance of the distance; finite and at least 0.
    pub variance: f64,
}
