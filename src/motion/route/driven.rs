//! How a vehicle off the map is driven, of whose speed no state tells.

use super::step::Step;
use super::views::Factors;
use super::{RouteControl, RouteTransition};
use crate::error::TransitionError;
use crate::motion::OdometryModel;

/// How a vehicle was driven until now, by what was measured alone.
///
/// A speed lasts: on the map it is part of the state, and a reading like the ones before is
/// no surprise. Off the map there is no speed among the states, so that this tells what to
/// expect there; without it each step is taken for a speed drawn anew, which speaks against
/// being off the map. Made step by step by [`RouteTransition::driven`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Driven {
    /// True if it stood.
    pub standing: bool,
    /// The mean reading of odometry since it set off or changed its speed, and the number of
    /// readings; `None` if there were none.
    pub odometry: Option<(f64, u32)>,
}

/// As many readings are averaged: later ones say how it drives now.
const READINGS: u32 = 10;

/// Readings of a lower density than this, over the largest, are some three deviations off.
const UNLIKE: f64 = 0.05;

/// Likelihoods of what was measured at a step off the map, each with its probability.
struct Ways {
    stands: f64,
    goes_on: f64,
    changes: f64,
}

impl Driven {
    pub(super) fn check(&self) -> Result<(), TransitionError> {
        match self.odometry {
            Some((_, 0)) => {
                let text = "the mean of no readings of odometry, expected some".into();
                Err(TransitionError::Control(text))
            }
            Some((mean, _)) => OdometryModel::check_reading(mean),
            None => Ok(()),
        }
    }
}

impl Step<'_> {
    /// The likelihood of what was measured, off the map; of readings at each speed, `means`.
    pub(super) fn off_map_likelihood(&self, control: &RouteControl, means: &[f64]) -> f64 {
        if control.odometry.is_none() && self.factors == Factors::NONE {
            return 1.0;
        }
        let Ways { stands, goes_on, changes } = self.ways(control, means);
        stands + goes_on + changes
    }

    fn ways(&self, control: &RouteControl, means: &[f64]) -> Ways {
        let speeds = &self.route.speeds;
        let (mut share, mut at_rest, mut moving) = (0.0, 0.0, 0.0);
        for ((v, p), mean) in speeds.values().iter().zip(speeds.shares()).zip(means) {
            if *v == 0.0 {
                (share, at_rest) = (share + p, at_rest + p * mean);
            } else {
                moving += p * mean;
            }
        }
        let (nearby, anywhere) = speeds.changes();
        let change = (nearby + anywhere).min(1.0);
        let factors = self.factors;
        // At a speed drawn anew.
        let drawn = |p: f64| (p * at_rest * factors.standing, p * moving * factors.moved);
        let known = |before: &Driven| share > 0.0 || !before.standing;
        let Some(before) = control.before.filter(known) else {
            let (stands, changes) = drawn(1.0);
            return Ways { stands, goes_on: 0.0, changes };
        };
        let (mut stands, changes) = drawn(change);
        let mut goes_on = 0.0;
        if before.standing {
            stands += (1.0 - change) * at_rest / share * factors.standing;
        } else {
            let known = control.odometry.zip(before.odometry);
            let like = known
                .map_or(moving / (1.0 - share).max(1e-3), |(reading, (mean, count))| {
                    self.route.odometry.again(reading, mean, count)
                });
            goes_on = (1.0 - change) * like * factors.moved;
        }
        Ways { stands, goes_on, changes }
    }
}

impl RouteTransition {
    /// How the vehicle was driven after a step, from before it and what was measured, both in
    /// the control.
    #[must_use]
    pub fn driven(&self, control: &RouteControl) -> Driven {
        let Ways { stands, goes_on, changes } =
            self.with_step(control, |step, means| step.ways(control, means));
        if stands > goes_on.max(changes) {
            return Driven { standing: true, odometry: None };
        }
        let before = control.before.filter(|before| !before.standing);
        let before = before.and_then(|before| before.odometry).filter(|_| goes_on >= changes);
        let odometry = match (before, control.odometry) {
            (Some((mean, count)), Some(reading)) => {
                // Of a speed that changes, later readings say more.
                let unlike = self.odometry.again(reading, mean, count) < UNLIKE;
                let count = if unlike { count / 2 } else { count }.saturating_add(1).min(READINGS);
                Some((mean + (reading - mean) / f64::from(count), count))
            }
            (None, Some(reading)) => Some((reading, 1)),
            (before, None) => before,
        };
        Driven { standing: false, odometry }
    }
}
