//! Places that are not on the route.

use crate::error::TransitionError;
use crate::transition::check_probability;

/// Leaving the route and coming back.
///
/// A vehicle off the map remembers where it left: a detour often ends near there. In a
/// step it leaves with probability `leave`; once off, it comes back with probability
/// `back`: then with probability `near` to a place within `within` of where it left, else
/// to any, at a speed by its share.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OffMap {
    /// The probability of leaving the map in a step.
    pub leave: f64,
    /// The probability of coming back in a step.
    pub back: f64,
    /// The probability of coming back near where it left.
    pub near: f64,
    /// Number of places on either side that are near.
    pub within: usize,
}

impl Default for OffMap {
    /// It leaves every 500 steps, for 67 of them, and comes back within ten places seven
    /// times out of ten. For detours of half a minute to some minutes of a vehicle that
    /// sees its map once a second; results change little between half and twice as many.
    fn default() -> Self {
        Self { leave: 0.002, back: 0.015, near: 0.7, within: 10 }
    }
}

/// Rates of 0 would make what is possible impossible; below this, products underflow.
const LEAST_RATE: f64 = 1e-30;

impl OffMap {
    /// Share of the time for which a vehicle is off the map.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.leave / (self.leave + self.back)
    }

    pub(super) fn check(&self) -> Result<(), TransitionError> {
        check_probability(self.near, || "the probability of coming back near".into())?;
        for (what, value) in [("leaving the map", self.leave), ("coming back", self.back)] {
            if !(LEAST_RATE..=1.0).contains(&value) {
                let what = format!("the probability of {what}");
                return Err(TransitionError::Parameter {
                    what,
                    value,
                    expected: "from 1e-30 to 1",
                });
            }
        }
        Ok(())
    }
}
