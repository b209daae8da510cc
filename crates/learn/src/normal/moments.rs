//! Weighted moments of differences from current means, the statistics of the Gaussian families.
//!
//! An observation x of weight w changes the weight N, mean m and scatter S to
//!
//! ```text
//! N' = N + w,    m' = m + (w / N') (x − m),    S' = S + (N w / N') (x − m)(x − m)'
//! ```
//!
//! (West 1979), and two sets of observations merge likewise (Chan, Golub and LeVeque 1983). All
//! terms of S are positive, so that no digits cancel for values far from 0, as they do in
//! Σ w x² − N m².

use wayfix::inference::Displacement;
use wayfix_kernels::{Eight, LANES, Simd, WithSimd, run};

use super::Normals;
use super::covariance::{CovarianceType, Shape, check_covariances};
use crate::EmissionError;
use crate::error::{check, with_place};

/// Statistics of a Gaussian family: weight, mean and scatter of the observations of each density,
/// further sums of the family, and memory for one observation.
#[derive(Debug, Clone)]
pub struct GaussianStatistics {
    pub(crate) moments: Moments,
    pub(crate) sums: Vec<f64>,
    /// Weights of an observation in blocks: those of its values, and those of the conditional
    /// covariance of its missing components, if they differ.
    pub(crate) weights: [Vec<Eight>; 2],
    pub(crate) memory: Vec<Eight>,
}

impl GaussianStatistics {
    /// Returns empty statistics with `sums` further sums and `memory` blocks of memory.
    pub(crate) fn new(moments: Moments, sums: usize, memory: usize) -> Self {
        let blocks = vec![Eight::default(); moments.blocks()];
        let memory = vec![Eight::default(); memory];
        Self { moments, sums: vec![0.0; sums], weights: [blocks.clone(), blocks], memory }
    }

    /// Adds the statistics of other observations.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.moments.merge(&other.moments);
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, other)| *sum += other);
    }
}

/// Weights, means and scatter about them, for eight densities side by side.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    shape: Shape,
    d: usize,
    /// True if each component has its own weights, since others may be missing.
    by_component: bool,
    /// For each block, 1 or d weights, d means, and d or d (d + 1) / 2 sums of products.
    weights: Vec<Eight>,
    means: Vec<Eight>,
    scatters: Vec<Eight>,
    deltas: Vec<Eight>,
}

/// Source of the differences of an observation from the current means of the family.
#[derive(Clone, Copy)]
enum Row<'a> {
    /// An observation, and the means of all blocks.
    From(&'a [f64], &'a [Eight]),
    /// The differences of one block.
    Differences(&'a [Eight]),
}

impl Moments {
    pub(crate) fn new(count: usize, d: usize, shape: Shape, by_component: bool) -> Self {
        let blocks = count.div_ceil(LANES);
        let zeros = |each: usize| vec![Eight::default(); blocks * each];
        Self {
            shape,
            d,
            by_component,
            weights: zeros(if by_component { d } else { 1 }),
            means: zeros(d),
            scatters: zeros(shape.entries(d)),
            deltas: vec![Eight::default(); d],
        }
    }

    fn blocks(&self) -> usize {
        self.weights.len() / self.weights_each()
    }

    fn weights_each(&self) -> usize {
        if self.by_component { self.d } else { 1 }
    }

    /// Adds an observation's differences from `means`, with these weights for each block.
    #[inline]
    pub(super) fn add(&mut self, weights: &[Eight], y: &[f64], means: &[Eight]) {
        run(Add { moments: self, first: 0, weights, row: Row::From(y, means) });
    }

    /// Adds differences to one block.
    #[inline]
    pub(crate) fn add_block(&mut self, block: usize, weight: &Eight, row: &[Eight]) {
        let weights = std::slice::from_ref(weight);
        run(Add { moments: self, first: block, weights, row: Row::Differences(row) });
    }

    /// Scatter of a block, packed.
    pub(crate) fn scatter_mut(&mut self, block: usize) -> &mut [Eight] {
        let each = self.shape.entries(self.d);
        &mut self.scatters[block * each..][..each]
    }

    fn merge(&mut self, other: &Self) {
        let (d, each, entries) = (self.d, self.weights_each(), self.shape.entries(self.d));
        for at in 0..self.blocks() * LANES {
            let (block, l) = (at / LANES, at % LANES);
            let weight = |c: usize| block * each + if each == 1 { 0 } else { c };
            // Difference δ of the means, its weight a b / (a + b) in the scatter, and the share
            // b / (a + b) of the other's weight. Without observations the mean is undefined, and δ
            // is 0.
            let change = |this: &Self, c: usize| {
                let (a, b) = (this.weights[weight(c)][l], other.weights[weight(c)][l]);
                let delta = other.means[block * d + c][l] - this.means[block * d + c][l];
                let share = b / (a + b).max(f64::MIN_POSITIVE);
                (if b == 0.0 { 0.0 } else { delta }, a * share, share)
            };
            // Computed from the side with more weight, as in `Add`.
            let mean = |this: &Self, c: usize| {
                let (old, (delta, between, share)) =
                    (this.means[block * d + c][l], change(this, c));
                if share <= 0.5 {
                    return old + delta * share;
                }
                let kept = between / other.weights[weight(c)][l];
                other.means[block * d + c][l] - delta * kept
            };
            // The scatter comes first, since it needs the old means. The means come next, since
            // they need the old weights.
            let (mut entry, scatter) = (0, block * entries);
            for r in 0..d {
                let (delta, between, _) = change(self, r);
                let columns = if self.shape == Shape::Diagonal { r..r + 1 } else { 0..r + 1 };
                for c in columns {
                    let product = between * delta * change(self, c).0;
                    let sum = &mut self.scatters[scatter + entry][l];
                    *sum += other.scatters[scatter + entry][l] + product;
                    entry += 1;
                }
            }
            for c in 0..d {
                self.means[block * d + c][l] = mean(self, c);
            }
            for c in 0..each {
                self.weights[weight(c)][l] += other.weights[weight(c)][l];
            }
        }
    }

    /// Sum of the weights of one density, or of one of its components if these differ.
    pub(crate) fn weight(&self, at: usize, component: usize) -> f64 {
        let each = self.weights_each();
        self.weights[at / LANES * each + if each == 1 { 0 } else { component }][at % LANES]
    }

    pub(crate) fn mean(&self, at: usize, component: usize) -> f64 {
        self.means[at / LANES * self.d + component][at % LANES]
    }

    /// Entry of the scatter about the mean; with a diagonal shape i = j is assumed.
    pub(crate) fn scatter(&self, at: usize, i: usize, j: usize) -> f64 {
        let entry = self.shape.entry(i, j);
        self.scatters[at / LANES * self.shape.entries(self.d) + entry][at % LANES]
    }
}

/// Adds an observation to blocks of densities.
struct Add<'a> {
    moments: &'a mut Moments,
    first: usize,
    weights: &'a [Eight],
    row: Row<'a>,
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { moments, first, weights, row } = self;
        let (d, each, shape) = (moments.d, moments.weights_each(), moments.shape);
        let entries = shape.entries(d);
        let deltas = &mut moments.deltas[..d];
        for (block, weight) in (first..).zip(weights) {
            // Most posteriors of a step are 0 in models of many states.
            if *weight == Eight::default() {
                continue;
            }
            let w = s.load(weight);
            let sums = &mut moments.weights[block * each..][..each];
            let means = &mut moments.means[block * d..][..d];
            let scatter = &mut moments.scatters[block * entries..][..entries];
            let zero = s.splat(0.0);
            let (mut share, mut kept, mut between_weight) = (zero, zero, zero);
            for (c, (mean, delta)) in means.iter_mut().zip(deltas.iter_mut()).enumerate() {
                let y = match row {
                    Row::From(y, _) if y[c].is_nan() => continue,
                    Row::From(y, means) => s.sub(s.splat(y[c]), s.load(&means[block * d + c])),
                    Row::Differences(differences) => s.load(&differences[c]),
                };
                // With one weight for all components, those of the first component serve all. The
                // maximum avoids 0 / 0 in lanes without any weight: their share is then 0.
                if c < each {
                    let before = s.load(&sums[c]);
                    let sum = s.add(before, w);
                    s.store(sum, &mut sums[c]);
                    let sum = s.max(sum, s.splat(f64::MIN_POSITIVE));
                    (share, kept) = (s.div(w, sum), s.div(before, sum));
                    // N w / N' for the weights N before and N' after. The form w (1 − share) would
                    // be 0 where N is below 1e-16 w.
                    between_weight = s.mul(before, share);
                }
                let old = s.load(mean);
                let change = s.sub(y, old);
                // Computed from the side with more weight: if the other side is far away, the
                // rounded difference keeps no digit of this one.
                let (from_old, from_y) =
                    (s.add(old, s.mul(share, change)), s.sub(y, s.mul(kept, change)));
                s.store(s.select(s.lt(s.splat(0.5), share), from_y, from_old), mean);
                if shape == Shape::Diagonal {
                    let sum =
                        s.add(s.load(&scatter[c]), s.mul(s.mul(between_weight, change), change));
                    s.store(sum, &mut scatter[c]);
                } else {
                    s.store(change, delta);
                }
            }
            // All differences are from the means before this observation.
            if shape == Shape::Triangular {
                let mut at = 0;
                for r in 0..d {
                    let weighted = s.mul(between_weight, s.load(&deltas[r]));
                    for (sum, delta) in scatter[at..=at + r].iter_mut().zip(&*deltas) {
                        s.store(s.add(s.load(sum), s.mul(weighted, s.load(delta))), sum);
                    }
                    at += r + 1;
                }
            }
        }
    }
}

// M step of normal densities (section 9 of the formulas): the maximum of Σ γ ln b + ln p(θ), in
// closed form.
//
// The moments are of differences from the old means, with weight N, mean m and scatter S about m.
// With the prior's κ, μ0, ν and Ψ (all 0 without a prior),
//
// ```text
// μ = (κ μ0 + N ȳ) / (κ + N)                 ȳ = old mean + m
// Σ = (Ψ + S + N (ȳ − μ)(ȳ − μ)' + κ (μ − μ0)(μ − μ0)') / (ν + N)
// ```
//
// A diagonal covariance takes the diagonal of Σ, a spherical one the mean of that, and a tied one
// the sums over all densities that share it. In a Student's t family the weights of the
// moments are γ u, and N in the divisor of Σ is Σ γ, given as `counts`.

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
            // In this form the change is exactly m if κ is 0.
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
        let sharing = |number: usize| {
            number * self.densities_per_covariance()..(number + 1) * self.densities_per_covariance()
        };
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
            Some(at) => {
                sharing(at / self.densities_per_covariance()).map(all_of).sum::<f64>() / d as f64
            }
            None => (0..count).map(|at| counted(at, 0)).sum(),
        };
        let new = self.replaced(means, covariances, total)?;
        // If all observations are alike, rounding of the change of the mean still leaves a small
        // variance, which counts as 0.
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
        let covariances = (0..count).step_by(self.densities_per_covariance()).map(|at| {
            // tr(Ψ Σ⁻¹) = tr(W Ψ W') is the sum of w Ψ w' over the rows w of W.
            let trace: f64 = (0..d)
                .map(|row| {
                    let all = self.kind.shape() == Shape::Triangular;
                    let entries = if all { 0..row + 1 } else { row..row + 1 };
                    let pairs = entries.clone().flat_map(|i| entries.clone().map(move |j| (i, j)));
                    pairs
                        .map(|(i, j)| {
                            // Multiplied in this order, since the product of the two entries of W
                            // may overflow.
                            let scaled =
                                self.inverse_factor_entry(at, row, i) * prior.scale[i * d + j];
                            scaled * self.inverse_factor_entry(at, row, j)
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
                .map_err(|error| with_place(error, k / self.d, Some(k % self.d)))?;
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
                let state = state.map(|number| number * self.densities_per_covariance());
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
