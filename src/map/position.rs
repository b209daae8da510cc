//! Positions of places, on Earth and in a plane, and the projection that geometry is done in.
//!
//! All geometry of lines runs in a conformal plane: Mercator's projection for the Earth, where
//! lengths are the plane's times the scale at a latitude. Distances between places are great-circle
//! distances.

use std::fmt::Debug;

/// Mean radius of the Earth in metres (IUGG).
const EARTH_RADIUS: f64 = 6_371_008.8;

/// Coordinates of places: [on Earth](Position), or [in a plane](PlanePosition). Sealed: only
/// these two types implement it.
pub trait Coordinates: Copy + PartialEq + Debug + Send + Sync + Axes {
    /// Straight-line distance in metres; NaN if a coordinate is NaN.
    #[must_use]
    fn metres_to(self, other: Self) -> f64;
}

/// Two named numbers with valid ranges, and their projection to a plane.
pub trait Axes: Sized {
    /// Name and largest magnitude of each number.
    const AXES: [(&'static str, f64); 2];
    /// Unit of both numbers.
    const UNIT: &'static str;
    /// True if a road that has no length in a file gets that of the straight line.
    #[cfg(feature = "csv")]
    const MAY_BE_STRAIGHT: bool;
    /// Creates a position from the numbers, in the order of the axes.
    fn from_values(values: [f64; 2]) -> Self;
    /// Returns the numbers, in the order of the axes.
    fn values(self) -> [f64; 2];
    /// Projects conformally to a plane, with x to the east and y to the north. For the Earth the
    /// plane is an unrolled cylinder: lines continue beyond the antimeridian, where
    /// [`wrapped`](Self::wrapped) brings points together.
    fn to_plane(self) -> [f64; 2];
    /// Position of a point in the plane.
    fn from_plane(point: [f64; 2]) -> Self;
    /// Metres on the ground per unit of the plane, near a point.
    fn scale(point: [f64; 2]) -> f64;
    /// Point in space, in metres: straight distances there are at most those on the ground.
    fn in_space(self) -> [f64; 3];
    /// Period of each number; infinite if it has none.
    const PERIODS: [f64; 2];
    /// Period of the plane along x; infinite if it has none.
    const X_PERIOD: f64;

    /// Returns a point of the plane, moved by whole periods to within half a period of another. A
    /// point that is near enough is returned unchanged, to the bit.
    fn wrapped(point: [f64; 2], near: [f64; 2]) -> [f64; 2] {
        [wrapped(point[0], near[0], Self::X_PERIOD), point[1]]
    }

    /// Projects a line; each point is moved to within half a period of the previous one.
    fn unwrap(line: impl IntoIterator<Item = Self>) -> impl Iterator<Item = [f64; 2]> {
        // The first point stays where it is; each later point is near the previous one, so that no
        // piece of a line spans the plane.
        let mut before = None;
        line.into_iter().map(move |position| {
            let point = position.to_plane();
            *before.insert(Self::wrapped(point, before.unwrap_or(point)))
        })
    }
}

/// Returns a periodic value, shifted to within half a period of another number.
#[must_use]
pub fn wrapped(value: f64, near: f64, period: f64) -> f64 {
    let off = value - near;
    // False for NaN and for an infinite period.
    if off.abs() > 0.5 * period { value - period * (off / period).round() } else { value }
}

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
    /// Degrees north of the equator, −90 to 90.
    pub latitude: f64,
    /// Degrees east of Greenwich, −180 to 180.
    pub longitude: f64,
}

impl Position {
    /// Great-circle distance in metres, on a sphere of the Earth's mean radius (haversine
    /// formula): within 0.6% of the ellipsoid's.
    #[must_use]
    pub fn metres_to(self, other: Self) -> f64 {
        let (a, b) = (self.latitude.to_radians(), other.latitude.to_radians());
        let half_sine = |x: f64| (x / 2.0).sin().powi(2);
        let longitudes = (other.longitude - self.longitude).to_radians();
        // Haversines keep their digits for near places, where a formula by the cosine of the
        // distance loses them.
        let h = half_sine(b - a) + a.cos() * b.cos() * half_sine(longitudes);
        let h = if h > 1.0 { 1.0 } else { h }; // rounding; NaN stays
        2.0 * EARTH_RADIUS * h.sqrt().asin()
    }
}

impl Coordinates for Position {
    fn metres_to(self, other: Self) -> f64 {
        self.metres_to(other)
    }
}

impl Axes for Position {
    const AXES: [(&'static str, f64); 2] = [("latitude", 90.0), ("longitude", 180.0)];
    const UNIT: &'static str = "degrees";
    const PERIODS: [f64; 2] = [f64::INFINITY, 360.0];
    const X_PERIOD: f64 = std::f64::consts::TAU * EARTH_RADIUS;
    #[cfg(feature = "csv")]
    const MAY_BE_STRAIGHT: bool = false;

    fn from_values([latitude, longitude]: [f64; 2]) -> Self {
        Self { latitude, longitude }
    }

    fn values(self) -> [f64; 2] {
        [self.latitude, self.longitude]
    }

    /// Mercator's projection of the sphere.
    fn to_plane(self) -> [f64; 2] {
        let [latitude, longitude] = self.values().map(f64::to_radians);
        [EARTH_RADIUS * longitude, EARTH_RADIUS * latitude.tan().asinh()]
    }

    fn from_plane([x, y]: [f64; 2]) -> Self {
        let latitude = (y / EARTH_RADIUS).sinh().atan().to_degrees();
        // Beyond the antimeridian, longitudes continue from its other side.
        Self { latitude, longitude: wrapped((x / EARTH_RADIUS).to_degrees(), 0.0, 360.0) }
    }

    fn scale([_, y]: [f64; 2]) -> f64 {
        // The cosine of the latitude, by the Gudermannian function: 1 / cosh(y / R).
        1.0 / (y / EARTH_RADIUS).cosh()
    }

    fn in_space(self) -> [f64; 3] {
        let [latitude, longitude] = self.values().map(f64::to_radians);
        let [x, y] = [longitude.cos(), longitude.sin()].map(|x| EARTH_RADIUS * latitude.cos() * x);
        [x, y, EARTH_RADIUS * latitude.sin()]
    }
}

/// A position in a plane, in metres from any origin: in a warehouse, a yard, or a projected map
/// (UTM).
///
/// ```
/// use wayfix::map::PlanePosition;
///
/// let dock = PlanePosition { x: 0.0, y: 0.0 };
/// let shelf = PlanePosition { x: 30.0, y: 40.0 };
/// assert_eq!(dock.metres_to(shelf), 50.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePosition {
    /// Coordinate along the first axis, at most 1e9 in magnitude.
    pub x: f64,
    /// Coordinate along the second axis, at most 1e9 in magnitude.
    pub y: f64,
}

impl PlanePosition {
    /// Euclidean distance in metres.
    #[must_use]
    pub fn metres_to(self, other: Self) -> f64 {
        (other.x - self.x).hypot(other.y - self.y)
    }
}

impl Coordinates for PlanePosition {
    fn metres_to(self, other: Self) -> f64 {
        self.metres_to(other)
    }
}

impl Axes for PlanePosition {
    const AXES: [(&'static str, f64); 2] = [("x", 1e9), ("y", 1e9)];
    const UNIT: &'static str = "metres";
    const PERIODS: [f64; 2] = [f64::INFINITY; 2];
    const X_PERIOD: f64 = f64::INFINITY;
    #[cfg(feature = "csv")]
    const MAY_BE_STRAIGHT: bool = true;

    fn from_values([x, y]: [f64; 2]) -> Self {
        Self { x, y }
    }

    fn values(self) -> [f64; 2] {
        [self.x, self.y]
    }

    fn to_plane(self) -> [f64; 2] {
        self.values()
    }

    fn from_plane([x, y]: [f64; 2]) -> Self {
        Self { x, y }
    }

    fn scale(_: [f64; 2]) -> f64 {
        1.0
    }

    fn in_space(self) -> [f64; 3] {
        [self.x, self.y, 0.0]
    }
}
