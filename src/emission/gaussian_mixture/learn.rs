//! Learning of mixtures.

use std::error::Error;

use super::super::normal::{Moments, in_blocks};
use super::GaussianMixture;
use crate::kernels::Eight;
use crate::likelihood::{LearnLikelihood, Likelihood};

/// Statistics of a [`GaussianMixture`]: weights, means and scatter of the observations of each
/// part.
#[derive(Debug, Clone)]
pub struct GaussianMixtureStatistics {
    moments: Moments,
    /// Weights of all parts, and those of one observation.
    weights: Vec<f64>,
    shares: Vec<f64>,
    blocks: Vec<Eight>,
    memory: Vec<Eight>,
}

impl LearnLikelihood for GaussianMixture {
    type Statistics = GaussianMixtureStatistics;

    fn statistics(&self) -> GaussianMixtureStatistics {
        GaussianMixtureStatistics {
            moments: self.normals.moments(),
            weights: vec![0.0; self.weights.len()],
            shares: vec![0.0; self.weights.len()],
            blocks: vec![Eight::default(); self.normals.blocks()],
            memory: vec![Eight::default(); self.normals.memory()],
        }
    }

    fn add(&self, statistics: &mut GaussianMixtureStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianMixtureStatistics { moments, weights, shares, blocks, memory } = statistics;
        let Ok(logs) = self.logs(y, memory) else {
            return; // has no posterior
        };
        let states = logs.chunks_exact(self.parts).zip(shares.chunks_exact_mut(self.parts));
        for ((logs, shares), p) in states.zip(posterior) {
            let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if *p == 0.0 || largest == f64::NEG_INFINITY {
                shares.fill(0.0);
                continue;
            }
            let exponentials = shares.iter_mut().zip(logs);
            exponentials.for_each(|(share, log)| *share = (log - largest).exp());
            let scale = p / shares.iter().sum::<f64>();
            shares.iter_mut().for_each(|share| *share *= scale);
        }
        weights.iter_mut().zip(&*shares).for_each(|(weight, share)| *weight += share);
        in_blocks(shares, blocks);
        self.normals.add(moments, y, blocks, blocks, memory);
    }

    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
        statistics.moments.merge(&other.moments);
        let weights = statistics.weights.iter_mut().zip(&other.weights);
        weights.for_each(|(weight, other)| *weight += other);
    }

    fn maximize(
        &self,
        statistics: &GaussianMixtureStatistics,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let prior = self.prior.as_ref();
        let normals = self.normals.maximize(&statistics.moments, None, prior);
        let normals = normals.map_err(|error| error.in_part(None, self.parts))?;
        let states = self.weights.chunks_exact(self.parts);
        let counts = statistics.weights.chunks_exact(self.parts);
        let weights = states.zip(counts).flat_map(|(old, counts)| {
            let known = old.iter().zip(counts);
            let weight = |(&old, count)| if old > 0.0 { count + pseudo_count } else { 0.0 };
            let new: Vec<f64> = known.map(weight).collect();
            let sum: f64 = new.iter().sum();
            if sum < f64::MIN_POSITIVE {
                old.to_vec()
            } else {
                new.iter().map(|weight| weight / sum).collect()
            }
        });
        Ok(Self::of(normals, self.parts, weights.collect(), self.prior.clone()))
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let normals = self.prior.as_ref().map_or(0.0, |prior| prior.log_density(&self.normals));
        if pseudo_count == 0.0 {
            return normals;
        }
        let possible = self.log_weights.iter().filter(|log| **log > f64::NEG_INFINITY);
        normals + pseudo_count * possible.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        let weights = self.weights.iter().filter(|weight| **weight > 0.0).count();
        weights - self.states() + self.normals.free_parameters()
    }
}
