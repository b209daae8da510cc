//! The distance across of a position from a place: a measurement of the error in one direction.

use super::place::{ByReception, Place};
use super::receiver::{RECEPTIONS, Receiver};
use super::sighting::Sighting;

/// Distance across of a position from a place, by reception.
pub(super) struct Across {
    /// Metres that it is off.
    pub(super) off: ByReception,
    /// 1 / variance.
    pub(super) each: ByReception,
    /// Covariances with the error to the east and to the north.
    pub(super) with: [ByReception; 2],
    /// Half the square of the deviations that it is off.
    pub(super) squares: ByReception,
}

impl Across {
    #[inline]
    pub(super) fn new(place: &Place, sighting: &Sighting, receiver: &Receiver) -> Self {
        let ([a, b], zero) = (sighting.normal, [0.0; RECEPTIONS]);
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (&place.mean, &place.covariance);
        let mut across = Self { off: zero, each: zero, with: [zero; 2], squares: zero };
        for r in 0..RECEPTIONS {
            let (east, north) = (a * xx[r] + b * xy[r], a * xy[r] + b * yy[r]);
            let each = 1.0 / ((a * east + b * north).max(0.0) + receiver.white[r]);
            let off = sighting.across - (a * x[r] + b * y[r]);
            (across.off[r], across.each[r]) = (off, each);
            (across.with[0][r], across.with[1][r]) = (east, north);
            across.squares[r] = 0.5 * off * off * each;
        }
        across
    }

    /// Probabilities of the receptions after the position, and the density of its distance across,
    /// by the exponentials of the squares. If the density is too small for a double, it is 0, and
    /// the probabilities mean nothing.
    #[inline]
    pub(super) fn shares(&self, place: &Place, powers: &[f64]) -> (ByReception, f64) {
        let (mut weights, mut total) = (place.shares, 0.0);
        for r in 0..RECEPTIONS {
            weights[r] *= powers[r] * self.each[r].sqrt();
            total += weights[r];
        }
        if total < f64::MIN_POSITIVE {
            return (place.shares, 0.0);
        }
        (weights.map(|weight| weight / total), total / std::f64::consts::TAU.sqrt())
    }

    /// The same with the logarithm of the density, which may be any: a position may be a thousand
    /// deviations off.
    #[cold]
    pub(super) fn log_shares(&self, place: &Place) -> (ByReception, f64) {
        let mut logs = [0.0; RECEPTIONS];
        for (r, log) in logs.iter_mut().enumerate() {
            *log = place.shares[r].ln() + 0.5 * self.each[r].ln() - self.squares[r];
        }
        let most = logs.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let weights = logs.map(|log| (log - most).exp());
        let total: f64 = weights.iter().sum();
        let log_density = most + (total / std::f64::consts::TAU.sqrt()).ln();
        (weights.map(|weight| weight / total), log_density)
    }

    /// Updates a place.
    #[inline]
    pub(super) fn learn(&self, place: &mut Place, [a, b]: [f64; 2]) {
        let Place { mean: [along, x, y], covariance: [aa, ax, ay, xx, xy, yy], .. } = place;
        for r in 0..RECEPTIONS {
            let (each, off) = (self.each[r], self.off[r]);
            let [u, v] = [self.with[0][r], self.with[1][r]];
            let w = a * ax[r] + b * ay[r];
            let by = off * each;
            (along[r], x[r], y[r]) = (along[r] + w * by, x[r] + u * by, y[r] + v * by);
            aa[r] -= w * w * each;
            (ax[r], ay[r]) = (ax[r] - w * u * each, ay[r] - w * v * each);
            (xx[r], xy[r], yy[r]) =
                (xx[r] - u * u * each, xy[r] - u * v * each, yy[r] - v * v * each);
        }
    }
}
