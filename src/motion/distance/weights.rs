//! Likelihood of a distance for the moves of a map.

use std::f64::consts::{LOG2_E, PI};

use super::OdometryReading;
use crate::kernels;
use crate::limits::LARGEST_LOG;

/// An entry of a column, with its length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub(super) to: u32,
    pub(crate) length: f64,
    /// The entry of the base.
    pub(super) p: f64,
    pub(super) log2: f64,
}

/// Densities of a distance, relative to that at the nearest of all lengths.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    odometry: OdometryReading,
    nearest: f64,
}

impl Weights {
    pub(super) fn new(nearest: f64, odometry: OdometryReading) -> Self {
        Self { odometry, nearest }
    }

    /// The logarithm of the density at the nearest length.
    pub(super) fn log_factor(&self) -> f64 {
        let OdometryReading { distance, variance } = self.odometry;
        // Halves, whose difference does not overflow.
        let off = (0.5 * distance - 0.5 * self.nearest) / variance.sqrt();
        -0.5 * ((2.0 * PI).ln() + variance.ln()) - 2.0 * off * off
    }

    /// Log-weight of a move, at most 0.
    pub(super) fn log(&self, way: &Way) -> f64 {
        self.log_at(way.length)
    }

    /// Log-weight of a length, least at the shortest or the longest; −∞ below the range of valid
    /// logarithms.
    pub(super) fn log_at(&self, length: f64) -> f64 {
        let log = (-excess(self.odometry, length, self.nearest)).min(0.0);
        if log >= -LARGEST_LOG { log } else { f64::NEG_INFINITY }
    }

    /// Entry of a move; 0 below the smallest normal double.
    pub(super) fn of(&self, way: &Way) -> f64 {
        let p = way.p * self.log(way).exp();
        if p >= f64::MIN_POSITIVE { p } else { 0.0 }
    }

    /// log2 of the entry of a move, of any size.
    pub(super) fn log2(&self, way: &Way) -> f64 {
        way.log2 + kernels::on_grid(self.log(way) * LOG2_E)
    }
}

/// [(d − L)² − (d − N)²] / 2 s², from the factors L − N and (L + N) / 2 − d: a
/// difference of large squares keeps its digits.
fn excess(odometry: OdometryReading, length: f64, nearest: f64) -> f64 {
    let gap = length - nearest;
    // Half of the factor, which does not overflow.
    let off = 0.25 * length + 0.25 * nearest - 0.5 * odometry.distance;
    if gap == 0.0 || off == 0.0 { 0.0 } else { 2.0 * (gap / odometry.variance) * off }
}

/// The nearest of sorted lengths to a distance.
pub(super) fn nearest(lengths: &[f64], distance: f64) -> f64 {
    let above = lengths.partition_point(|length| *length < distance);
    let near = lengths[above.saturating_sub(1)..].iter().take(2).copied();
    let far = |length: f64| (0.5 * length - 0.5 * distance).abs();
    near.fold(f64::INFINITY, |best, length| if far(length) < far(best) { length } else { best })
}
