//! A Gaussian of the place along an edge and of the error of a receiver.
//!
//! Three numbers, joint: x, the metres along the edge, and o, the lasting error to the east and to
//! the north. Measurements of linear functions of them update it (Kalman, 1960); several moves that
//! lead to one state are merged by their first two moments.

/// Gaussian of the metres along an edge and of the lasting error in the plane, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Placement {
    /// Metres along; error to the east and to the north.
    pub(super) mean: [f64; 3],
    /// Upper triangle of the covariances, row by row.
    pub(super) covariance: [f64; 6],
}

impl Placement {
    /// Product of the covariance and a vector.
    fn times(&self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        let [xx, xy, xz, yy, yz, zz] = self.covariance;
        [a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz]
    }

    /// Mean and variance of a linear function.
    pub(super) fn of(&self, h: [f64; 3]) -> [f64; 2] {
        let dot = |v: [f64; 3]| h[0] * v[0] + h[1] * v[1] + h[2] * v[2];
        [dot(self.mean), dot(self.times(h)).max(0.0)]
    }

    /// Update by a likelihood of a linear function, of whose logarithm the first two derivatives at
    /// the mean are given.
    pub(super) fn learned(&self, h: [f64; 3], first: f64, second: f64) -> Self {
        let [u, v, w] = self.times(h);
        let mut updated = *self;
        for (mean, by) in updated.mean.iter_mut().zip([u, v, w]) {
            *mean += by * first;
        }
        for (covariance, by) in updated.covariance.iter_mut().zip(products([u, v, w])) {
            *covariance += by * second;
        }
        updated
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

/// Mixture of Gaussians, by its moments about the mean of the first: places are hundreds of metres
/// from the start of an edge, and may be known to a micrometre.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mixture {
    origin: [f64; 3],
    pub(super) weight: f64,
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
