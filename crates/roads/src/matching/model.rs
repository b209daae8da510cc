//! Parameters of map matching, with their ranges, defaults and the probabilities that follow from
//! them.

use super::MatchError;
use wayfix::error::OutOfRange;

/// Factor of the standard deviation in poor reception.
pub(super) const POOR_FACTOR: f64 = 4.0;

/// Parameters of the model of a drive: the receiver, the routes that drivers take, and stretches
/// off the road.
///
/// [`Matcher::learn`](super::Matcher::learn) learns all but `u_turn` from drives without labels.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct MatchModel {
    /// Standard deviation of a position in each direction in usual reception, in metres; from 1e-6
    /// to 1e9.
    pub noise: f64,
    /// Share of the variance of positions that is a slowly moving offset; from 0 to 0.999. The rest
    /// is independent from point to point.
    pub lasting: f64,
    /// Seconds after which 1/e of the offset is left; from 1e-6 to 1e9.
    pub lasts: f64,
    /// Share of time with poor reception, when errors are four times as large as usual; above 0
    /// and below 1.
    pub poor: f64,
    /// Share of positions that carry no information about the place; above 0 and below 1.
    pub outliers: f64,
    /// Mean detour of a route relative to the straight line, in metres per second between two
    /// positions; from 1e-6 to 1e9.
    pub deviation: f64,
    /// Share of steps at which the vehicle is stationary; above 0 and below 1.
    pub stop: f64,
    /// Probability of leaving the road within a second; above 0 and below 1.
    pub leave_road: f64,
    /// Probability of returning to the road within a second; above 0 and below 1. Between two
    /// points it is at most one half.
    pub return_to_road: f64,
    /// Probability of a U-turn where there is another way to continue; above 0 and below 1.
    pub u_turn: f64,
}

impl Default for MatchModel {
    fn default() -> Self {
        Self {
            noise: 4.0,
            lasting: 0.995,
            lasts: 60.0,
            poor: 0.2,
            outliers: 0.03,
            deviation: 1.5,
            stop: 0.1,
            leave_road: 5e-5,
            return_to_road: 0.01,
            u_turn: 5e-3,
        }
    }
}

impl MatchModel {
    pub(super) fn check(&self) -> Result<(), MatchError> {
        let positive =
            [("noise", self.noise), ("lasts", self.lasts), ("deviation", self.deviation)];
        for (what, value) in positive {
            if !(1e-6..=1e9).contains(&value) {
                let expected = match what {
                    "lasts" => "seconds from 1e-6 to 1e9",
                    _ => "metres from 1e-6 to 1e9",
                };
                return Err(
                    OutOfRange::new(format!("the parameter {what}"), value, expected).into()
                );
            }
        }
        if !(0.0..=0.999).contains(&self.lasting) {
            let expected = "a share from 0 to 0.999";
            return Err(OutOfRange::new("the parameter lasting", self.lasting, expected).into());
        }
        let shares = [
            ("poor", self.poor),
            ("outliers", self.outliers),
            ("stop", self.stop),
            ("leave_road", self.leave_road),
            ("return_to_road", self.return_to_road),
            ("u_turn", self.u_turn),
        ];
        // Open intervals: logarithms are taken of these shares and of their complements. NaN fails
        // every comparison, so it is also an error.
        for (what, value) in shares {
            if !(value > 0.0 && value < 1.0) {
                let expected = "a value above 0 and below 1";
                return Err(
                    OutOfRange::new(format!("the parameter {what}"), value, expected).into()
                );
            }
        }
        Ok(())
    }

    /// Standard deviation averaged over usual and poor reception, given the one in usual reception.
    pub(super) fn over_all_time(&self, usual: f64) -> f64 {
        // Variances add: (1 − poor) σ² + poor (4 σ)².
        usual * (1.0 + self.poor * (POOR_FACTOR * POOR_FACTOR - 1.0)).sqrt()
    }

    /// Probability of leaving the road within some seconds.
    pub(super) fn leaves(&self, seconds: f64) -> f64 {
        within(self.leave_road, seconds)
    }

    /// Probability of returning to the road within some seconds.
    pub(super) fn returns(&self, seconds: f64) -> f64 {
        // The cap keeps long stretches off the road possible: with a constant rate alone, a gap of
        // some minutes would make the return almost certain.
        within(self.return_to_road, seconds).min(0.5)
    }
}

/// Probability within some seconds of an event that has this probability within one; at most 0.9.
fn within(in_a_second: f64, seconds: f64) -> f64 {
    // 1 − (1 − p)^t; `ln_1p` and `exp_m1` keep the digits of p down to the smallest rates.
    let log_survival = seconds * (-in_a_second).ln_1p();
    (-log_survival.exp_m1()).min(0.9)
}
