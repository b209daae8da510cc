//! Learning of the model from drives without labels, by expectation maximisation.

use super::drive::Built;
use super::moves::Move;
use super::{MatchError, MatchMemory, MatchModel, Matcher, TracePoint};
use crate::map::Coordinates;

/// A model that was learned from drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedModel {
    /// The model.
    pub model: MatchModel,
    /// Number of iterations.
    pub iterations: usize,
    /// True if the last iteration changed no parameter by more than a hundredth.
    pub converged: bool,
    /// ln p(all points) before the last iteration, as densities in metres.
    pub log_likelihood: f64,
    /// Number of points.
    pub points: usize,
}

/// Expected counts of drives.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    squares: f64,
    beside: f64,
    outliers: f64,
    on_road: f64,
    moves: f64,
    stood: f64,
    detour: f64,
    left: f64,
    seconds_on_road: f64,
    returned: f64,
    seconds_off_road: f64,
    log_likelihood: f64,
    points: usize,
}

/// Numbers of points, and of seconds, for which the values of the model before count.
const PRIOR_POINTS: f64 = 10.0;
const PRIOR_SECONDS: f64 = 20_000.0;

impl<P: Coordinates> Matcher<P> {
    /// Learns noise, share of outliers, detours, stops, and how often vehicles leave the road and
    /// come back, from drives without labels, and returns them. The model of the matcher is where
    /// it starts; it counts as much as ten points, and 20,000 seconds on the road. Noise is learned from
    /// points without an accuracy.
    ///
    /// Results are kept within sense: `noise` from 0.1 to 1000 m, `outliers` up to a half,
    /// `deviation` from 1.5 m a second, `leave_road` up to 0.005, and `return_to_road` up to 0.1.
    ///
    /// Start with more noise than there is: the search for roads reaches four deviations. At most
    /// `iterations` passes over the drives, each as long as
    /// [`match_drive`](Self::match_drive).
    ///
    /// # Errors
    ///
    /// As [`match_drive`](Self::match_drive).
    pub fn fit(
        &self,
        drives: &[&[TracePoint<P>]],
        iterations: usize,
        memory: &mut MatchMemory,
    ) -> Result<FittedModel, MatchError> {
        let mut fitted = FittedModel {
            model: self.model,
            iterations: 0,
            converged: false,
            log_likelihood: 0.0,
            points: 0,
        };
        while fitted.iterations < iterations && !fitted.converged {
            let mut counts = Counts::default();
            for drive in drives {
                self.count(&fitted.model, drive, &mut counts, memory)?;
            }
            let next = counts.maximize(&fitted.model, &self.model);
            fitted.iterations += 1;
            fitted.converged = next.is_near(&fitted.model);
            fitted.model = next;
            (fitted.log_likelihood, fitted.points) = (counts.log_likelihood, counts.points);
        }
        Ok(fitted)
    }

    /// Adds up the expected counts of a drive under a model.
    fn count(
        &self,
        model: &MatchModel,
        points: &[TracePoint<P>],
        counts: &mut Counts,
        memory: &mut MatchMemory,
    ) -> Result<(), MatchError> {
        let Built { states, trellis, moves } = self.trellis(model, points, memory)?;
        let smoothed = trellis.smooth()?;
        counts.log_likelihood += smoothed.log_likelihood();
        counts.points += points.len();
        let mut moves = moves.iter();
        for (number, (states_now, point)) in states.iter().zip(points).enumerate() {
            let step = number + 1;
            for (state, &p) in states_now.iter().zip(smoothed.smoothed(step)) {
                if state.is_off_road() {
                    continue;
                }
                counts.on_road += p;
                if number == 0 {
                    counts.outliers += p * (1.0 - state.inlier);
                }
                if let Some(across) = state.across.filter(|_| point.accuracy.is_none()) {
                    counts.beside += p * state.inlier;
                    counts.squares += p * state.inlier * across * across;
                }
            }
            if number == 0 {
                continue;
            }
            let (before, seconds) = (&states[number - 1], point.time - points[number - 1].time);
            let pairs = smoothed.pairs(&trellis, step);
            for (to, state) in states_now.iter().enumerate() {
                for ((from, p), moved) in pairs.into_state(to).zip(&mut moves) {
                    let off_road = [before[from].is_off_road(), state.is_off_road()];
                    let seconds = p * seconds;
                    if off_road[0] {
                        counts.seconds_off_road += seconds;
                        counts.returned += if off_road[1] { 0.0 } else { p };
                    } else {
                        counts.seconds_on_road += seconds;
                        counts.left += if off_road[1] { p } else { 0.0 };
                    }
                    if off_road == [true, false] {
                        counts.outliers += p * (1.0 - state.inlier);
                    }
                    if let Move::Along { stood, outlier, detour, .. } = moved {
                        counts.moves += p;
                        counts.outliers += p * outlier;
                        counts.stood += p * stood;
                        counts.detour += p * detour;
                    }
                }
            }
        }
        Ok(())
    }
}

impl Counts {
    /// Model under which the counts are most probable, with the prior.
    fn maximize(&self, now: &MatchModel, prior: &MatchModel) -> MatchModel {
        let n = PRIOR_POINTS;
        let variance = self.squares / self.beside.max(1e-300);
        // The first few points change the noise little.
        let share = self.beside / (self.beside + n);
        let variance = share * variance + (1.0 - share) * now.noise * now.noise;
        let rate = |events: f64, seconds: f64, prior: f64| {
            let seconds = seconds + PRIOR_SECONDS;
            ((events + prior * PRIOR_SECONDS) / seconds).clamp(1e-7, 0.005)
        };
        MatchModel {
            noise: variance.sqrt().clamp(0.1, 1000.0),
            outliers: ((self.outliers + n * prior.outliers) / (self.on_road + n)).clamp(1e-4, 0.5),
            deviation: ((self.detour + n * prior.deviation) / (self.moves + n)).clamp(1.5, 100.0),
            stop: ((self.stood + n * prior.stop) / (self.moves + n)).clamp(1e-3, 0.95),
            leave_road: rate(self.left, self.seconds_on_road, prior.leave_road),
            return_to_road: {
                let seconds = self.seconds_off_road + 5.0 / prior.return_to_road;
                ((self.returned + 5.0) / seconds).clamp(1e-4, 0.1)
            },
            ..*now
        }
    }
}

impl MatchModel {
    /// True if no learned parameter differs by more than a hundredth.
    fn is_near(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a / b - 1.0).abs() <= 0.01;
        near(self.noise, other.noise)
            && near(self.outliers, other.outliers)
            && near(self.deviation, other.deviation)
            && near(self.stop, other.stop)
            && near(self.leave_road, other.leave_road)
            && near(self.return_to_road, other.return_to_road)
    }
}
