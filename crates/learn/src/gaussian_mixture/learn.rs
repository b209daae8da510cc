//! Learning of Gaussian mixtures: the E step over the parts, and the M step of section 9 of the
//! formulas.
//!
//! With the posterior γ_i of state i, part p has the posterior γ_i w_p N_p(y) / Σ_q w_q N_q(y). So
//! the parts of all states are Gaussians with these weights, and the weights w_p a distribution
//! that is learned from their sums.

use std::error::Error;

use super::GaussianMixture;
use crate::EmissionError;
use crate::normal::{CovarianceType, GaussianStatistics};
use wayfix::Likelihood;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::internal::shares;
use wayfix::likelihood::LearnLikelihood;

impl LearnLikelihood for GaussianMixture {
    /// The sums are the expected numbers of observations of all parts.
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.normals.statistics(self.weights.len())
    }

    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, sums, weights: [weights, _], memory } = statistics;
        let Ok(logs) = self.logs(y, memory) else {
            return; // invalid
        };
        // Lanes beyond the last part stay at 0.
        let shares = &mut weights.as_flattened_mut()[..self.weights.len()];
        let states = logs.chunks_exact(self.parts).zip(shares.chunks_exact_mut(self.parts));
        for ((logs, shares), p) in states.zip(posterior) {
            let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if *p == 0.0 || largest == f64::NEG_INFINITY {
                shares.fill(0.0);
                continue;
            }
            // Relative to the largest, so that the sum is from 1 to m.
            let exponentials = shares.iter_mut().zip(logs);
            exponentials.for_each(|(share, log)| *share = (log - largest).exp());
            let scale = p / shares.iter().sum::<f64>();
            shares.iter_mut().for_each(|share| *share *= scale);
        }
        sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += *share);
        self.normals.add(moments, y, weights, weights, memory);
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let normals = self.normals.maximize(&statistics.moments, None);
        let tied = self.normals.kind() == CovarianceType::Tied;
        let normals = normals.map_err(|error| match error.in_part(None, self.parts) {
            // All parts of the state share the covariance, so the error names no part.
            EmissionError::Part { cause, .. }
                if tied && matches!(*cause, EmissionError::TooFew { .. }) =>
            {
                *cause
            }
            error => error,
        })?;
        // Σ S_p ln w_p under Σ w_p = 1 is largest in proportion to S_p (with pseudo-counts).
        let states = self.weights.chunks_exact(self.parts);
        let counts = statistics.sums.chunks_exact(self.parts);
        let weights = states.zip(counts);
        let weights = weights.flat_map(|(old, counts)| shares(old, counts, pseudo_count));
        Ok(Self::of(normals, self.parts, weights.collect()))
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let normals = self.normals.log_prior();
        if pseudo_count == 0.0 {
            return normals;
        }
        let possible = self.log_weights.iter().filter(|log| **log > f64::NEG_INFINITY);
        normals + pseudo_count * possible.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        // The weights of a state sum to one, and those of 0 stay so.
        let weights = self.weights.iter().filter(|weight| **weight > 0.0).count();
        weights - self.states() + self.normals.free_parameters()
    }
}

/// Log-odds of the weights above 0 relative to the largest of the state, state by state; then means
/// and covariances, except those that learning keeps.
impl FreeParameters for GaussianMixture {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut weights = self.weights.clone();
        weights.chunks_exact_mut(self.parts).for_each(|weights| by.distribution(weights));
        Ok(Self::of(self.normals.displaced(by)?, self.parts, weights))
    }
}
