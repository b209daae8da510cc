//! Motion of a vehicle off the map, where states have no speed: p̄, the likelihood of measurements
//! there (guide, section 10, Route), as the sum of three cases. Off the map must pay as much for a
//! reading as the map does, or the belief drifts there.

use super::step::Step;
use super::views::Factors;
use super::{RouteControl, RouteTransition};
use crate::motion::OdometryModel;
use wayfix::TransitionError;

/// Motion of a vehicle up to a step, known from the measurements alone.
///
/// Speeds last: on the map the speed is part of the state, and a reading like the ones before is no
/// surprise. States off the map have no speed, so this predicts the readings there; without it each
/// step would be taken for a speed drawn anew, which is evidence against being off the map. Updated
/// step by step by [`RouteTransition::driven`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Driven {
    /// Probability that the vehicle stood.
    pub standing: f64,
    /// Mean odometry reading since the vehicle set off or changed its speed, and the number of
    /// readings; `None` if there were none.
    pub odometry: Option<(f64, u32)>,
}

/// Largest number of readings averaged, so that the mean follows the present speed.
const READINGS: u32 = 10;

/// Relative density below which a reading counts as unlike the mean: some three deviations off.
const UNLIKE: f64 = 0.05;

/// Share of steps in motion below which a vehicle is taken for one that never moves.
const LEAST_SHARE: f64 = 1e-3;

/// Likelihoods of the measurements of a step off the map, each times the probability of its case.
struct Cases {
    stands: f64,
    goes_on: f64,
    changes: f64,
}

impl Driven {
    pub(super) fn check(&self) -> Result<(), TransitionError> {
        if !(0.0..=1.0).contains(&self.standing) {
            let text = format!("a probability of having stood of {}", self.standing);
            return Err(TransitionError::Control(text));
        }
        match self.odometry {
            Some((_, 0)) => {
                let text = "a mean over 0 odometry readings, expected at least 1".into();
                Err(TransitionError::Control(text))
            }
            Some((mean, _)) => OdometryModel::check_reading(mean),
            None => Ok(()),
        }
    }
}

impl Step<'_> {
    /// Likelihood of the measurements off the map; `means` has the likelihood of the reading at
    /// each speed.
    pub(super) fn off_map_likelihood(&self, control: &RouteControl, means: &[f64]) -> f64 {
        // Without measurements the cases sum to one but for rounding.
        if control.odometry.is_none() && self.factors == Factors::NONE {
            return 1.0;
        }
        let Cases { stands, goes_on, changes } = self.cases(control, means);
        stands + goes_on + changes
    }

    fn cases(&self, control: &RouteControl, means: &[f64]) -> Cases {
        let speeds = &self.route.speeds;
        // `share` is that of standing; the sums are over speeds by their shares: of standing, and
        // of all others.
        let (mut share, mut at_rest, mut moving) = (0.0, 0.0, 0.0);
        for ((v, p), mean) in speeds.values().iter().zip(speeds.shares()).zip(means) {
            if *v == 0.0 {
                (share, at_rest) = (share + p, at_rest + p * mean);
            } else {
                moving += p * mean;
            }
        }
        let (nearby, anywhere) = speeds.changes();
        let factors = self.factors;
        // Without a motion before, the step is like the first: a speed by its share, so that
        // `changes` and the second term of `stands` are all.
        let (change, stood) = match control.before {
            None => (1.0, 0.0),
            Some(before) => {
                // A vehicle always stood if no speed moves, and never if no speed is 0.
                let moves = 1.0 - share >= LEAST_SHARE;
                let stood = if moves { before.standing } else { 1.0 };
                ((nearby + anywhere).min(1.0), if share > 0.0 { stood } else { 0.0 })
            }
        };
        // Given that the vehicle stands.
        let at_rest = if share > 0.0 { at_rest / share } else { 0.0 };
        let mean = control.before.and_then(|before| before.odometry);
        // The likelihood at a speed that goes on: the predictive density of the readings so far, or
        // without any the mean over the moving speeds.
        let like = control
            .odometry
            .zip(mean)
            .map_or(moving / (1.0 - share).max(LEAST_SHARE), |(reading, (mean, count))| {
                self.route.odometry.again(reading, mean, count)
            });
        Cases {
            stands: ((1.0 - change) * stood + change * share) * at_rest * factors.standing,
            goes_on: (1.0 - change) * (1.0 - stood) * like * factors.moved,
            changes: change * moving * factors.moved,
        }
    }
}

impl RouteTransition {
    /// Returns the motion after a step, from the motion before it and the measurements, both in the
    /// control.
    #[must_use]
    pub fn driven(&self, control: &RouteControl) -> Driven {
        let Cases { stands, goes_on, changes } =
            self.with_step(control, |step, means| step.cases(control, means));
        let sum = stands + goes_on + changes;
        // If no case explains the measurements, standing and moving are equally probable.
        let standing = if sum > 0.0 { (stands / sum).min(1.0) } else { 0.5 };
        let before = control.before.and_then(|before| before.odometry);
        // The mean starts anew when the vehicle stands or when a change explains the step better.
        let odometry = match (before.filter(|_| goes_on >= changes), control.odometry) {
            _ if standing > 0.5 => None,
            (Some((mean, count)), Some(reading)) => {
                // A reading unlike the mean halves the weight of earlier ones: the speed changed.
                let unlike = self.odometry.again(reading, mean, count) < UNLIKE;
                let count = if unlike { count / 2 } else { count }.saturating_add(1).min(READINGS);
                Some((mean + (reading - mean) / f64::from(count), count))
            }
            (None, Some(reading)) => Some((reading, 1)),
            (before, None) => before,
        };
        Driven { standing, odometry }
    }
}
