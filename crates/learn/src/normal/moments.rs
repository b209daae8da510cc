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

use super::form::Shape;
use wayfix_kernels::{Eight, LANES, Simd, WithSimd, run};

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
    Each(&'a [Eight]),
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
        run(Add { moments: self, first: block, weights, row: Row::Each(row) });
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
            // b / (a + b) of the other's weight. Without observations there is no mean: δ is 0.
            let change = |this: &Self, c: usize| {
                let (a, b) = (this.weights[weight(c)][l], other.weights[weight(c)][l]);
                let delta = other.means[block * d + c][l] - this.means[block * d + c][l];
                let share = b / (a + b).max(f64::MIN_POSITIVE);
                (if b == 0.0 { 0.0 } else { delta }, a * share, share)
            };
            // From the side with more weight, as in `Add`.
            let mean = |this: &Self, c: usize| {
                let (old, (delta, between, share)) =
                    (this.means[block * d + c][l], change(this, c));
                if share <= 0.5 {
                    return old + delta * share;
                }
                let kept = between / other.weights[weight(c)][l];
                other.means[block * d + c][l] - delta * kept
            };
            // The scatter first, since it needs the old means, and these the old weights.
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
            let (mut share, mut kept, mut rest) = (zero, zero, zero);
            for (c, (mean, delta)) in means.iter_mut().zip(deltas.iter_mut()).enumerate() {
                let y = match row {
                    Row::From(y, _) if y[c].is_nan() => continue,
                    Row::From(y, means) => s.sub(s.splat(y[c]), s.load(&means[block * d + c])),
                    Row::Each(differences) => s.load(&differences[c]),
                };
                // With one weight for all components, those of the first component serve all. The
                // maximum avoids 0 / 0 in lanes without any weight: their share is then 0.
                if c < each {
                    let before = s.load(&sums[c]);
                    let sum = s.add(before, w);
                    s.store(sum, &mut sums[c]);
                    let sum = s.max(sum, s.splat(f64::MIN_POSITIVE));
                    (share, kept) = (s.div(w, sum), s.div(before, sum));
                    // N w / N', not w (1 − share): that is 0 where the weights before are below
                    // 1e-16 w.
                    rest = s.mul(before, share);
                }
                let old = s.load(mean);
                let change = s.sub(y, old);
                // From the side with more weight: the other may be so far away that the rounded
                // difference from it has no digit of this one.
                let (from_old, from_y) =
                    (s.add(old, s.mul(share, change)), s.sub(y, s.mul(kept, change)));
                s.store(s.select(s.lt(s.splat(0.5), share), from_y, from_old), mean);
                if shape == Shape::Diagonal {
                    let sum = s.add(s.load(&scatter[c]), s.mul(s.mul(rest, change), change));
                    s.store(sum, &mut scatter[c]);
                } else {
                    s.store(change, delta);
                }
            }
            // All differences are from the means before this observation.
            if shape == Shape::Triangular {
                let mut at = 0;
                for r in 0..d {
                    let weighted = s.mul(rest, s.load(&deltas[r]));
                    for (sum, delta) in scatter[at..=at + r].iter_mut().zip(&*deltas) {
                        s.store(s.add(s.load(sum), s.mul(weighted, s.load(delta))), sum);
                    }
                    at += r + 1;
                }
            }
        }
    }
}
