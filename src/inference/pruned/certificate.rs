//! How much may be left out, and what is proven.

/// How much a [`PrunedFilter`](crate::PrunedFilter) may leave out.
///
/// ```
/// use wayfix::inference::Pruning;
///
/// let pruning = Pruning { tolerance: 1e-9, ..Pruning::default() };
/// assert_eq!(pruning.most_active, usize::MAX);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pruning {
    /// How far the belief may be from the exact one, in total variation; 1e-6
    /// unless changed. At 0 (or less, or NaN) nothing is left out that a double
    /// holds.
    pub tolerance: f64,
    /// How many states may be followed at most, whatever that costs in certainty;
    /// any number unless changed. It bounds the time of a step.
    pub most_active: usize,
}

impl Default for Pruning {
    fn default() -> Self {
        Self { tolerance: 1e-6, most_active: usize::MAX }
    }
}

/// What is proven of a pruned belief: how far it is at most from the exact one,
/// in total variation, and whether that is within the tolerance.
///
/// The total variation is the most by which the probability of any event can be
/// wrong: half the sum of all differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// The bound, which is at most the tolerance.
    Held(f64),
    /// The bound, which is above the tolerance. The belief is still the best
    /// guess, and the bound may come back.
    Exceeded(f64),
}

impl Certificate {
    pub(super) fn of(bound: f64, pruning: Pruning) -> Self {
        if bound <= pruning.tolerance { Self::Held(bound) } else { Self::Exceeded(bound) }
    }

    /// The bound, from 0 to 1.
    #[must_use]
    pub fn bound(self) -> f64 {
        let (Self::Held(bound) | Self::Exceeded(bound)) = self;
        bound
    }

    /// Whether the bound is at most the tolerance.
    #[must_use]
    pub fn holds(self) -> bool {
        matches!(self, Self::Held(_))
    }
}
