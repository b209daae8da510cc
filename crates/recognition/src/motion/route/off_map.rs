//! Leaving the route and coming back: the rates ℓ, ρ and κ of section 10 of the guide, Route.
//! Neither ℓ nor ρ may be 0, or the filter could never follow a vehicle off the map or find it
//! again.

use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::internal::check_probability;

/// Rates of leaving a route and coming back.
///
/// States off the map remember where the vehicle left, since a detour often ends near there. In a
/// step the vehicle leaves with probability `leave`; once off, it comes back with probability
/// `back`: with probability `near` to a place within `within` of where it left, else to any place,
/// at a speed by its share.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct OffMap {
    /// Probability of leaving the map in a step.
    pub leave: f64,
    /// Probability of coming back in a step.
    pub back: f64,
    /// Probability of coming back near where the vehicle left.
    pub near: f64,
    /// Number of places on either side that count as near.
    pub within: usize,
}

impl Default for OffMap {
    /// The vehicle leaves every 500 steps, for 67 steps, and comes back within ten places seven
    /// times out of ten: for detours of half a minute to some minutes, at one frame a second.
    /// Results change little between half and twice these numbers.
    fn default() -> Self {
        Self { leave: 0.002, back: 0.015, near: 0.7, within: 10 }
    }
}

/// Smallest rate: 0 would rule out possible moves, and below this value products underflow.
const LEAST_RATE: f64 = 1e-30;

impl OffMap {
    /// Share of the time that a vehicle is off the map.
    #[must_use]
    pub fn share(&self) -> f64 {
        // Stationary probability of the chain of on and off.
        self.leave / (self.leave + self.back)
    }

    pub(super) fn check(&self) -> Result<(), TransitionError> {
        check_probability(self.near, || "the probability of coming back near".into())?;
        for (what, value) in [("leaving the map", self.leave), ("coming back", self.back)] {
            if !(LEAST_RATE..=1.0).contains(&value) {
                let what = format!("the probability of {what}");
                return Err(Parameter::new(what, value, "from 1e-30 to 1").into());
            }
        }
        Ok(())
    }
}
