//! A position as seen from an edge, and what it tells about a place there.
//!
//! A position is two measurements of the place along x and the error o: a distance across, n · o +
//! w, and a place along, x + t · o + w, where n and t are the unit vectors across and along and w
//! is white noise. That x lies on the edge is a third, whose likelihood is not Gaussian: the update
//! uses the first two derivatives of its logarithm.
//!
//! The first is a Kalman update (Kalman, 1960), kept for each reception by [`Across`]. Let C be the
//! covariance of o, c that of x and o, and v = n'C n + var w the variance of the distance across,
//! whose innovation is z metres; its density is Gaussian with variance v. Then o moves by C n z / v
//! and x by c'n z / v, a variance such as t'C t becomes t'C t − (t'C n)² / v, and that of x + t ·
//! o, var x + 2 c't + t'C t − (c'n + t'C n)² / v. [`Sighting::fit`] needs only these numbers, which
//! saves copying the place for every move into a state; [`Sighting::across`] updates all of it, for
//! the moves that count.

use super::receiver::{ByReception, EdgeEstimate, RECEPTIONS, Receiver};
use wayfix_kernels::exp_in_place;

/// A position as seen from an edge.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sighting {
    /// Unit vector across, from the road to the position.
    pub(super) normal: [f64; 2],
    /// Unit vector along; zero if unknown.
    pub(super) tangent: [f64; 2],
    /// Metres across, in the direction of `normal`.
    pub(super) across: f64,
    /// Metres along, on the edge extended straight beyond its ends.
    pub(super) along: f64,
    /// Length of the edge in metres.
    pub(super) length: f64,
    /// True if the position is beside the edge rather than beyond its ends.
    pub(super) is_beside: bool,
    /// Log density of the position as an outlier, weighted by the share of outliers, and its
    /// exponential.
    pub(super) log_outlier: f64,
    pub(super) outlier: f64,
}

/// Fit of a position to a place, and what follows about the place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Density of the position, whether it belongs to the road or is an outlier, divided by a
    /// factor whose logarithm is given.
    pub(super) density: f64,
    pub(super) log_factor: f64,
    /// Probability that it belongs to the road.
    pub(super) inlier: f64,
    /// Probabilities of the kinds of reception given the position.
    pub(super) shares: ByReception,
    /// Probability that the place along of a vehicle that moved is on the edge.
    pub(super) on_edge: f64,
    /// Metres that the position is ahead of the place.
    pub(super) ahead: Ahead,
}

/// Metres that a position is ahead of a place, by reception.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
    /// Probabilities of the kinds of reception.
    shares: ByReception,
    metres: ByReception,
    variances: ByReception,
}

/// Density below which a position is evaluated in logarithms.
const TINY: f64 = 1e-280;
/// Slope of the logistic function that is closest to the normal distribution function.
pub(super) const SLOPE: f64 = 1.702;
/// Argument of the logistic function beyond which the end of an edge cuts nothing off.
const FAR: f64 = 7.0;
/// Least variance along, in square metres; below that of any receiver.
const LEAST_VARIANCE: f64 = 1e-15;
/// Largest share of a variance that an update by the ends of an edge removes: its second derivative
/// comes from the logistic approximation.
const MOST_LEARNED: f64 = 0.9;

impl Sighting {
    /// Fit of the position to a place on an earlier edge, from whose start it is `starts` metres to
    /// the start of this edge.
    #[inline]
    pub(super) fn fit(&self, place: &EdgeEstimate, starts: f64, receiver: &Receiver) -> Fit {
        let across = Across::new(place, self, receiver);
        let ([a, b], [c, d]) = (self.normal, self.tangent);
        let ([along, x, y], [aa, ax, ay, xx, xy, yy]) = (&place.mean, &place.covariance);
        let [mut metres, mut variances, mut low, mut high] = [[0.0; RECEPTIONS]; 4];
        // Exponents of the density across and at both ends of the edge, each for three receptions,
        // padded to two whole vectors.
        let mut powers = [0.0; 16];
        for r in 0..RECEPTIONS {
            // Covariances with the distance across, as at the head of this file: t'C n of the error
            // along, and c'n of the place along.
            let with_error = c * across.covariances[0][r] + d * across.covariances[1][r];
            let with_place = a * ax[r] + b * ay[r];
            let precision = across.precision[r];
            let gain_times_innovation = across.innovation[r] * precision;
            let error = c * x[r] + d * y[r] + with_error * gain_times_innovation;
            let variance = c * c * xx[r] + 2.0 * c * d * xy[r] + d * d * yy[r];
            // `moved` is where a vehicle that moved would be, x = along − t · o given the distance
            // across; `metres` is how far that is from the previous place.
            let moved = self.along - error;
            let of_moved =
                (variance - with_error * with_error * precision).max(0.0) + receiver.white[r];
            metres[r] = moved - (along[r] - starts + with_place * gain_times_innovation);
            // Variance of x + t · o given the distance across, as at the head of this file.
            let covariance_along = with_error + with_place;
            let variance_ahead = aa[r] + 2.0 * (c * ax[r] + d * ay[r]) + variance
                - covariance_along * covariance_along * precision;
            variances[r] = variance_ahead.max(0.0) + receiver.white[r];
            // Arguments of the logistic function at both ends of the edge.
            let slope = SLOPE / of_moved.max(LEAST_VARIANCE).sqrt();
            (low[r], high[r]) = (-slope * moved, slope * (self.length - moved));
            powers[r] = -across.squares[r];
            powers[RECEPTIONS + r] = -low[r].abs();
            powers[2 * RECEPTIONS + r] = -high[r].abs();
        }
        exp_in_place(&mut powers);
        let (mut shares, density) = across.shares(place, &powers[..RECEPTIONS]);
        let (mut belongs, mut log_factor) = (receiver.inlier * density, 0.0);
        let mut density = belongs + self.outlier;
        // Near underflow `inlier` would lose its digits. So the larger of both parts is taken out
        // as the factor, and their sum is from 1 to 2.
        if density < TINY || belongs == 0.0 {
            let (of_position, log_across) = across.log_shares(place);
            let log_belongs = receiver.inlier.ln() + log_across;
            log_factor = log_belongs.max(self.log_outlier);
            belongs = (log_belongs - log_factor).exp();
            (shares, density) = (of_position, belongs + (self.log_outlier - log_factor).exp());
        }
        let mut on_edge = 0.0;
        for r in 0..RECEPTIONS {
            // F(high) − F(low) of the logistic function F(z) = 1 / (1 + e^−z), without
            // cancellation, from e = e^−|low| and f = e^−|high|: (1 − e f) / ((1 + e)(1 + f)) if
            // the ends are on either side of the mean, else |e − f| over the same.
            let (e, f) = (powers[RECEPTIONS + r], powers[2 * RECEPTIONS + r]);
            let is_inside = low[r] < 0.0 && high[r] > 0.0;
            let between = if is_inside { 1.0 - e * f } else { (e - f).abs() };
            on_edge += shares[r] * between / ((1.0 + e) * (1.0 + f));
        }
        let ahead = Ahead { shares, metres, variances };
        let inlier = belongs / density;
        Fit { density, log_factor, inlier, shares, on_edge, ahead }
    }

    /// Place given the distance across, with the probabilities of the kinds of reception that
    /// follow from it.
    #[inline]
    pub(super) fn across(
        &self,
        place: &EdgeEstimate,
        shares: ByReception,
        receiver: &Receiver,
    ) -> EdgeEstimate {
        let mut updated = EdgeEstimate { shares, ..*place };
        Across::new(place, self, receiver).update(&mut updated, self.normal);
        updated
    }

    /// Place of a stationary vehicle, given the position along.
    #[inline]
    pub(super) fn stationary(&self, place: &EdgeEstimate, receiver: &Receiver) -> EdgeEstimate {
        let h = [1.0, self.tangent[0], self.tangent[1]];
        let (mut updated, mut weights) = (*place, place.shares);
        let [mut squares, mut deviations] = [[0.0; RECEPTIONS]; 2];
        for r in 0..RECEPTIONS {
            let [mean, variance] = place.of(h, r);
            // A Gaussian likelihood: with z = `off` and v = `variance`, the derivatives of its
            // logarithm at the mean are z / v and −1 / v.
            let (variance, off) = (variance + receiver.white[r], self.along - mean);
            (squares[r], deviations[r]) = (0.5 * off * off / variance, variance.sqrt());
            updated.update(r, h, off / variance, -1.0 / variance);
        }
        // Divided by the largest density, so that not all weights underflow.
        let possible = (0..RECEPTIONS).filter(|r| place.shares[*r] > 0.0);
        let least = possible.map(|r| squares[r]).fold(f64::INFINITY, f64::min);
        for r in 0..RECEPTIONS {
            weights[r] *= (least - squares[r]).min(0.0).exp() / deviations[r];
        }
        updated.reweight(weights);
        updated
    }

    /// Place of a vehicle that moved: the position alone determines its place along.
    #[inline]
    pub(super) fn moved(&self, place: &EdgeEstimate, receiver: &Receiver) -> EdgeEstimate {
        let ([a, b], [_, x, y], [_, _, _, xx, xy, yy]) =
            (self.tangent, &place.mean, &place.covariance);
        let mut moved = *place;
        for r in 0..RECEPTIONS {
            let (u, v) = (a * xx[r] + b * xy[r], a * xy[r] + b * yy[r]);
            moved.mean[0][r] = self.along - a * x[r] - b * y[r];
            // x = along − t · o − w: its variance is t'C t + var w, and its covariance with o is −C
            // t.
            moved.covariance[0][r] = a * u + b * v + receiver.white[r];
            (moved.covariance[1][r], moved.covariance[2][r]) = (-u, -v);
        }
        moved
    }

    /// Shares of a distribution of places along that lie before the start of the edge and before
    /// its end, the share between them, and the slope of the logistic function; `None` if nothing
    /// is cut off.
    #[inline]
    fn ends(&self, mean: f64, variance: f64) -> Option<([f64; 2], f64, f64)> {
        let slope = SLOPE / variance.max(LEAST_VARIANCE).sqrt();
        let [low, high] = [-slope * mean, slope * (self.length - mean)];
        if low < -FAR && high > FAR {
            return None;
        }
        let [below, up_to] = [low, high].map(logistic);
        // Their difference without cancellation, also where both are near 0 or 1: F(h) − F(l) =
        // F(h) (1 − F(l)) (1 − e^(l − h)).
        let share = -up_to * (1.0 - below) * (low - high).exp_m1();
        Some(([below, up_to], if share > 0.0 { share } else { 0.0 }, slope))
    }

    /// Restricts a place to the edge.
    #[inline]
    pub(super) fn within(&self, place: &EdgeEstimate) -> EdgeEstimate {
        let (mut updated, mut shares) = (*place, place.shares);
        for (r, share) in shares.iter_mut().enumerate() {
            let variance = place.covariance[0][r].max(LEAST_VARIANCE);
            let Some(([below, up_to], on_edge, slope)) = self.ends(place.mean[0][r], variance)
            else {
                continue;
            };
            *share *= on_edge;
            if on_edge > 0.0 {
                // Derivatives of ln (F(h) − F(l)) with respect to the mean, with F' = F (1 − F).
                // Both h and l fall with the slope s as the mean grows, so the first is
                // −s (1 − F(h) − F(l)).
                let first = -slope * (1.0 - up_to - below);
                let second = -slope * slope * (up_to * (1.0 - up_to) + below * (1.0 - below));
                let second = second.max(-MOST_LEARNED / variance);
                updated.update(r, [1.0, 0.0, 0.0], first, second);
            }
        }
        updated.reweight(shares);
        updated
    }
}

impl Ahead {
    /// A distance that is the same with any reception.
    pub(super) fn of(metres: f64, variance: f64) -> Self {
        let [metres, variances] = [metres, variance].map(|value| [value; RECEPTIONS]);
        let mut shares = [0.0; RECEPTIONS];
        // Every reception has the same distance and variance, so any shares summing to one will do.
        shares[0] = 1.0;
        Self { shares, metres, variances }
    }

    /// Density of the distance of a stationary vehicle. For each reception, `stationary_ratio` is
    /// how much more probable the displacement is for it than if its error changed like that of a
    /// moving vehicle.
    pub(super) fn stationary_density(&self, stationary_ratio: ByReception) -> f64 {
        let mut squares = self.variances;
        for (square, metres) in squares.iter_mut().zip(self.metres) {
            *square = -0.5 * metres * metres / *square;
        }
        exp_in_place(&mut squares);
        let (densities, mut sum) = (squares, 0.0);
        for r in 0..RECEPTIONS {
            sum += stationary_ratio[r] * self.shares[r] * densities[r] / self.variances[r].sqrt();
        }
        sum / std::f64::consts::TAU.sqrt()
    }

    /// Mean and standard deviation of the mixture over receptions.
    #[inline]
    pub(super) fn moments(&self) -> [f64; 2] {
        let (mut mean, mut variance) = (0.0, 0.0);
        for r in 0..RECEPTIONS {
            mean += self.shares[r] * self.metres[r];
        }
        for r in 0..RECEPTIONS {
            let off = self.metres[r] - mean;
            variance += self.shares[r] * (off * off + self.variances[r]);
        }
        [mean, variance.sqrt()]
    }
}

/// The logistic function.
pub(super) fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + (-z).exp())
}

/// Distance across from a place to a position, by reception.
pub(super) struct Across {
    /// Innovation in metres: the distance less its prediction.
    pub(super) innovation: ByReception,
    /// 1 / v, the precision of the innovation.
    pub(super) precision: ByReception,
    /// C n: covariances with the error to the east and to the north.
    pub(super) covariances: [ByReception; 2],
    /// Half the square of the innovation in standard deviations.
    pub(super) squares: ByReception,
}

impl Across {
    #[inline]
    pub(super) fn new(place: &EdgeEstimate, sighting: &Sighting, receiver: &Receiver) -> Self {
        let ([a, b], zero) = (sighting.normal, [0.0; RECEPTIONS]);
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (&place.mean, &place.covariance);
        let mut across =
            Self { innovation: zero, precision: zero, covariances: [zero; 2], squares: zero };
        for r in 0..RECEPTIONS {
            // Rounding may leave n'C n slightly negative; white noise keeps v above 0.
            let (east, north) = (a * xx[r] + b * xy[r], a * xy[r] + b * yy[r]);
            let precision = 1.0 / ((a * east + b * north).max(0.0) + receiver.white[r]);
            let innovation = sighting.across - (a * x[r] + b * y[r]);
            (across.innovation[r], across.precision[r]) = (innovation, precision);
            (across.covariances[0][r], across.covariances[1][r]) = (east, north);
            across.squares[r] = 0.5 * innovation * innovation * precision;
        }
        across
    }

    /// Probabilities of the kinds of reception given the position, and the density of its distance
    /// across; `powers` are the exponentials of the negated squares. If the density underflows, it
    /// is 0 and the probabilities are those before.
    #[inline]
    pub(super) fn shares(&self, place: &EdgeEstimate, powers: &[f64]) -> (ByReception, f64) {
        let (mut weights, mut total) = (place.shares, 0.0);
        for r in 0..RECEPTIONS {
            // Bayes' rule over the receptions: each predicts the distance with its own Gaussian.
            weights[r] *= powers[r] * self.precision[r].sqrt();
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
    pub(super) fn log_shares(&self, place: &EdgeEstimate) -> (ByReception, f64) {
        let mut logs = [0.0; RECEPTIONS];
        for (r, log) in logs.iter_mut().enumerate() {
            *log = place.shares[r].ln() + 0.5 * self.precision[r].ln() - self.squares[r];
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
    pub(super) fn update(&self, place: &mut EdgeEstimate, [a, b]: [f64; 2]) {
        let EdgeEstimate { mean: [along, x, y], covariance: [aa, ax, ay, xx, xy, yy], .. } = place;
        for r in 0..RECEPTIONS {
            let (precision, innovation) = (self.precision[r], self.innovation[r]);
            let [u, v] = [self.covariances[0][r], self.covariances[1][r]];
            // Rows of P n, with P the covariance of place and error: w for the place along, u and v
            // for the error. Means move by P n z / v, and covariances fall by (P n)(P n)' / v.
            let w = a * ax[r] + b * ay[r];
            let gain_times_innovation = innovation * precision;
            (along[r], x[r], y[r]) = (
                along[r] + w * gain_times_innovation,
                x[r] + u * gain_times_innovation,
                y[r] + v * gain_times_innovation,
            );
            aa[r] -= w * w * precision;
            (ax[r], ay[r]) = (ax[r] - w * u * precision, ay[r] - w * v * precision);
            (xx[r], xy[r], yy[r]) =
                (xx[r] - u * u * precision, xy[r] - u * v * precision, yy[r] - v * v * precision);
        }
    }
}
