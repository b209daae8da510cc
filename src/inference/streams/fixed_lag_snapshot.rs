//! State of a fixed-lag smoother, as plain data.

use super::filter_snapshot::FilterSnapshot;

/// State of a fixed-lag smoother: plain data, to be kept, compared, sent elsewhere and restored.
///
/// Made by [`FixedLag::snapshot`](crate::FixedLag::snapshot). [`to_bytes`](Self::to_bytes) stores
/// it; under a control, [`to_bytes_with`](Self::to_bytes_with), with the last controls.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedLagSnapshot<U> {
    pub(crate) lag: usize,
    pub(crate) present: FilterSnapshot,
    pub(crate) past: Vec<(FilterSnapshot, U)>,
}

impl<U> FixedLagSnapshot<U> {
    /// Creates a snapshot from parts that may be damaged.
    pub(crate) fn checked(
        lag: usize,
        present: FilterSnapshot,
        past: Vec<(FilterSnapshot, U)>,
    ) -> Result<Self, String> {
        let (found, steps) = (past.len(), present.steps);
        // There are fewer after a relocation, and before the second step under a prior at the
        // first observation.
        if found > lag.min(steps) {
            return Err(format!(
                "{found} past states after {steps} steps with a lag of {lag}, expected at most {}",
                lag.min(steps)
            ));
        }
        for (index, (state, _)) in past.iter().enumerate() {
            let expected = steps - found + index;
            if state.steps != expected {
                let found = state.steps;
                return Err(format!("past state {index} is of step {found}, expected {expected}"));
            }
            let (found, expected) = (state.belief.states(), present.belief.states());
            if found != expected {
                return Err(format!(
                    "past state {index} is over {found} states, expected {expected} as the present one"
                ));
            }
        }
        Ok(Self { lag, present, past })
    }
}
