//! Joint Gaussian of a state's place along its road and of the receiver's error.
//!
//! There is one for each kind of reception, over three numbers: x, the metres along the edge, and
//! o, the lasting error to the east and to the north. Measurements of linear functions of them
//! update it (Kalman, 1960); several moves into one state are merged by their first two moments.
//! Numbers of the same kind are side by side, one for each reception, so that loops over receptions
//! run in vector registers.

use super::receiver::RECEPTIONS;

/// A number for each kind of reception.
pub(super) type ByReception = [f64; RECEPTIONS];

/// Place along an edge and error of the receiver, given the drive so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Place {
    /// Means of the metres along, and of the errors to the east and to the north.
    pub(super) mean: [ByReception; 3],
    /// Upper triangle of the covariances, row by row.
    pub(super) covariance: [ByReception; 6],
    /// Probabilities of the kinds of reception.
    pub(super) shares: ByReception,
}

impl Place {
    /// Place with the moments of a mixture for each reception, and shares in proportion to their
    /// weights; `None` without weight.
    pub(super) fn of_mixtures(mixtures: Mixtures<RECEPTIONS>) -> Option<Self> {
        let Mixtures { weights, mean, covariance } = mixtures;
        let total: f64 = weights.iter().sum();
        let shares = weights.map(|weight| weight / total);
        (total > 0.0).then_some(Self { mean, covariance, shares })
    }

    /// Returns the place with its metres counted from another point of the road.
    pub(super) fn counted_from(&self, metres: f64) -> Self {
        let [along, x, y] = self.mean;
        Self { mean: [along.map(|along| along - metres), x, y], ..*self }
    }

    /// Returns the same error at another place along, known only to within a standard deviation.
    pub(super) fn unseen(&self, along: f64, deviation: f64) -> Self {
        let ([_, x, y], [_, _, _, xx, xy, yy]) = (self.mean, self.covariance);
        let [variance, zero] = [deviation * deviation, 0.0].map(|value| [value; RECEPTIONS]);
        Self {
            mean: [[along; RECEPTIONS], x, y],
            covariance: [variance, zero, zero, xx, xy, yy],
            shares: self.shares,
        }
    }

    /// Mean and variance of a linear function in a reception.
    #[inline]
    pub(super) fn of(&self, [a, b, c]: [f64; 3], number: usize) -> [f64; 2] {
        let [x, y, z] = self.mean.map(|mean| mean[number]);
        let [u, v, w] = self.times([a, b, c], number);
        [a * x + b * y + c * z, (a * u + b * v + c * w).max(0.0)]
    }

    /// Product of the covariance of a reception and a vector.
    #[inline]
    fn times(&self, [a, b, c]: [f64; 3], number: usize) -> [f64; 3] {
        let [xx, xy, xz, yy, yz, zz] = self.covariance.map(|part| part[number]);
        [a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz]
    }

    /// Updates a reception by the likelihood of a linear function h, given the first two
    /// derivatives of its logarithm at the mean.
    #[inline]
    pub(super) fn learn(&mut self, number: usize, h: [f64; 3], first: f64, second: f64) {
        // Moments after a likelihood with a quadratic logarithm: μ + P h g' and P + (P h)(P h)'
        // g''. Exact if it is Gaussian, where this is Kalman's update.
        let by = self.times(h, number);
        for (mean, by) in self.mean.iter_mut().zip(by) {
            mean[number] += by * first;
        }
        for (covariance, by) in self.covariance.iter_mut().zip(products(by)) {
            covariance[number] += by * second;
        }
    }

    /// Returns the place with variances of at least 0 and covariances bounded by them, which
    /// rounding may have violated.
    pub(super) fn rounded(mut self) -> Self {
        let [xx, xy, xz, yy, yz, zz] = &mut self.covariance;
        for r in 0..RECEPTIONS {
            let [x, y, z] = [&mut *xx, yy, zz].map(|variances| {
                variances[r] = variances[r].max(0.0);
                variances[r].sqrt()
            });
            for (covariances, most) in [(&mut *xy, x * y), (xz, x * z), (yz, y * z)] {
                covariances[r] = covariances[r].clamp(-most, most);
            }
        }
        self
    }

    /// Sets the probabilities of the kinds of reception in proportion to weights; keeps them if all
    /// weights are zero.
    #[inline]
    pub(super) fn reweight(&mut self, weights: ByReception) {
        let total = weights.iter().sum::<f64>();
        if total > 0.0 {
            self.shares = weights.map(|weight| weight / total);
        }
    }
}

/// Mixtures of Gaussians side by side, each merged by its first two moments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mixtures<const N: usize> {
    pub(super) weights: [f64; N],
    pub(super) mean: [[f64; N]; 3],
    pub(super) covariance: [[f64; N]; 6],
}

impl<const N: usize> Default for Mixtures<N> {
    fn default() -> Self {
        Self { weights: [0.0; N], mean: [[0.0; N]; 3], covariance: [[0.0; N]; 6] }
    }
}

impl<const N: usize> Mixtures<N> {
    /// Adds a weighted Gaussian to each mixture.
    #[inline]
    pub(super) fn add(
        &mut self,
        weights: [f64; N],
        mean: &[[f64; N]; 3],
        covariance: &[[f64; N]; 6],
    ) {
        let [mut part, mut spread] = [[0.0; N]; 2];
        for n in 0..N {
            let sum = self.weights[n] + weights[n];
            // A mixture without weight keeps its moments, and 0 / 0 is avoided.
            part[n] = if sum > 0.0 { weights[n] / sum } else { 0.0 };
            spread[n] = part[n] * (1.0 - part[n]);
            self.weights[n] = sum;
        }
        // Differences of means rather than sums of squares, which would cancel: places are hundreds
        // of metres from the start of an edge and may be known to a micrometre.
        let mut off = [[0.0; N]; 3];
        for axis in 0..3 {
            for n in 0..N {
                off[axis][n] = mean[axis][n] - self.mean[axis][n];
                self.mean[axis][n] += part[n] * off[axis][n];
            }
        }
        let [x, y, z] = &off;
        let pairs = [(x, x), (x, y), (x, z), (y, y), (y, z), (z, z)];
        for (index, (a, b)) in pairs.into_iter().enumerate() {
            for n in 0..N {
                let own = self.covariance[index][n];
                // Variance within and between: (1 − p) C + p C' + p (1 − p) d d', with d the
                // difference of the means.
                let change = part[n] * (covariance[index][n] - own) + spread[n] * a[n] * b[n];
                self.covariance[index][n] = own + change;
            }
        }
    }
}

/// Mixture of places, merged within each reception.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlaceMixture(Mixtures<RECEPTIONS>);

impl PlaceMixture {
    #[inline]
    pub(super) fn add(&mut self, weight: f64, place: &Place) {
        let weights = place.shares.map(|share| weight * share);
        self.0.add(weights, &place.mean, &place.covariance);
    }

    /// Place with the same moments and shares; `None` without weight.
    pub(super) fn merged(self) -> Option<Place> {
        Place::of_mixtures(self.0)
    }
}

#[inline]
fn products([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}
