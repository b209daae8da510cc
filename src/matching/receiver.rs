//! Errors of a receiver, and the place along a road: a Gaussian of both for each state.
//!
//! An error is a slowly moving offset and white noise: y = x + o + w. In each direction of the
//! plane, o is a Gauss–Markov process with the variance ρσ², of which the share κ = e^(−Δ/τ) is left
//! after Δ seconds, and w has the variance (1 − ρ)σ². So a second look from the same place is hardly
//! a second witness: a vehicle that a road explains with an offset of 20 m pays for it once, and not
//! at each point.
//!
//! A state on an edge carries the joint Gaussian of x, its metres along the edge, and o. A position
//! is two measurements of these: a distance across, n · o + w, and a place along, x + t · o + w, where
//! n and t are the unit vectors across and along (Kalman 1960). That x is on the edge is a third,
//! which is no Gaussian: the update takes the first two derivatives of its logarithm. Moves that
//! lead to one state are merged by their moments. So positions that jitter about one place for a
//! while say where a vehicle stands as their mean does.

use crate::matching::MatchModel;

/// Gaussian of the metres along an edge and of the lasting error in the plane, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Placement {
    /// Metres along; error to the east and to the north.
    pub(super) mean: [f64; 3],
    /// Upper triangle of the covariances, row by row.
    pub(super) covariance: [f64; 6],
}

/// A position as it is seen from an edge.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sighting {
    /// Unit vector across, from the road to the position.
    pub(super) normal: [f64; 2],
    /// Unit vector along; zero if none is known.
    pub(super) tangent: [f64; 2],
    /// Metres across, in the direction of `normal`.
    pub(super) across: f64,
    /// Metres along, on the straight line that goes on beyond the ends.
    pub(super) along: f64,
    /// Length of the edge in metres.
    pub(super) length: f64,
    /// True if the position is beside the edge, and not beyond its ends.
    pub(super) is_beside: bool,
    /// Log density of a position that says nothing of the place.
    pub(super) log_outlier: f64,
}

/// A receiver at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver {
    /// Variance of the error that lasts, in each direction.
    lasting: f64,
    /// Variance of the white noise, in each direction.
    white: f64,
    log_inlier: f64,
}

/// Slope of the logistic function that is nearest to the normal distribution function.
const SLOPE: f64 = 1.702;
/// Deviations, as arguments of the logistic function, beyond which nothing is cut off.
const FAR: f64 = 7.0;
/// Share of positions and of distances whose errors are as if none lasted.
pub(super) const WIDE: f64 = 0.05;
/// Least share of a distribution on an edge, as a share: positions are never impossible.
const LEAST_SHARE: f64 = 1e-30;
/// Least variance along, in square metres: below that of the finest receiver.
const LEAST_VARIANCE: f64 = 1e-15;
/// Largest share of a variance that an update by the ends of an edge takes away: its second
/// derivative is that of a logistic function, and no exact one.
const MOST_LEARNED: f64 = 0.9;

impl Placement {
    /// Product of the covariance and a vector.
    fn times(&self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        let [xx, xy, xz, yy, yz, zz] = self.covariance;
        [a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz]
    }

    /// Mean and variance of a linear function.
    fn of(&self, h: [f64; 3]) -> [f64; 2] {
        let dot = |v: [f64; 3]| h[0] * v[0] + h[1] * v[1] + h[2] * v[2];
        [dot(self.mean), dot(self.times(h))]
    }

    /// Update by a likelihood of a linear function, of whose logarithm the first two derivatives at
    /// the mean are given.
    fn learned(&self, h: [f64; 3], first: f64, second: f64) -> Self {
        let [u, v, w] = self.times(h);
        let mut updated = *self;
        for (mean, by) in updated.mean.iter_mut().zip([u, v, w]) {
            *mean += by * first;
        }
        let products = [u * u, u * v, u * w, v * v, v * w, w * w];
        for (covariance, by) in updated.covariance.iter_mut().zip(products) {
            *covariance += by * second;
        }
        updated
    }

    /// Update by a measurement of a linear function by a receiver, and the log density of the
    /// measurement. One in twenty has a noise as large as all of the error, since noise is not
    /// always what the model says: the update is by its share.
    fn observed(&self, h: [f64; 3], value: f64, receiver: &Receiver) -> (Self, f64) {
        let [mean, variance] = self.of(h);
        let z = value - mean;
        let density = |variance: f64, share: f64| {
            share * (-0.5 * z * z / variance).exp() / (std::f64::consts::TAU * variance).sqrt()
        };
        let narrow = variance.max(0.0) + receiver.white;
        let wide = narrow + receiver.lasting + receiver.white;
        let [likely, rare] = [density(narrow, 1.0 - WIDE), density(wide, WIDE)];
        let total = likely + rare;
        if total < f64::MIN_POSITIVE {
            let log = -0.5 * (z * z / wide + (std::f64::consts::TAU * wide).ln());
            return (*self, WIDE.ln() + log);
        }
        let precision = (likely / narrow + rare / wide) / total;
        (self.learned(h, z * precision, -precision), total.ln())
    }

    /// The same with the metres counted from another point of the road.
    pub(super) fn counted_from(&self, metres: f64) -> Self {
        let [along, x, y] = self.mean;
        Self { mean: [along - metres, x, y], ..*self }
    }

    /// The same error at a place of which the position says nothing.
    pub(super) fn unseen(&self, along: f64, deviation: f64) -> Self {
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (self.mean, self.covariance);
        let covariance = [deviation * deviation, 0.0, 0.0, xx, xy, yy];
        Self { mean: [along, x, y], covariance }
    }
}

impl Sighting {
    fn along_and_error(&self) -> [f64; 3] {
        [1.0, self.tangent[0], self.tangent[1]]
    }

    /// Restricts a place to the edge. Returns the share of the distribution that is there, too.
    pub(super) fn within(&self, placement: &Placement) -> (Placement, f64) {
        let (mean, variance) = (placement.mean[0], placement.covariance[0].max(LEAST_VARIANCE));
        let slope = SLOPE / variance.sqrt();
        let [low, high] = [-slope * mean, slope * (self.length - mean)];
        if low < -FAR && high > FAR {
            return (*placement, 1.0);
        }
        let [below, up_to] = [low, high].map(|z| 1.0 / (1.0 + (-z).exp()));
        // Their difference, without loss where both are near 0 or 1.
        let share = -up_to * (1.0 - below) * (low - high).exp_m1();
        if share <= LEAST_SHARE || share.is_nan() {
            return (*placement, LEAST_SHARE);
        }
        let first = -slope * (1.0 - up_to - below);
        let second = -slope * slope * (up_to * (1.0 - up_to) + below * (1.0 - below));
        let second = second.max(-MOST_LEARNED / variance);
        (placement.learned([1.0, 0.0, 0.0], first, second), share)
    }

    /// Log density of the position, and the probability that it belongs to the road, from the log
    /// density across of those that do.
    pub(super) fn position(&self, receiver: &Receiver, log_across: f64) -> (f64, f64) {
        let inlier = receiver.log_inlier + log_across;
        let most = inlier.max(self.log_outlier);
        let total = most + ((inlier - most).exp() + (self.log_outlier - most).exp()).ln();
        (total, (inlier - total).exp())
    }
}

impl Receiver {
    /// Creates a receiver whose errors have a standard deviation in each direction.
    pub(super) fn new(model: &MatchModel, deviation: f64) -> Self {
        let variance = deviation * deviation;
        let log_inlier = (-model.outliers).ln_1p();
        Self {
            lasting: model.lasting * variance,
            white: (1.0 - model.lasting) * variance,
            log_inlier,
        }
    }

    /// Error of which nothing is known, at no place.
    pub(super) fn unknown(&self) -> Placement {
        Placement { mean: [0.0; 3], covariance: [0.0, 0.0, 0.0, self.lasting, 0.0, self.lasting] }
    }

    /// Distribution when a share of the error before is left.
    pub(super) fn predicted(&self, placement: &Placement, kept: f64) -> Placement {
        let ([along, x, y], [aa, ax, ay, xx, xy, yy]) = (placement.mean, placement.covariance);
        let (k, new) = (kept * kept, (1.0 - kept * kept) * self.lasting);
        Placement {
            mean: [along, kept * x, kept * y],
            covariance: [aa, kept * ax, kept * ay, k * xx + new, k * xy, k * yy + new],
        }
    }

    /// Update by the distance across, and the log density of it.
    pub(super) fn across(&self, placement: &Placement, sighting: &Sighting) -> (Placement, f64) {
        let Sighting { normal: [a, b], across, .. } = *sighting;
        placement.observed([0.0, a, b], across, self)
    }

    /// Update by the place along, for a vehicle that stood.
    pub(super) fn stood(&self, placement: &Placement, sighting: &Sighting) -> Placement {
        placement.observed(sighting.along_and_error(), sighting.along, self).0
    }

    /// Distribution of a vehicle that moved: the position alone tells its place along.
    pub(super) fn moved(&self, placement: &Placement, sighting: &Sighting) -> Placement {
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (placement.mean, placement.covariance);
        let [a, b] = sighting.tangent;
        let (u, v) = (a * xx + b * xy, a * xy + b * yy);
        Placement {
            mean: [sighting.along - a * x - b * y, x, y],
            covariance: [a * u + b * v + self.white, -u, -v, xx, xy, yy],
        }
    }

    /// Metres that a position is ahead of a place, and their standard deviation.
    pub(super) fn metres(&self, placement: &Placement, sighting: &Sighting) -> [f64; 2] {
        let [mean, variance] = placement.of(sighting.along_and_error());
        [sighting.along - mean, (variance.max(0.0) + self.white).sqrt()]
    }
}

/// Mixture of Gaussians, by its moments about the mean of the first: places are hundreds of metres
/// from the start of an edge, and may be known to a micrometre.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mixture {
    origin: [f64; 3],
    weight: f64,
    first: [f64; 3],
    second: [f64; 6],
}

impl Mixture {
    pub(super) fn add(&mut self, weight: f64, placement: &Placement) {
        if self.weight == 0.0 {
            self.origin = placement.mean;
        }
        self.weight += weight;
        let [x, y, z] = placement.mean;
        let [a, b, c] = self.origin;
        let off = [x - a, y - b, z - c];
        for (sum, off) in self.first.iter_mut().zip(off) {
            *sum += weight * off;
        }
        let parts = placement.covariance.iter().zip(products(off));
        for (sum, (covariance, product)) in self.second.iter_mut().zip(parts) {
            *sum += weight * (covariance + product);
        }
    }

    /// Gaussian with the same moments; `None` without weight.
    pub(super) fn merged(&self) -> Option<Placement> {
        (self.weight > 0.0).then(|| {
            let off @ [x, y, z] = self.first.map(|sum| sum / self.weight);
            let mut covariance = self.second.map(|sum| sum / self.weight);
            for (covariance, product) in covariance.iter_mut().zip(products(off)) {
                *covariance -= product;
            }
            // Rounding may leave less than a covariance matrix.
            let [xx, xy, xz, yy, yz, zz] = covariance;
            let [xx, yy, zz] = [xx, yy, zz].map(|variance| variance.max(0.0));
            let within = |covariance: f64, a: f64, b: f64| {
                let most = (a * b).sqrt();
                covariance.clamp(-most, most)
            };
            let [xy, xz, yz] = [within(xy, xx, yy), within(xz, xx, zz), within(yz, yy, zz)];
            let [a, b, c] = self.origin;
            Placement { mean: [a + x, b + y, c + z], covariance: [xx, xy, xz, yy, yz, zz] }
        })
    }
}

fn products([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}
