//! Weights of the Poisson distribution, relative to the largest, so that e^−mean never underflows.

/// Mean above which no weight is computed: that many products are never taken.
const FAR: f64 = (1_u64 << 36) as f64;

/// Weights e^−mean mean^k / k! for k = 0, 1, …. Before the largest, those below 2.2e-308 of it are
/// 0; after it, they are 0 below 2.2e-308 if neighbours differ by less than a factor of 2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Poisson {
    mean: f64,
    k: f64,
    /// Weight of k over the largest.
    weight: f64,
    /// The first k with a weight, and that weight.
    first: (f64, f64),
    /// Sum of all weights over the largest.
    total: f64,
}

impl Poisson {
    /// Computes the total weight, and where weights begin: O(√mean) steps for means above 700, and
    /// O(mean) below.
    pub(super) fn new(mean: f64) -> Self {
        if mean > FAR {
            return Self { mean, k: 0.0, weight: 0.0, first: (f64::INFINITY, 0.0), total: 1.0 };
        }
        // Outwards from the mode, where the weight is set to 1, by w_{k-1} = w_k k / mean and
        // w_{k+1} = w_k mean / (k + 1): weights fall on both sides, so that the sums are accurate.
        let mode = mean.floor();
        let (mut first, mut total) = ((mode, 1.0), 1.0);
        while first.0 > 0.0 {
            let before = first.1 * first.0 / mean;
            if before < f64::MIN_POSITIVE {
                break;
            }
            first = (first.0 - 1.0, before);
            total += before;
        }
        let (mut k, mut weight) = (mode, 1.0);
        while weight > f64::EPSILON / 64.0 * total {
            k += 1.0;
            weight *= mean / k;
            total += weight;
        }
        let weight = if first.0 == 0.0 { first.1 } else { 0.0 };
        Self { mean, k: 0.0, weight, first, total }
    }

    /// Probability of k.
    pub(super) fn weight(&self) -> f64 {
        self.weight / self.total
    }

    /// Moves to the next k.
    pub(super) fn advance(&mut self) {
        self.k += 1.0;
        // Weights before the first are 0, so the recursion has to be started there.
        if self.k <= self.first.0 {
            self.weight = if self.k == self.first.0 { self.first.1 } else { 0.0 };
            return;
        }
        let ratio = self.mean / self.k;
        self.weight *= ratio;
        // A subnormal times a ratio near 1 may round to itself forever.
        if self.weight < f64::MIN_POSITIVE && ratio > 0.5 {
            self.weight = 0.0;
        }
    }

    /// True if this weight and all later ones are 0.
    pub(super) fn is_over(&self) -> bool {
        self.weight == 0.0 && self.k >= self.first.0
    }

    /// Sum of the weights after k.
    pub(super) fn rest(mut self) -> f64 {
        if self.k < self.first.0 {
            return 1.0;
        }
        let mut sum = 0.0;
        loop {
            self.advance();
            // The sum must be beyond the mode to end: before it, weights grow, and none is small
            // beside the sum of those before.
            if self.weight <= f64::EPSILON / 64.0 * sum || self.is_over() {
                return sum / self.total;
            }
            sum += self.weight;
        }
    }

    /// The ratio q in a bound on later weights: with w for that of k, they are at most w q, w q², …
    /// Below 1 only beyond the mean.
    pub(super) fn ratio(&self) -> f64 {
        self.mean / (self.k + 1.0)
    }
}
