//! Compensated sum of logarithms.

/// Compensated sum of many logarithms (Neumaier 1974), so that a million steps do not drift.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LogSum {
    pub(crate) sum: f64,
    pub(crate) lost: f64,
}

impl LogSum {
    #[inline]
    pub(crate) fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// Clears the compensation of an infinite sum, which is NaN and unused.
    pub(crate) fn known(self) -> Self {
        if self.sum.is_finite() { self } else { Self { sum: self.sum, lost: 0.0 } }
    }

    /// True if sum and compensation together are finite; both may be damaged.
    pub(crate) fn is_finite(self) -> bool {
        self.sum.is_finite() && (self.sum + self.lost).is_finite()
    }

    pub(crate) fn value(self) -> f64 {
        // An infinite sum has no meaningful compensation.
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}
