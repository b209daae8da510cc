//! Learning of Student's t.

use std::error::Error;

use super::super::normal::{Moments, in_blocks};
use super::super::special::{ln_minus_digamma, log_excess};
use super::StudentT;
use crate::kernels::Eight;
use crate::likelihood::LearnLikelihood;

/// Statistics of a [`StudentT`]: weights, means and scatter of the observations of each state, and
/// what is expected of their precisions.
#[derive(Debug, Clone)]
pub struct StudentTStatistics {
    moments: Moments,
    /// Weights of each state's observations by component, not multiplied by precisions.
    counts: Vec<f64>,
    /// Sums for each state of the weights, and of E[u − 1 − ln u].
    excess: Vec<[f64; 2]>,
    weights: Vec<f64>,
    blocks: [Vec<Eight>; 2],
    memory: Vec<Eight>,
}

impl LearnLikelihood for StudentT {
    type Statistics = StudentTStatistics;

    fn statistics(&self) -> StudentTStatistics {
        let (n, d) = (self.degrees.len(), self.normals.components());
        let blocks = vec![Eight::default(); self.normals.blocks()];
        StudentTStatistics {
            moments: self.normals.moments(),
            counts: vec![0.0; n * d],
            excess: vec![[0.0; 2]; n],
            weights: vec![0.0; n],
            blocks: [blocks.clone(), blocks],
            memory: vec![Eight::default(); self.normals.memory()],
        }
    }

    fn add(&self, statistics: &mut StudentTStatistics, y: &[f64], posterior: &[f64]) {
        let StudentTStatistics { moments, counts, excess, weights, blocks, memory } = statistics;
        let observed = match self.normals.distances(y, memory) {
            Ok(observed) if observed > 0 => observed as f64,
            _ => return, // has no posterior, or says nothing
        };
        let d = self.normals.components();
        let by_component = self.normals.counts_by_component();
        let logs = ln_minus_digamma;
        for (state, (w, distance)) in posterior.iter().zip(memory.as_flattened()).enumerate() {
            let nu = self.degrees[state];
            let u = (nu + observed) / (nu + distance);
            weights[state] = w * u;
            if *w > 0.0 {
                let u_less_1 = (observed - distance) / (nu + distance);
                let value = log_excess(u_less_1) + logs(0.5 * (nu + observed)).0;
                excess[state][0] += w;
                excess[state][1] += w * value;
                let counts = counts[state * d..][..d].iter_mut().zip(y);
                let seen = counts.filter(|(_, y)| !(by_component && y.is_nan()));
                seen.for_each(|(count, _)| *count += w);
            }
        }
        let [weighted, plain] = blocks;
        in_blocks(weights, weighted);
        in_blocks(posterior, plain);
        self.normals.add(moments, y, weighted, plain, memory);
    }

    fn merge(&self, statistics: &mut StudentTStatistics, other: &StudentTStatistics) {
        statistics.moments.merge(&other.moments);
        let counts = statistics.counts.iter_mut().zip(&other.counts);
        counts.for_each(|(count, other)| *count += other);
        let excess = statistics.excess.as_flattened_mut().iter_mut();
        excess.zip(other.excess.as_flattened()).for_each(|(sum, other)| *sum += other);
    }

    fn maximize(
        &self,
        statistics: &StudentTStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (prior, counts) = (self.prior.as_ref(), Some(&*statistics.counts));
        let normals = self.normals.maximize(&statistics.moments, counts, prior)?;
        let degrees = self.degrees.iter().zip(&statistics.excess).map(|(nu, [weight, sum])| {
            if self.fixed || *weight < f64::MIN_POSITIVE {
                *nu
            } else {
                2.0 * half_degrees(sum / weight, nu / 2.0)
            }
        });
        Ok(Self::of(normals, degrees.collect(), self.fixed, self.prior.clone())?)
    }

    fn log_prior(&self, _: f64) -> f64 {
        self.prior.as_ref().map_or(0.0, |prior| prior.log_density(&self.normals))
    }

    fn free_parameters(&self) -> usize {
        self.normals.free_parameters() + if self.fixed { 0 } else { self.degrees.len() }
    }
}

/// The a at which ln a − ψ(a) has this value, above 0. It falls as 1 / a, and as 1 / 2a for large
/// a, so that Newton's method on logarithms is nearly exact.
fn half_degrees(value: f64, start: f64) -> f64 {
    let mut log = start.ln();
    for _ in 0..50 {
        let (found, slope) = ln_minus_digamma(log.exp());
        let step = (value / found).ln() * found / slope;
        log += step;
        if step.abs() <= 1e-14 * log.abs().max(1.0) {
            break;
        }
    }
    log.exp()
}
