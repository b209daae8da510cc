//! Distance across the road from a place to a position: a measurement of the receiver's error in
//! one direction.
//!
//! With n the unit vector across, the distance z = n · o + w measures the error o with white noise
//! w (see [`sighting`](super::sighting)). The Kalman update has the gain C n / v with v = n'C n +
//! var w, and the density of z is Gaussian with variance v; both are kept for each reception.

use super::place::{ByReception, Place};
use super::receiver::{RECEPTIONS, Receiver};
use super::sighting::Sighting;

/// Distance across from a place to a position, by reception.
pub(super) struct Across {
    /// Innovation in metres: the distance less its prediction.
    pub(super) off: ByReception,
    /// 1 / v, the precision of the innovation.
    pub(super) each: ByReception,
    /// C n: covariances with the error to the east and to the north.
    pub(super) with: [ByReception; 2],
    /// Half the square of the innovation in standard deviations.
    pub(super) squares: ByReception,
}

impl Across {
    #[inline]
    pub(super) fn new(place: &Place, sighting: &Sighting, receiver: &Receiver) -> Self {
        let ([a, b], zero) = (sighting.normal, [0.0; RECEPTIONS]);
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (&place.mean, &place.covariance);
        let mut across = Self { off: zero, each: zero, with: [zero; 2], squares: zero };
        for r in 0..RECEPTIONS {
            // Rounding may leave n'C n slightly negative; white noise keeps v above 0.
            let (east, north) = (a * xx[r] + b * xy[r], a * xy[r] + b * yy[r]);
            let each = 1.0 / ((a * east + b * north).max(0.0) + receiver.white[r]);
            let off = sighting.across - (a * x[r] + b * y[r]);
            (across.off[r], across.each[r]) = (off, each);
            (across.with[0][r], across.with[1][r]) = (east, north);
            across.squares[r] = 0.5 * off * off * each;
        }
        across
    }

    /// Probabilities of the kinds of reception given the position, and the density of its distance
    /// across; `powers` are the exponentials of the negated squares. If the density underflows, it
    /// is 0 and the probabilities are those before.
    #[inline]
    pub(super) fn shares(&self, place: &Place, powers: &[f64]) -> (ByReception, f64) {
        let (mut weights, mut total) = (place.shares, 0.0);
        for r in 0..RECEPTIONS {
            // Bayes' rule over the receptions: each predicts the distance with its own Gaussian.
            weights[r] *= powers[r] * self.each[r].sqrt();
            total += weights[r];
        }
        if total < f64::MIN_POSITIVE {
            return (place.shares, 0.0);
        }
        (weights.map(|weight| weight / total), total / std::f64::consts::TAU.sqrt())
    }

    /// The same in logarithms, for a density that underflows: a position may be a thousand standard
    /// deviations off.
    #[cold]
    pub(super) fn log_shares(&self, place: &Place) -> (ByReception, f64) {
        let mut logs = [0.0; RECEPTIONS];
        for (r, log) in logs.iter_mut().enumerate() {
            *log = place.shares[r].ln() + 0.5 * self.each[r].ln() - self.squares[r];
        }
        // log-sum-exp: the largest term is 1, so the total is from 1 to the number of receptions.
        let most = logs.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let weights = logs.map(|log| (log - most).exp());
        let total: f64 = weights.iter().sum();
        let log_density = most + (total / std::f64::consts::TAU.sqrt()).ln();
        (weights.map(|weight| weight / total), log_density)
    }

    /// Kalman update of a place by the distance.
    #[inline]
    pub(super) fn learn(&self, place: &mut Place, [a, b]: [f64; 2]) {
        let Place { mean: [along, x, y], covariance: [aa, ax, ay, xx, xy, yy], .. } = place;
        for r in 0..RECEPTIONS {
            let (each, off) = (self.each[r], self.off[r]);
            let [u, v] = [self.with[0][r], self.with[1][r]];
            // Rows of P n: w for the place along, u and v for the error. Means move by P n z / v,
            // and covariances fall by (P n)(P n)' / v.
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
