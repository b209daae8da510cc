//! Limits on the pruning, and the certificate of a step: the bound D / (K + D) of section 13 of the
//! [formulas](crate::guide::formulas), compared with the tolerance.

/// Limits on the pruning of a [`PrunedFilter`](crate::PrunedFilter).
///
/// ```
/// use wayfix::inference::Pruning;
///
/// let pruning = Pruning { tolerance: 1e-9, ..Pruning::default() };
/// assert_eq!(pruning.most_active, usize::MAX);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pruning {
    /// Tolerated distance of the belief from the exact one, in total variation; 1e-6 by default.
    /// At 0 (or less, or NaN) only states below 1e-290 are dropped.
    pub tolerance: f64,
    /// Largest number of active states, unlimited by default. It bounds the time of a step, and
    /// takes precedence over the tolerance.
    pub most_active: usize,
}

impl Default for Pruning {
    fn default() -> Self {
        Self { tolerance: 1e-6, most_active: usize::MAX }
    }
}

/// Proven bound on the distance of a pruned belief from the exact one in total variation, with the
/// answer whether it is within the tolerance.
///
/// The total variation is the largest error in the probability of any event: half the sum of all
/// absolute differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// A bound that is at most the tolerance.
    Within(f64),
    /// A bound that is above the tolerance. The belief is still the best estimate, and the bound
    /// may recover.
    Exceeded(f64),
}

impl Certificate {
    pub(crate) fn of(bound: f64, pruning: Pruning) -> Self {
        // Every comparison with a NaN tolerance is false, so no bound is within it.
        if bound <= pruning.tolerance { Self::Within(bound) } else { Self::Exceeded(bound) }
    }

    /// Returns the bound, from 0 to 1.
    #[must_use]
    pub fn bound(self) -> f64 {
        let (Self::Within(bound) | Self::Exceeded(bound)) = self;
        bound
    }

    /// Returns true if the bound is at most the tolerance.
    #[must_use]
    pub fn holds(self) -> bool {
        matches!(self, Self::Within(_))
    }
}
