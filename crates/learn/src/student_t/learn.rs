//! Student's t, learned: expected precisions, and the M step of section 9 of the formulas.

use std::error::Error;

use super::StudentT;
use crate::normal::{GaussianStatistics, in_blocks};
use crate::special::{inverse_ln_minus_digamma, ln_minus_digamma, log_excess};
use crate::{Family, Gaussian};
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::LearnLikelihood;

impl LearnLikelihood for StudentT {
    /// The sums are, by state and component, the weights of observations that are not multiplied
    /// by precisions u, and then for each state the sums of the weights and of E[u − 1 − ln u].
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.gaussian.normals().statistics(self.degrees.len() * (self.gaussian.components() + 2))
    }

    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, sums, weights: [weighted, plain], memory } = statistics;
        let normals = self.gaussian.normals();
        let observed = match normals.distances(y, memory) {
            Ok(observed) if observed > 0 => observed as f64,
            _ => return, // has no posterior, or says nothing
        };
        let d = normals.components();
        let by_component = normals.counts_by_component();
        let (counts, excess) = sums.split_at_mut(self.degrees.len() * d);
        let excess = excess.as_chunks_mut::<2>().0;
        // Lanes after the last state keep their 0.
        let weights = weighted.as_flattened_mut();
        for (state, (w, distance)) in posterior.iter().zip(memory.as_flattened()).enumerate() {
            let nu = self.degrees[state];
            let u = (nu + observed) / (nu + distance);
            weights[state] = w * u;
            if *w > 0.0 {
                let u_less_1 = (observed - distance) / (nu + distance);
                let value = log_excess(u_less_1) + ln_minus_digamma(0.5 * (nu + observed)).0;
                excess[state][0] += w;
                excess[state][1] += w * value;
                let counts = counts[state * d..][..d].iter_mut().zip(y);
                let seen = counts.filter(|(_, y)| !(by_component && y.is_nan()));
                seen.for_each(|(count, _)| *count += w);
            }
        }
        in_blocks(posterior, plain);
        normals.add(moments, y, weighted, plain, memory);
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let normals = self.gaussian.normals();
        let (counts, excess) = statistics.sums.split_at(self.degrees.len() * normals.components());
        let gaussian = Gaussian::of(normals.maximize(&statistics.moments, Some(counts))?);
        let excess = excess.as_chunks::<2>().0;
        let degrees = self.degrees.iter().zip(excess).map(|(nu, [weight, sum])| {
            if self.fixed || *weight < f64::MIN_POSITIVE {
                *nu
            } else {
                2.0 * inverse_ln_minus_digamma(sum / weight, nu / 2.0)
            }
        });
        Ok(Self::of(gaussian, degrees.collect(), self.fixed)?)
    }

    fn log_prior(&self, _: f64) -> f64 {
        self.gaussian.normals().log_prior()
    }

    fn free_parameters(&self) -> usize {
        self.gaussian.free_parameters() + if self.fixed { 0 } else { self.degrees.len() }
    }
}

/// Means, then scales, then degrees of freedom, unless learning keeps them.
impl FreeParameters for StudentT {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let gaussian = self.gaussian.displaced(by)?;
        let mut degrees = self.degrees.clone();
        if !self.fixed {
            degrees.iter_mut().for_each(|nu| *nu = by.positive(*nu));
        }
        Ok(Self::of(gaussian, degrees, self.fixed)?)
    }
}
