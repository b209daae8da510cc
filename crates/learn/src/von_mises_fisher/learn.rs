//! Learning of directions: the M step of section 9 of the formulas, with a conjugate prior.
//!
//! ln p is linear in y and in 1, so the mean vector R and the weight are sufficient: μ = R / ‖R‖,
//! and κ solves I_{ν+1}(κ) / I_ν(κ) = ‖R‖. The sums are of y − μ_old, from which 1 − ‖R‖ has all
//! its digits.

use std::error::Error;

use super::{VonMisesFisher, cosine_distance, length};
use crate::check::{at, spread};
use crate::concentration::concentration;
use crate::special::Bessel;
use crate::{EmissionError, StartFromClusters};
use wayfix::Likelihood;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::LearnLikelihood;

impl VonMisesFisher {
    /// Expected distance 1 − μ·y from the mean of a state, and length of the mean vector, for
    /// observations distributed as the prior.
    fn expected_distance(&self, prior: &Self, state: usize) -> (f64, f64) {
        let order = 0.5 * self.components as f64 - 1.0;
        let Bessel { ratio, complement, .. } = Bessel::new(order, prior.concentrations[state]);
        // The prior's mean vector is r m, and 1 − r μ·m = (1 − r) + r (1 − μ·m).
        let distance = cosine_distance(self.mean(state), prior.mean(state).iter().copied());
        (complement + ratio * distance, ratio)
    }

    /// Returns the mean direction and the concentration that maximise the likelihood of the
    /// observations behind the sums.
    fn maximize(&self, state: usize, sums: &[f64]) -> Result<(Vec<f64>, f64), EmissionError> {
        let old = self.mean(state);
        let (weight, distance) = (sums[0], sums[1] / sums[0]);
        let shift = || sums[2..].iter().map(|sum| sum / weight);
        let mut mean: Vec<f64> = old.iter().zip(shift()).map(|(old, shift)| old + shift).collect();
        let length = length(&mean);
        // With R = μ_old + s, 1 − ‖R‖² = −2 μ_old·s − ‖s‖², and −μ_old·s is the mean distance.
        let variance = 2.0 * distance - shift().map(|shift| shift * shift).sum::<f64>();
        let variance = spread("concentration", weight, variance, distance)?;
        if length == 0.0 {
            return Ok((old.to_vec(), 0.0));
        }
        // 1 − ‖R‖ = (1 − ‖R‖²) / (1 + ‖R‖).
        mean.iter_mut().for_each(|m| *m /= length);
        Ok((mean, concentration(self.components, length, variance / (1.0 + length))))
    }
}

impl LearnLikelihood for VonMisesFisher {
    /// For each state the weighted sums of 1, of the distance 1 − μ·y from the mean direction, and
    /// of y − μ in each component.
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        vec![0.0; self.states() * (self.components + 2)]
    }

    /// Adds one observation; nothing if it is invalid.
    fn add(&self, statistics: &mut Vec<f64>, observation: &[f64], posterior: &[f64]) {
        let Ok(Some(scale)) = self.scale(observation) else { return };
        let states = statistics.chunks_exact_mut(self.components + 2).zip(posterior);
        for ((sums, &weight), mean) in states.zip(self.means.chunks_exact(self.components)) {
            sums[0] += weight;
            sums[1] += weight * cosine_distance(mean, observation.iter().map(|y| y * scale));
            let parts = sums[2..].iter_mut().zip(observation).zip(mean);
            parts.for_each(|((sum, y), m)| *sum += weight * (y * scale - m));
        }
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        statistics.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (mut means, mut concentrations) = (self.means(), self.concentrations.clone());
        for (state, sums) in statistics.chunks_exact(self.components + 2).enumerate() {
            let mut sums = sums.to_vec();
            // The prior adds the expected sums of its `count` observations.
            if let Some((prior, count)) = &self.prior {
                let (distance, ratio) = self.expected_distance(prior, state);
                sums[0] += count;
                sums[1] += count * distance;
                let parts = sums[2..].iter_mut().zip(prior.mean(state)).zip(self.mean(state));
                parts.for_each(|((sum, p), m)| *sum += count * (ratio * p - m));
            }
            if sums[0] >= f64::MIN_POSITIVE {
                let learned = self.maximize(state, &sums).map_err(|e| at(e, state, None))?;
                (means[state], concentrations[state]) = learned;
            }
        }
        let (missing, prior) = (self.missing, self.prior.clone());
        Ok(Self { missing, prior, ..Self::new(&means, &concentrations)? })
    }

    fn log_prior(&self, _: f64) -> f64 {
        let Some((prior, count)) = &self.prior else { return 0.0 };
        let state = |state: usize| {
            let distance = self.expected_distance(prior, state).0;
            self.peaks[state] - self.concentrations[state] * distance
        };
        count * (0..self.states()).map(state).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.means.len()
    }
}

impl StartFromClusters for VonMisesFisher {}

/// The direction of each state with its concentration.
impl FreeParameters for VonMisesFisher {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (mut means, mut concentrations) = (self.means(), self.concentrations.clone());
        for (mean, concentration) in means.iter_mut().zip(&mut concentrations) {
            by.direction(mean);
            *concentration = by.positive(*concentration);
        }
        let (missing, prior) = (self.missing, self.prior.clone());
        Ok(Self { missing, prior, ..Self::new(&means, &concentrations)? })
    }
}
