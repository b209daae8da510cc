//! Learning of Student's t (section 9 of the formulas): expected precisions in the E step, weighted
//! least squares in the M step.
//!
//! Given u, an observation is N(μ, Σ / u), and u is gamma with shape and rate ν/2. Its posterior is
//! gamma with shape (ν + k)/2 and rate (ν + δ²)/2, for k observed components at the squared
//! distance δ²:
//!
//! ```text
//! E[u]     = (ν + k) / (ν + δ²)
//! E[ln u]  = ψ((ν + k)/2) − ln((ν + δ²)/2)
//! ```

use std::error::Error;

use super::StudentT;
use crate::normal::{GaussianStatistics, in_blocks};
use crate::special::{inverse_ln_minus_digamma, ln_minus_digamma, log_excess};
use crate::{Family, Gaussian};
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::LearnLikelihood;

impl LearnLikelihood for StudentT {
    /// The sums are the weights γ, without precisions u, by state and component, and then for each
    /// state the sum of γ and that of γ E[u − 1 − ln u].
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.gaussian.normals().statistics(self.degrees.len() * (self.gaussian.components() + 2))
    }

    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, sums, weights: [weighted, plain], memory } = statistics;
        let normals = self.gaussian.normals();
        let observed = match normals.distances(y, memory) {
            Ok(observed) if observed > 0 => observed as f64,
            _ => return, // invalid, or entirely missing
        };
        let d = normals.components();
        let by_component = normals.counts_by_component();
        let (counts, excess) = sums.split_at_mut(self.degrees.len() * d);
        let excess = excess.as_chunks_mut::<2>().0;
        // Lanes beyond the last state stay at 0.
        let weights = weighted.as_flattened_mut();
        for (state, (w, distance)) in posterior.iter().zip(memory.as_flattened()).enumerate() {
            let nu = self.degrees[state];
            // Means and scales are weighted by γ E[u], as in the formula at the top.
            let u = (nu + observed) / (nu + distance);
            weights[state] = w * u;
            if *w > 0.0 {
                // E[u − 1 − ln u] = (E[u] − 1 − ln E[u]) + (ln a − ψ(a)) with a = (ν + k)/2: two
                // positive terms, each exact. A difference of 1 would cancel for large ν.
                let u_less_1 = (observed - distance) / (nu + distance);
                let value = log_excess(u_less_1) + ln_minus_digamma(0.5 * (nu + observed)).0;
                excess[state][0] += w;
                excess[state][1] += w * value;
                // The scale is divided by Σ γ, not Σ γ u. A component that is expected given the
                // others counts; one that is left out does not.
                let counts = counts[state * d..][..d].iter_mut().zip(y);
                let seen = counts.filter(|(_, y)| !(by_component && y.is_nan()));
                seen.for_each(|(count, _)| *count += w);
            }
        }
        // The conditional covariance of missing components is Σ / u, and weighted by γ u it counts
        // with γ alone.
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
        // Q as a function of ν is Σ γ (ν/2 · (ln(ν/2) + E[ln u − u]) − ln Γ(ν/2)): its derivative
        // is 0 where ln(ν/2) − ψ(ν/2) is the mean of E[u − 1 − ln u]. The left side falls in ν, so
        // that the root is unique.
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

/// Means, then scales, then degrees of freedom, except those that learning keeps.
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
