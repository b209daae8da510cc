//! Weights of the Poisson distribution, relative to the largest, so that e^−mean never underflows.

/// Mean above which no weight is computed: no product is ever taken that often.
const FAR: f64 = (1_u64 << 36) as f64;

/// Weights e^−mean mean^k / k!, from k = 0 on. Those below 2.2e-308 of the largest are 0 before it,
/// and after it as soon as neighbours hardly differ.
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
    /// O(√mean) steps beyond mean 700, and O(mean) below.
    pub(super) fn new(mean: f64) -> Self {
        if mean > FAR {
            return Self { mean, k: 0.0, weight: 0.0, first: (f64::INFINITY, 0.0), total: 1.0 };
        }
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

    /// Goes on to the next k.
    pub(super) fn advance(&mut self) {
        self.k += 1.0;
        if self.k <= self.first.0 {
            self.weight = if self.k == self.first.0 { self.first.1 } else { 0.0 };
            return;
        }
        let ratio = self.mean / self.k;
        self.weight *= ratio;
        // A number below the normal ones may round to itself for ever.
        if self.weight < f64::MIN_POSITIVE && ratio > 0.5 {
            self.weight = 0.0;
        }
    }

    /// True if all later weights are 0, and this one is.
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
            // From the mode on they fall.
            if self.weight <= f64::EPSILON / 64.0 * sum || self.is_over() {
                return sum / self.total;
            }
            sum += self.weight;
        }
    }

    /// The factor q of a bound: later weights are at most w q, w q², … with w that of k. Below 1
    /// only after the mean.
    pub(super) fn ratio(&self) -> f64 {
        self.mean / (self.k + 1.0)
    }
}
