//! Errors of a receiver, the kinds of its reception, and the joint Gaussian of a state's place
//! along its road and of these errors.
//!
//! An error is a slowly moving offset and white noise: y = x + o + w. In each direction of the
//! plane, o is a Gauss–Markov process with the variance ρσ², whose share κ = e^(−Δ/τ) is left
//! after Δ seconds, and w has the variance (1 − ρ)σ². So a second position from the same place
//! is hardly a second witness: a road that explains a drive by an offset of 20 m pays for the
//! offset once, not at each point.
//!
//! Reception is usual, poor or rough. In poor reception σ is four times as large; it comes and goes
//! within a minute or so. Rough reception usually lasts as long as a drive: it is that of a
//! receiver whose errors are twice as large, with a good part of them white. Each state carries the
//! probability of each and, for each, the joint Gaussian of three numbers: x, the metres along the
//! edge, and o, the lasting error to the east and to the north. This is the interacting multiple
//! model of Blom and Bar-Shalom (1988). Measurements of linear functions of the three update it
//! (Kalman, 1960); several moves into one state are merged by their first two moments. Numbers of
//! the same kind are side by side, one for each reception, so that loops over receptions run in
//! vector registers.

use super::model::{MatchModel, POOR_FACTOR};

/// Kinds of reception: usual, poor, and rough.
pub(super) const RECEPTIONS: usize = 3;
pub(super) const POOR_AT: usize = 1;
pub(super) const ROUGH_AT: usize = 2;
/// Factors of the standard deviation.
pub(super) const FACTORS: ByReception = [1.0, POOR_FACTOR, 2.0];
/// Share of receivers that are rough, and the largest lasting share of their errors' variance.
pub(super) const ROUGH: f64 = 0.05;
const LASTING_IN_ROUGH: f64 = 0.7;
/// Time constants in seconds after which poor or usual reception is drawn anew, and the kind of
/// receiver is.
pub(super) const REDRAWN_AFTER: f64 = 60.0;
const RECEIVER_LASTS: f64 = 3600.0;

/// A receiver at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Receiver {
    /// Variances of the error that lasts, in each direction, by reception.
    lasting_variances: ByReception,
    /// Variances of the white noise, in each direction, by reception.
    pub(super) white: ByReception,
    /// Long-run shares of the kinds of reception.
    shares: ByReception,
    /// Probability that a position belongs to a road.
    pub(super) inlier: f64,
}

impl Receiver {
    /// Creates a receiver whose errors in usual reception have the given standard deviation in each
    /// direction.
    pub(super) fn new(model: &MatchModel, deviation: f64) -> Self {
        let fine = 1.0 - ROUGH;
        let shares = [fine * (1.0 - model.poor), fine * model.poor, ROUGH];
        let mut lasting_shares = [model.lasting; RECEPTIONS];
        lasting_shares[ROUGH_AT] = model.lasting.min(LASTING_IN_ROUGH);
        let (mut lasting_variances, mut white) = (lasting_shares, lasting_shares);
        for (number, factor) in FACTORS.iter().enumerate() {
            let variance = (factor * deviation).powi(2);
            lasting_variances[number] = lasting_shares[number] * variance;
            white[number] = (1.0 - lasting_shares[number]) * variance;
        }
        Self { lasting_variances, white, shares, inlier: 1.0 - model.outliers }
    }

    /// Variances of the change of an error when the share `redrawn` of the lasting part is drawn
    /// anew, for a receiver created with the standard deviation of a difference.
    pub(super) fn changes(&self, redrawn: f64) -> ByReception {
        let mut changes = self.white;
        for (change, lasting) in changes.iter_mut().zip(self.lasting_variances) {
            *change += redrawn * lasting;
        }
        changes
    }

    /// Error before any position, at no place.
    pub(super) fn unknown(&self) -> EdgeEstimate {
        let zero = [0.0; RECEPTIONS];
        let covariance = [zero, zero, zero, self.lasting_variances, zero, self.lasting_variances];
        EdgeEstimate { mean: [zero; 3], covariance, shares: self.shares }
    }

    /// Distribution after some seconds, when the share `kept` of the error is left.
    pub(super) fn predicted(&self, place: &EdgeEstimate, seconds: f64, kept: f64) -> EdgeEstimate {
        let redrawn = -(-seconds / REDRAWN_AFTER).exp_m1();
        let other_receiver = -(-seconds / RECEIVER_LASTS).exp_m1();
        // The mixing step of the interacting multiple model. A reception that is drawn anew takes
        // the merged Gaussian of all that it may come from: usual and poor are redrawn among
        // themselves, and all three with a new receiver.
        let fine = pooled(place, (0..RECEPTIONS).filter(|number| *number != ROUGH_AT));
        let any = pooled(place, 0..RECEPTIONS);
        let [of_fine, of_any] = [&fine, &any].map(|pool| pool.weights[0]);
        let all_fine = 1.0 - self.shares[ROUGH_AT];
        let [mut stays, mut from_fine, mut from_any] = [[0.0; RECEPTIONS]; 3];
        for number in 0..RECEPTIONS {
            let share = self.shares[number];
            from_any[number] = other_receiver * share * of_any;
            stays[number] = (1.0 - other_receiver) * place.shares[number];
            if number != ROUGH_AT {
                from_fine[number] = (1.0 - other_receiver) * redrawn * share / all_fine * of_fine;
                stays[number] *= 1.0 - redrawn;
            }
        }
        let mut mixtures = Mixtures::default();
        mixtures.add(stays, &place.mean, &place.covariance);
        for (weights, pool) in [(from_fine, &fine), (from_any, &any)] {
            let (mean, covariance) = (pool.mean.map(in_each), pool.covariance.map(in_each));
            mixtures.add(weights, &mean, &covariance);
        }
        // Only the state off the road has a place without any weight, which is left as it is.
        let Some(mut predicted) = EdgeEstimate::of_mixtures(mixtures) else { return *place };
        let squared = kept * kept;
        let EdgeEstimate { mean: [_, x, y], covariance: [_, ax, ay, xx, xy, yy], .. } =
            &mut predicted;
        for r in 0..RECEPTIONS {
            // The Gauss–Markov step of the error, o → κ o + noise of variance (1 − κ²) ρσ², with κ
            // = `kept`: means and covariances with o scale by κ, those within o by κ².
            let new = (1.0 - squared) * self.lasting_variances[r];
            (x[r], y[r]) = (kept * x[r], kept * y[r]);
            (ax[r], ay[r]) = (kept * ax[r], kept * ay[r]);
            (xx[r], yy[r]) = (squared * xx[r] + new, squared * yy[r] + new);
            xy[r] *= squared;
        }
        predicted
    }
}

/// Some receptions of a place, merged.
fn pooled(place: &EdgeEstimate, receptions: impl Iterator<Item = usize>) -> Mixtures<1> {
    let mut pool = Mixtures::default();
    for number in receptions {
        let (mean, covariance) = (&place.mean, &place.covariance);
        let mean = mean.each_ref().map(|mean| [mean[number]]);
        let covariance = covariance.each_ref().map(|part| [part[number]]);
        pool.add([place.shares[number]], &mean, &covariance);
    }
    pool
}

/// The same number for each reception.
fn in_each([value]: [f64; 1]) -> ByReception {
    [value; RECEPTIONS]
}

/// A number for each kind of reception.
pub(super) type ByReception = [f64; RECEPTIONS];

/// Place along an edge and error of the receiver, given the drive so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct EdgeEstimate {
    /// Means of the metres along, and of the errors to the east and to the north.
    pub(super) mean: [ByReception; 3],
    /// Upper triangle of the covariances, row by row.
    pub(super) covariance: [ByReception; 6],
    /// Probabilities of the kinds of reception.
    pub(super) shares: ByReception,
}

impl EdgeEstimate {
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
    pub(super) fn update(&mut self, number: usize, h: [f64; 3], first: f64, second: f64) {
        // With mean μ, covariance P, and derivatives g' and g'' of the logarithm, the moments
        // become μ + P h g' and P + (P h)(P h)' g''. This is exact for a Gaussian likelihood, where
        // it is Kalman's update.
        let gain = self.times(h, number);
        for (mean, gain) in self.mean.iter_mut().zip(gain) {
            mean[number] += gain * first;
        }
        for (covariance, product) in self.covariance.iter_mut().zip(products(gain)) {
            covariance[number] += product * second;
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
                // Variance within and between: (1 − p) C + p C' + p (1 − p) d d', with p = `part`
                // and d = `off`, the difference of the means.
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
    pub(super) fn add(&mut self, weight: f64, place: &EdgeEstimate) {
        let weights = place.shares.map(|share| weight * share);
        self.0.add(weights, &place.mean, &place.covariance);
    }

    /// Place with the same moments and shares; `None` without weight.
    pub(super) fn merged(self) -> Option<EdgeEstimate> {
        EdgeEstimate::of_mixtures(self.0)
    }
}

#[inline]
fn products([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}
