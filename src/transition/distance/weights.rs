//! What odometry says of the ways out of a place.

use crate::transition::Odometry;

/// An entry of a column.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub(super) to: u32,
    pub(crate) length: f64,
    /// ln of the entry of the base.
    pub(super) log: f64,
}

/// What moves of a column weigh, 1 at most and for one of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    odometry: Odometry,
    /// The length nearest to the distance.
    nearest: f64,
    /// The largest logarithm, which is taken out of all.
    top: f64,
}

impl Weights {
    pub(super) fn new(ways: &[Way], odometry: Odometry) -> Self {
        let lengths = ways.iter().map(|way| way.length);
        let nearest = lengths.reduce(|a, b| if excess(odometry, b, a) < 0.0 { b } else { a });
        let weights = Self { odometry, nearest: nearest.unwrap_or(0.0), top: 0.0 };
        let top = ways.iter().map(|way| weights.log(way)).fold(f64::NEG_INFINITY, f64::max);
        Self { top, ..weights }
    }

    fn log(&self, way: &Way) -> f64 {
        way.log - excess(self.odometry, way.length, self.nearest)
    }

    /// What a move weighs.
    pub(super) fn of(&self, way: &Way) -> f64 {
        (self.log(way) - self.top).exp()
    }
}

/// [(d − L)² − (d − N)²] / 2 s², from the factors L − N and (L + N) / 2 − d: a
/// difference of large squares keeps its digits, and with a variance of 0 there
/// is no 0 / 0. Rounding may make it 0, but does not change its sign: none comes
/// out nearer than the nearest.
fn excess(odometry: Odometry, length: f64, other: f64) -> f64 {
    let gap = length - other;
    // A half of the factor, which does not overflow.
    let off = 0.25 * length + 0.25 * other - 0.5 * odometry.distance;
    if gap == 0.0 || off == 0.0 { 0.0 } else { 2.0 * (gap / odometry.variance) * off }
}

/// The probability of a weight, where all sum to `sum`.
pub(super) fn share(weight: f64, sum: f64) -> f64 {
    let p = weight / sum;
    if p >= f64::MIN_POSITIVE { p } else { 0.0 }
}
