//! Learning of linear regression by weighted least squares: the M step of section 9 of the
//! formulas.
//!
//! The statistics are joint moments of the inputs x and the residuals r = y − B x − c under the
//! current lines. With the scatters X of x, Z of x and r, and R of r, and a ridge λ, the maximum of
//! −½ tr(Σ⁻¹ (Σ γ (r − D x − e)(r − D x − e)' + λ (B + D)(B + D)')) over the changes D of B and e
//! of c is at
//!
//! ```text
//! D = (Z' − λ B) (X + λ I)⁻¹              e = mean of r − D · mean of x
//! Σ = (Ψ + R − D Z − Z' D' + D X D' + λ (B + D)(B + D)') / (ν + N)
//! ```
//! Near the maximum residuals are small compared with outputs, so that little cancels.

use std::error::Error;

use super::LinearRegression;
use crate::error::{check, with_place};
use crate::normal::{
    CovarianceType, GaussianStatistics, Moments, Shape, add_missing, in_blocks, inverse_factor,
};
use crate::{EmissionError, Family, Gaussian, StartFromClusters};
use wayfix::Likelihood;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::LearnLikelihood;
use wayfix_kernels::{Eight, LANES};

/// Rounding error of a residual, relative to the terms subtracted from the output.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl LearnLikelihood for LinearRegression {
    /// Joint moments of inputs and of the differences of outputs from the current lines.
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        let (noise, width) = (self.noise.normals(), self.components());
        let moments = Moments::new(noise.count(), width, Shape::Triangular, false);
        GaussianStatistics::new(moments, 0, width + noise.scratch_blocks())
    }

    fn add(&self, statistics: &mut GaussianStatistics, row: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, weights: [weights, _], memory, .. } = statistics;
        let (values, memory) = memory.split_at_mut(self.components());
        in_blocks(posterior, weights);
        let (p, d, noise) = (self.inputs, self.outputs(), self.noise.normals());
        let (input, output) = row.split_at(p);
        let observed = output.iter().filter(|y| !y.is_nan()).count();
        if observed == 0 {
            return;
        }
        // An augmented row (x, r) for each state. Inputs are the same in all lanes.
        values.iter_mut().zip(input).for_each(|(value, x)| *value = [*x; LANES]);
        let differences = self.differences(row);
        for (block, weight) in weights.iter().enumerate() {
            if *weight == Eight::default() {
                continue;
            }
            // Complete outputs, or uncorrelated ones, need no elimination.
            let residuals = &mut values[p..];
            if observed == d || noise.kind() == CovarianceType::Diagonal {
                noise.write(&differences, block, residuals);
                moments.add_block(block, weight, values);
                for (c, _) in output.iter().enumerate().filter(|c| c.1.is_nan()) {
                    // Given nothing else, a missing output is expected on the line: its residual is
                    // 0, with the current variance.
                    let at = Shape::Triangular.entry(p + c, p + c);
                    let variances = noise.variances(block, c);
                    let sums = moments.scatter_mut(block)[at].iter_mut();
                    let products = weight.iter().zip(variances).map(|(w, v)| w * v);
                    sums.zip(products).for_each(|(sum, product)| *sum += product);
                }
                continue;
            }
            // Missing residuals have their expectation given the observed ones, and a conditional
            // covariance, as in the E step of a Gaussian.
            let expected = noise.expected(&differences, output, block, memory);
            let Ok((deltas, covariance)) = expected else { continue };
            residuals.copy_from_slice(deltas);
            moments.add_block(block, weight, values);
            add_missing(moments.scatter_mut(block), p, output, weight, covariance);
        }
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (d, moments, noise) = (self.outputs(), &statistics.moments, self.noise.normals());
        let full = noise.kind() == CovarianceType::Full;
        let (mut lines, mut covariances) = (Vec::new(), Vec::new());
        for (at, old) in self.coefficients_by_output.chunks_exact(d * (1 + self.inputs)).enumerate()
        {
            if moments.weight(at, 0) < f64::MIN_POSITIVE {
                lines.extend_from_slice(old);
                covariances.extend(&noise.covariances()[at]);
                continue;
            }
            let (new, covariance) = self.maximize_state(moments, at, old)?;
            lines.extend(new);
            // With a diagonal covariance, each output is maximised by itself. The lines are the
            // same as with a full one, since D does not depend on Σ.
            let stored = (0..d * d).filter(|k| full || k / d == k % d);
            covariances.extend(stored.map(|k| covariance[k]));
        }
        for (k, value) in lines.iter().enumerate() {
            check("line", *value, value.is_finite(), "finite coefficients")
                .map_err(|error| with_place(error, k / (d * (1 + self.inputs)), None))?;
        }
        let weight = |state: Option<usize>| state.map_or(0.0, |at| moments.weight(at, 0));
        let noise = noise.replaced(vec![0.0; noise.count() * d], covariances, weight)?;
        Ok(Self::of(Gaussian::of(noise), self.inputs, lines, self.ridge))
    }

    fn log_prior(&self, _: f64) -> f64 {
        let noise = self.noise.normals().log_prior();
        if self.ridge == 0.0 {
            return noise;
        }
        // tr(B' Σ⁻¹ B) is the sum of ‖W b‖² over the columns b of B; column 0 of a line is the
        // intercept, which is free.
        let width = 1 + self.inputs;
        let states = self.coefficients_by_output.chunks_exact(self.outputs() * width).enumerate();
        let columns = states.flat_map(|(at, lines)| (1..width).map(move |k| (at, lines, k)));
        let squares = columns.map(|(at, lines, k)| {
            self.noise.normals().whitened(at, |c| lines[c * width + k]).map(|z| z * z).sum::<f64>()
        });
        noise - 0.5 * self.ridge * squares.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        // The noise's own means are 0, and were counted.
        self.coefficients_by_output.len() + self.noise.free_parameters()
            - self.noise.states() * self.outputs()
    }
}

impl StartFromClusters for LinearRegression {}

impl LinearRegression {
    /// Lines and covariance of a state that maximise the objective, by the formulas at the top.
    fn maximize_state(
        &self,
        moments: &Moments,
        at: usize,
        old: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), EmissionError> {
        let (p, d) = (self.inputs, self.outputs());
        let (lambda, width) = (self.ridge, 1 + p);
        let x = |i: usize, j: usize| moments.scatter(at, i, j);
        let z = |i: usize, c: usize| moments.scatter(at, p + c, i);
        let penalized = |k: usize| x(k / p, k % p) + if k / p == k % p { lambda } else { 0.0 };
        let matrix: Vec<f64> = (0..p * p).map(penalized).collect();
        let weight = moments.weight(at, 0);
        for (k, value) in matrix.iter().enumerate() {
            check("scatter of inputs", *value, value.is_finite(), "a finite value")
                .map_err(|error| with_place(error, at, Some(k / p)))?;
        }
        let inverse = inverse_factor(p, &matrix).map_err(|_| EmissionError::TooFew {
            state: Some(at),
            component: None,
            what: "coefficients",
            weight,
            reason: "inputs do not vary in all directions; add a ridge (`with_ridge`)",
        })?;
        let w = |i: usize, j: usize| inverse[Shape::Triangular.entry(i, j)];
        let mut change = vec![0.0; d * p];
        for c in 0..d {
            let side = |i: usize| z(i, c) - lambda * old[c * width + 1 + i];
            // (X + λ I)⁻¹ = W' W, since W is the inverse of its Cholesky factor.
            let half: Vec<f64> = (0..p).map(|i| (0..=i).map(|j| w(i, j) * side(j)).sum()).collect();
            for j in 0..p {
                change[c * p + j] = (j..p).map(|i| w(i, j) * half[i]).sum();
            }
        }
        // Intercepts: e = mean of r − D · mean of x.
        let mut lines = old.to_vec();
        for (c, line) in lines.chunks_exact_mut(width).enumerate() {
            let change = &change[c * p..][..p];
            let moved: f64 = change.iter().enumerate().map(|(i, b)| b * moments.mean(at, i)).sum();
            line[0] += moments.mean(at, p + c) - moved;
            line[1..].iter_mut().zip(change).for_each(|(slope, change)| *slope += change);
        }
        let (nu, scale) = match self.noise.prior() {
            Some(prior) => prior.covariance(),
            None => (0.0, &[][..]),
        };
        // Only the lower triangle is computed, and read twice: the matrix is symmetric to the bit.
        let covariance = (0..d * d).map(|k| {
            let (a, b) = ((k / d).max(k % d), (k / d).min(k % d));
            let mut sum = moments.scatter(at, p + a, p + b) + scale.get(a * d + b).unwrap_or(&0.0);
            for i in 0..p {
                let (da, db) = (change[a * p + i], change[b * p + i]);
                let both: f64 = (0..p).map(|j| x(i, j) * change[b * p + j]).sum();
                sum += da * both - da * z(i, b) - db * z(i, a);
                sum += lambda * lines[a * width + 1 + i] * lines[b * width + 1 + i];
            }
            sum / (nu + weight)
        });
        let covariance: Vec<f64> = covariance.collect();
        // Outputs exactly on a line leave only rounding, which counts as no variance at all.
        for (c, line) in lines.chunks_exact(width).enumerate() {
            let size = |i: usize| moments.mean(at, i).abs() + (x(i, i) / weight).sqrt();
            let before = &old[c * width..][..width];
            // The old coefficients count as well, since residuals are differences from the old
            // lines.
            let largest = |i: usize| line[i].abs() + before[i].abs();
            let terms = (0..p).map(|i| largest(i + 1) * size(i));
            let rounding = ROUNDING * (largest(0) + terms.sum::<f64>());
            if covariance[c * d + c] <= rounding.powi(2) {
                return Err(EmissionError::TooFew {
                    state: Some(at),
                    component: Some(c),
                    what: "covariance of the noise",
                    weight,
                    reason: "they lie on a line; give a prior (`with_noise_prior`)",
                });
            }
        }
        Ok((lines, covariance))
    }
}

/// Intercept and coefficients of each output, state by state, then the covariances of the noise.
impl FreeParameters for LinearRegression {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let lines = self.coefficients_by_output.iter().map(|value| by.real(*value)).collect();
        // The noise's means are 0 by definition and are not parameters.
        let normals = self.noise.normals();
        let known = normals.clone().with(|settings| settings.fixed_means = true);
        let fixed_means = normals.settings().fixed_means;
        let noise = known.displaced(by)?.with(|settings| settings.fixed_means = fixed_means);
        Ok(Self::of(Gaussian::of(noise), self.inputs, lines, self.ridge))
    }
}
