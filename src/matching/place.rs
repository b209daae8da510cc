//! What a state knows of its place along the road and of the error of the receiver.
//!
//! For each kind of reception a Gaussian of three numbers: x, the metres along the edge, and o, the
//! lasting error to the east and to the north. Measurements of linear functions of them update it
//! (Kalman, 1960); several moves that lead to one state are merged by their first two moments.
//! Numbers of the same kind stand side by side, one for each reception, so that the loops over
//! receptions run in vector registers.

use super::receiver::RECEPTIONS;

/// A number for each kind of reception.
pub(super) type ByReception = [f64; RECEPTIONS];

/// Place along an edge and error of the receiver, as the drive so far tells them.
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
    /// The same with the metres counted from another point of the road.
    pub(super) fn counted_from(&self, metres: f64) -> Self {
        let [along, x, y] = self.mean;
        Self { mean: [along.map(|along| along - metres), x, y], ..*self }
    }

    /// The same error at a place of which the position says nothing.
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

    /// Updates a reception by a likelihood of a linear function, of whose logarithm the first two
    /// derivatives at the mean are given.
    #[inline]
    pub(super) fn learn(&mut self, number: usize, h: [f64; 3], first: f64, second: f64) {
        let by = self.times(h, number);
        for (mean, by) in self.mean.iter_mut().zip(by) {
            mean[number] += by * first;
        }
        for (covariance, by) in self.covariance.iter_mut().zip(products(by)) {
            covariance[number] += by * second;
        }
    }

    /// The same with variances of at least 0 and covariances within them: rounding may leave less than
    /// a covariance matrix.
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

    /// Replaces the probabilities of the kinds of reception, in proportion to weights; they stay
    /// as they are if all are zero.
    #[inline]
    pub(super) fn reweight(&mut self, weights: ByReception) {
        let total = weights.iter().sum::<f64>();
        if total > 0.0 {
            self.shares = weights.map(|weight| weight / total);
        }
    }
}

/// Mixture of places, of which those of one reception are merged by their moments.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlaceMixture {
    merged: Place,
    weights: ByReception,
}

impl PlaceMixture {
    #[inline]
    pub(super) fn add(&mut self, weight: f64, place: &Place) {
        self.add_by(place.shares.map(|share| weight * share), place);
    }

    /// Adds a place with a weight for each reception.
    #[inline]
    pub(super) fn add_by(&mut self, weights: ByReception, place: &Place) {
        let Self { merged, weights: sums } = self;
        let [mut part, mut spread] = [[0.0; RECEPTIONS]; 2];
        for number in 0..RECEPTIONS {
            let sum = sums[number] + weights[number];
            // A reception without weight keeps its moments.
            part[number] = if sum > 0.0 { weights[number] / sum } else { 0.0 };
            spread[number] = part[number] * (1.0 - part[number]);
            sums[number] = sum;
        }
        // Differences of means, and no sums of squares: places are hundreds of metres from the start of
        // an edge, and may be known to a micrometre.
        let mut off = [[0.0; RECEPTIONS]; 3];
        for axis in 0..3 {
            for number in 0..RECEPTIONS {
                off[axis][number] = place.mean[axis][number] - merged.mean[axis][number];
                merged.mean[axis][number] += part[number] * off[axis][number];
            }
        }
        let [x, y, z] = off;
        for (index, (a, b)) in
            [(x, x), (x, y), (x, z), (y, y), (y, z), (z, z)].into_iter().enumerate()
        {
            let (sum, new) = (&mut merged.covariance[index], &place.covariance[index]);
            for number in 0..RECEPTIONS {
                let product = spread[number] * a[number] * b[number];
                sum[number] += part[number] * (new[number] - sum[number]) + product;
            }
        }
    }

    /// Place with the same moments and shares; `None` without weight.
    pub(super) fn merged(mut self) -> Option<Place> {
        let total: f64 = self.weights.iter().sum();
        self.merged.reweight(self.weights);
        (total > 0.0).then_some(self.merged)
    }
}

#[inline]
fn products([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}
