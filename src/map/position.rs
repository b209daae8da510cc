//! Where a place is.

/// The mean radius of the Earth in metres (IUGG).
const EARTH_RADIUS: f64 = 6_371_008.8;

/// A position on Earth, in degrees of WGS84.
///
/// ```
/// use wayfix::map::Position;
///
/// let civic = Position { latitude: -35.2784, longitude: 149.1293 };
/// let lake = Position { latitude: -35.2872, longitude: 149.1279 };
/// assert_eq!(civic.metres_to(lake).round(), 987.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// North of the equator, −90 to 90.
    pub latitude: f64,
    /// East of Greenwich, −180 to 180.
    pub longitude: f64,
}

impl Position {
    /// The great-circle distance in metres, on a sphere of the Earth's mean
    /// radius (haversine formula): within 0.6% of the ellipsoid's.
    #[must_use]
    pub fn metres_to(self, other: Self) -> f64 {
        let (a, b) = (self.latitude.to_radians(), other.latitude.to_radians());
        let half_sine = |x: f64| (x / 2.0).sin().powi(2);
        let longitudes = (other.longitude - self.longitude).to_radians();
        let h = half_sine(b - a) + a.cos() * b.cos() * half_sine(longitudes);
        let h = if h > 1.0 { 1.0 } else { h }; // rounding; NaN stays
        2.0 * EARTH_RADIUS * h.sqrt().asin()
    }
}
