//! M step of normal densities (section 9 of the formulas): the maximum of Σ γ ln b + ln p(θ), in
//! closed form.
//!
//! The moments are of differences from the old means, with weight N, mean m and scatter S about m.
//! With the prior's κ, μ0, ν and Ψ (all 0 without a prior),
//!
//! ```text
//! μ = (κ μ0 + N ȳ) / (κ + N)                 ȳ = old mean + m
//! Σ = (Ψ + S + N (ȳ − μ)(ȳ − μ)' + κ (μ − μ0)(μ − μ0)') / (ν + N)
//! ```
//!
//! of which a diagonal covariance takes the diagonal, a spherical one the mean of that, and a tied
//! one the sums over all densities that share it. In a Student's t family the weights of the
//! moments are γ u, and N in the divisor of Σ is Σ γ, given as `counts`.

use super::check::check_covariances;
use super::form::{CovarianceType, Shape};
use super::moments::Moments;
use super::normals::Normals;
use crate::EmissionError;
use crate::check::{at, check};
use wayfix::inference::Displacement;

const REASON: &str = "they do not vary in all directions; give a prior (`with_prior`)";

impl Normals {
    /// Returns the densities that maximise the objective. `counts`, d for each density, are the
    /// divisors of the covariances if these are not the weights of the moments.
    pub(crate) fn maximize(
        &self,
        moments: &Moments,
        counts: Option<&[f64]>,
    ) -> Result<Self, EmissionError> {
        let (d, count, prior) = (self.d, self.count(), self.settings.prior.as_ref());
        let (kappa, nu) = prior.map_or((0.0, 0.0), |p| (p.mean_weight, p.covariance_weight));
        let origin = |c: usize| prior.map_or(0.0, |p| p.mean[c]);
        let scale = |i: usize, j: usize| prior.map_or(0.0, |p| p.scale[i * d + j]);
        let weight = |at: usize, c: usize| moments.weight(at, c);
        let counted =
            |at: usize, c: usize| counts.map_or(weight(at, c), |counts| counts[at * d + c]);
        let known = |at: usize, c: usize| weight(at, c) >= f64::MIN_POSITIVE;

        let (fixed_means, fixed_covariances) =
            (self.settings.fixed_means, self.settings.fixed_covariances);

        // Changes of the means, 0 without observations. μ − old = m + κ / (κ + N) (μ0 − old − m):
        // relative to the old mean, so that no digits of a distant mean are lost.
        let change = |at: usize, c: usize| {
            if fixed_means || !known(at, c) {
                return 0.0;
            }
            let (weight, old) = (weight(at, c), self.means[at * d + c]);
            // In this form exactly m if κ is 0.
            let (seen, share) = (moments.mean(at, c), kappa / (kappa + weight));
            seen + share * (origin(c) - old - seen)
        };
        let changes: Vec<f64> = (0..count * d).map(|k| change(k / d, k % d)).collect();
        let means: Vec<f64> = self.means.iter().zip(&changes).map(|(m, c)| m + c).collect();
        // Exact rounding errors of these sums (Knuth's TwoSum). The covariance is taken about the
        // mean that is stored, rounding included, since it is the maximum for that mean.
        let rounded = |k: usize| {
            let (old, change, new) = (self.means[k], changes[k], means[k]);
            let part = new - old;
            (old - (new - part)) + (change - part)
        };
        // S + N (ȳ − μ)(ȳ − μ)' + κ (μ − μ0)(μ − μ0)'. Without κ the last term is left out, as the
        // product of the differences could overflow.
        let scatter = |at: usize, i: usize, j: usize| {
            let from = |c: usize| means[at * d + c] - origin(c);
            let moved = |c: usize| moments.mean(at, c) - changes[at * d + c] + rounded(at * d + c);
            let about_prior = if kappa == 0.0 { 0.0 } else { kappa * from(i) * from(j) };
            let about_mean = if known(at, i) {
                moments.scatter(at, i, j) + weight(at, i) * moved(i) * moved(j)
            } else {
                0.0
            };
            about_mean + about_prior
        };
        let mut covariances = self.covariances.clone();
        let each = self.kind.values(d);
        let all_of = |at: usize| (0..d).map(move |c| counted(at, c)).sum::<f64>();
        let sharing = |number: usize| number * self.sharing()..(number + 1) * self.sharing();
        let learned = if fixed_covariances { 0 } else { covariances.len() };
        for (position, value) in covariances[..learned].iter_mut().enumerate() {
            let at = position / each;
            // The same sum on both sides of the diagonal makes the matrix symmetric to the bit.
            let (i, j) = (position % each / d, position % d);
            let (i, j) = (i.max(j), i.min(j));
            // Without observations the covariance stays as it is.
            match self.kind {
                CovarianceType::Spherical if (0..d).any(|c| known(at, c)) => {
                    let seen = (0..d).map(|c| scale(c, c) + scatter(at, c, c)).sum::<f64>();
                    *value = seen / (nu * d as f64 + all_of(at));
                }
                CovarianceType::Diagonal if known(at, i) => {
                    *value = (scale(i, i) + scatter(at, i, i)) / (nu + counted(at, i));
                }
                CovarianceType::Full if known(at, 0) => {
                    *value = (scale(i, j) + scatter(at, i, j)) / (nu + counted(at, 0));
                }
                CovarianceType::Tied if sharing(at).any(|at| known(at, 0)) => {
                    let seen = sharing(at).map(|at| scatter(at, i, j)).sum::<f64>();
                    let total = sharing(at).map(|at| counted(at, 0)).sum::<f64>();
                    *value = (scale(i, j) + seen) / (nu + total);
                }
                _ => {}
            }
        }
        // Weight of all densities that share the covariance of this one, for error messages.
        let total = |state: Option<usize>| match state {
            Some(at) => sharing(at / self.sharing()).map(all_of).sum::<f64>() / d as f64,
            None => (0..count).map(|at| counted(at, 0)).sum(),
        };
        let new = self.replaced(means, covariances, total)?;
        // If all observations are alike, rounding of the change of the mean still leaves a small
        // variance, which is taken for the 0 that it stands for.
        let rounding = |at: usize, c: usize| {
            let size = self.means[at * d + c].abs() + changes[at * d + c].abs();
            (f64::EPSILON * size).powi(2)
        };
        let is_rounding = |k: &usize| {
            let (at, c) = (k / d, k % d);
            !fixed_covariances && known(at, c) && new.covariance(at, c, c) <= rounding(at, c)
        };
        match (0..count * d).find(is_rounding) {
            None => Ok(new),
            Some(k) => {
                let (state, component) = (Some(k / d), Some(k % d));
                let (what, weight, reason) = (self.kind.name(), total(state), REASON);
                Err(EmissionError::TooFew { state, component, what, weight, reason })
            }
        }
    }

    /// Log density of the prior at the parameters of all densities, up to its constant:
    /// −½ Σ κ ‖W (μ − μ0)‖² − ½ Σ (ν ln det Σ + tr(Ψ Σ⁻¹)), the second sum over distinct
    /// covariances. 0 without a prior.
    pub(crate) fn log_prior(&self) -> f64 {
        let Some(prior) = &self.settings.prior else { return 0.0 };
        let (d, count) = (self.d, self.count());
        let means = (0..count).map(|at| {
            let mean = &self.means[at * d..];
            let squares = self.whitened(at, |i| mean[i] - prior.mean[i]).map(|z| z * z);
            prior.mean_weight * squares.sum::<f64>()
        });
        let means = if prior.mean_weight == 0.0 { 0.0 } else { means.sum::<f64>() };
        let covariances = (0..count).step_by(self.sharing()).map(|at| {
            // tr(Ψ Σ⁻¹) = tr(W Ψ W') is the sum of w Ψ w' over the rows w of W.
            let trace: f64 = (0..d)
                .map(|row| {
                    let all = self.kind.shape() == Shape::Triangular;
                    let entries = if all { 0..row + 1 } else { row..row + 1 };
                    let pairs = entries.clone().flat_map(|i| entries.clone().map(move |j| (i, j)));
                    pairs
                        .map(|(i, j)| {
                            // In this order, since the product of the two entries of W may
                            // overflow.
                            let scaled = self.inverse(at, row, i) * prior.scale[i * d + j];
                            scaled * self.inverse(at, row, j)
                        })
                        .sum::<f64>()
                })
                .sum();
            prior.covariance_weight * self.log_determinant(at) + trace
        });
        -0.5 * (means + covariances.sum::<f64>())
    }

    /// Returns densities of the same form with other parameters. A covariance that is not positive
    /// definite is reported as [`EmissionError::TooFew`], with `weight` of its density, or of all.
    pub(crate) fn replaced(
        &self,
        means: Vec<f64>,
        covariances: Vec<f64>,
        weight: impl Fn(Option<usize>) -> f64,
    ) -> Result<Self, EmissionError> {
        for (k, mean) in means.iter().enumerate() {
            check("mean", *mean, mean.is_finite(), "a finite value")
                .map_err(|error| at(error, k / self.d, Some(k % self.d)))?;
        }
        let new = check_covariances(self.kind, self.d, &covariances)
            .and_then(|()| Self::new(self.kind, self.d, means, covariances, self.settings.clone()));
        // A variance below 2.2e-308 or a matrix that cannot be factored means that the observations
        // do not vary enough; NaN or an infinite value stays an error of the parameter.
        new.map_err(|error| match error {
            EmissionError::Parameter { value, .. }
                if value.is_nan() || value >= f64::MIN_POSITIVE =>
            {
                error
            }
            EmissionError::NotPositiveDefinite { state, .. }
            | EmissionError::Parameter { state, .. } => {
                // The first density that has this covariance.
                let state = state.map(|number| number * self.sharing());
                let (weight, component, what) = (weight(state), None, self.kind.name());
                EmissionError::TooFew { state, component, what, weight, reason: REASON }
            }
            other => other,
        })
    }

    /// True if missing components are left out of the statistics, rather than replaced by their
    /// expectation.
    pub(crate) fn counts_by_component(&self) -> bool {
        self.settings.missing && self.kind.shape() == Shape::Diagonal
    }

    /// Number of free parameters.
    pub(crate) fn free_parameters(&self) -> usize {
        let of_means = if self.settings.fixed_means { 0 } else { self.count() * self.d };
        of_means
            + if self.settings.fixed_covariances {
                0
            } else {
                self.matrices() * self.kind.free(self.d)
            }
    }

    /// Displaces the means, then the covariances, except those that learning keeps.
    pub(crate) fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, EmissionError> {
        let (mut means, mut covariances) = (self.means.clone(), self.covariances.clone());
        if !self.settings.fixed_means {
            means.iter_mut().for_each(|mean| *mean = by.real(*mean));
        }
        if !self.settings.fixed_covariances {
            for matrix in covariances.chunks_exact_mut(self.kind.values(self.d)) {
                match self.kind.shape() {
                    Shape::Diagonal => matrix.iter_mut().for_each(|v| *v = by.positive(*v)),
                    Shape::Triangular => by.covariance(matrix, self.d),
                }
            }
        }
        Self::new(self.kind, self.d, means, covariances, self.settings.clone())
    }
}
