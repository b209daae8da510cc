//! Learning of the model from drives without labels, by expectation maximisation.

use std::ops::ControlFlow;

use super::drive::Built;
use super::many::in_order;
use super::moves::Move;
use super::{MatchError, MatchMemory, MatchModel, Matcher, TracePoint};
use crate::map::Coordinates;

/// A model that was learned from drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedMatchModel {
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

/// Name of a parameter that is learned, its place in a model, and the limits within which learning
/// keeps it.
type Limits = (&'static str, fn(&mut MatchModel) -> &mut f64, [f64; 2]);

const LIMITS: [Limits; 6] = [
    ("noise", |model| &mut model.noise, [0.1, 1000.0]),
    ("outliers", |model| &mut model.outliers, [1e-4, 0.5]),
    ("deviation", |model| &mut model.deviation, [1.5, 100.0]),
    ("stop", |model| &mut model.stop, [1e-3, 0.95]),
    ("leave_road", |model| &mut model.leave_road, [1e-7, 0.005]),
    ("return_to_road", |model| &mut model.return_to_road, [1e-4, 0.1]),
];

impl LearnedMatchModel {
    /// Names of the learned parameters that are at a limit of the range in which
    /// [`learn`](Matcher::learn) keeps them: the drives call for a value there or beyond.
    #[must_use]
    pub fn at_limits(&self) -> Vec<&'static str> {
        let mut model = self.model;
        let at_limit = |(_, value, limits): &&Limits| limits.contains(value(&mut model));
        LIMITS.iter().filter(at_limit).map(|entry| entry.0).collect()
    }
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
    /// Results are kept within sense: `noise` from 0.1 to 1000 m, `outliers` from 1e-4 to 0.5,
    /// `deviation` from 1.5 to 100 m a second, `stop` from 0.001 to 0.95, `leave_road` from 1e-7 to
    /// 0.005, and `return_to_road` from 1e-4 to 0.1; [`LearnedMatchModel::at_limits`] names those that
    /// ended at a limit.
    ///
    /// Drives may be slices, vectors or traces of a file. Start with more noise than there is: the
    /// search for roads reaches four deviations. At most `iterations` passes over the drives, each
    /// as long as [`match_drive`](Self::match_drive); with the feature `rayon`, drives run in
    /// parallel, with the same result to the bit, and each thread takes a memory.
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 2000.0, y: 0.0 })?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use wayfix::matching::{MatchMemory, MatchModel, Matcher, TracePoint};
    ///
    /// let mut memory = MatchMemory::default();
    /// let start = MatchModel { noise: 20.0, ..MatchModel::default() };
    /// let matcher = Matcher::new(network).with_model(start)?;
    /// // East at 10 m/s, 5 m to the left and to the right of the street in turn.
    /// let off = [5.0, -5.0];
    /// let point = |k: usize| {
    ///     let position = PlanePosition { x: 10.0 * k as f64, y: off[k % 2] };
    ///     TracePoint::new(k as f64, position)
    /// };
    /// let drives: Vec<Vec<_>> = vec![(0..100).map(point).collect(), (50..150).map(point).collect()];
    ///
    /// let learned = matcher.learn(&drives, 20, &mut memory)?;
    /// assert!((learned.model.noise - 5.0).abs() < 0.5);
    /// if !learned.at_limits().is_empty() {
    ///     println!("at the limits of their ranges: {:?}", learned.at_limits());
    /// }
    /// let matcher = matcher.with_model(learned.model)?;
    /// # let matched = matcher.match_drive(&drives[0], &mut memory)?;
    /// # assert_eq!(matched.route().len(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MatchError::Drive`], with the index of the drive and its error, as of
    /// [`match_drive`](Self::match_drive).
    pub fn learn<D: AsRef<[TracePoint<P>]> + Sync>(
        &self,
        drives: &[D],
        iterations: usize,
        memory: &mut MatchMemory,
    ) -> Result<LearnedMatchModel, MatchError> {
        let mut learned = LearnedMatchModel {
            model: self.model,
            iterations: 0,
            converged: false,
            log_likelihood: 0.0,
            points: 0,
        };
        while learned.iterations < iterations && !learned.converged {
            let mut counts = Counts::default();
            let count = |drive: &D, memory: &mut MatchMemory| {
                let mut counts = Counts::default();
                let counted = self.count(&learned.model, drive.as_ref(), &mut counts, memory);
                counted.map(|()| counts)
            };
            // Added in the order of the drives, so that threads change no bit.
            let mut numbers = 0..;
            let added = in_order(drives.iter(), memory, count, |counted| {
                let drive = numbers.next().unwrap_or_default();
                match counted {
                    Ok(of_drive) => {
                        counts.add(&of_drive);
                        ControlFlow::Continue(())
                    }
                    Err(source) => ControlFlow::Break(source.of_drive(drive)),
                }
            });
            if let ControlFlow::Break(error) = added {
                return Err(error);
            }
            let next = counts.maximize(&learned.model, &self.model);
            learned.iterations += 1;
            learned.converged = next.is_near(&learned.model);
            learned.model = next;
            (learned.log_likelihood, learned.points) = (counts.log_likelihood, counts.points);
        }
        Ok(learned)
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
            for (to, state) in states_now.iter().enumerate() {
                let into = smoothed.moves(&trellis, step, to);
                for ((from, p), moved) in into.zip(&mut moves) {
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
    fn add(&mut self, other: &Self) {
        let Self {
            squares,
            beside,
            outliers,
            on_road,
            moves,
            stood,
            detour,
            left,
            seconds_on_road,
            returned,
            seconds_off_road,
            log_likelihood,
            points,
        } = *other;
        self.squares += squares;
        self.beside += beside;
        self.outliers += outliers;
        self.on_road += on_road;
        self.moves += moves;
        self.stood += stood;
        self.detour += detour;
        self.left += left;
        self.seconds_on_road += seconds_on_road;
        self.returned += returned;
        self.seconds_off_road += seconds_off_road;
        self.log_likelihood += log_likelihood;
        self.points += points;
    }

    /// Model under which the counts are most probable, with the prior.
    fn maximize(&self, now: &MatchModel, prior: &MatchModel) -> MatchModel {
        let n = PRIOR_POINTS;
        // The first few points change the noise little.
        let variance = (self.squares + n * now.noise * now.noise) / (self.beside + n);
        let rate = |events: f64, seconds: f64, prior: f64| {
            let seconds = seconds + PRIOR_SECONDS;
            (events + prior * PRIOR_SECONDS) / seconds
        };
        let mut model = MatchModel {
            noise: variance.sqrt(),
            outliers: (self.outliers + n * prior.outliers) / (self.on_road + n),
            deviation: (self.detour + n * prior.deviation) / (self.moves + n),
            stop: (self.stood + n * prior.stop) / (self.moves + n),
            leave_road: rate(self.left, self.seconds_on_road, prior.leave_road),
            return_to_road: {
                let seconds = self.seconds_off_road + 5.0 / prior.return_to_road;
                (self.returned + 5.0) / seconds
            },
            ..*now
        };
        for (_, value, [least, most]) in LIMITS {
            let value = value(&mut model);
            *value = value.clamp(least, most);
        }
        model
    }
}

impl MatchModel {
    /// True if no learned parameter differs by more than a hundredth.
    fn is_near(&self, other: &Self) -> bool {
        let (mut a, mut b) = (*self, *other);
        LIMITS.iter().all(|(_, value, _)| (*value(&mut a) / *value(&mut b) - 1.0).abs() <= 0.01)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Learning that leads to a limit ends there, and says so.
    #[test]
    fn limits() {
        let prior = MatchModel::default();
        let many = 1e15;
        let none = Counts {
            beside: many,
            on_road: many,
            moves: many,
            seconds_on_road: many,
            seconds_off_road: many,
            ..Counts::default()
        };
        let all = Counts {
            squares: 1e30,
            outliers: many,
            stood: many,
            detour: 1e30,
            left: many,
            returned: many,
            seconds_off_road: 1.0,
            ..none
        };
        for (limit, counts) in [none, all].into_iter().enumerate() {
            let mut model = counts.maximize(&prior, &prior);
            for (name, value, limits) in LIMITS {
                assert_eq!(*value(&mut model), limits[limit], "{name}");
            }
            let learned = LearnedMatchModel {
                model,
                iterations: 1,
                converged: true,
                log_likelihood: 0.0,
                points: 1,
            };
            assert_eq!(learned.at_limits().len(), LIMITS.len());
            let inside = MatchModel { noise: 8.0, deviation: 3.0, ..model };
            let inside = LearnedMatchModel { model: inside, ..learned };
            assert_eq!(inside.at_limits(), ["outliers", "stop", "leave_road", "return_to_road"]);
        }
    }
}
