//! Learning of the model from drives without labels, by expectation maximisation.

use std::ops::ControlFlow;

use super::matcher::DRIVES_AHEAD;
use super::moves::Move;
use super::step::{MatchStep, SmoothedDrive};
use super::{MatchError, MatchModel, Matcher, TracePoint};
use crate::inference::engines::parallel;
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

/// Expected counts of drives: for each parameter in the order of the [`LIMITS`], the sum that it is
/// the mean of, and the number of terms.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    ratios: [Ratio; 6],
    log_likelihood: f64,
    points: usize,
}

#[derive(Debug, Clone, Copy, Default)]
struct Ratio {
    sum: f64,
    of: f64,
}

impl Ratio {
    fn add(&mut self, sum: f64, of: f64) {
        self.sum += sum;
        self.of += of;
    }
}

/// Numbers of points, and of seconds, for which the values of the model before count.
const PRIOR_POINTS: f64 = 10.0;
const PRIOR_SECONDS: f64 = 20_000.0;
/// Number of returns to the road for which its value counts.
const PRIOR_RETURNS: f64 = 5.0;

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
    /// parallel, with the same result to the bit.
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 2000.0, y: 0.0 })?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use wayfix::matching::{MatchModel, Matcher, TracePoint};
    ///
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
    /// let learned = matcher.learn(&drives, 20)?;
    /// assert!((learned.model.noise - 5.0).abs() < 0.5);
    /// if !learned.at_limits().is_empty() {
    ///     println!("at the limits of their ranges: {:?}", learned.at_limits());
    /// }
    /// let matcher = matcher.with_model(learned.model)?;
    /// # let matched = matcher.match_drive(&drives[0])?;
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
            let count = |drive: &D| self.count(&learned.model, drive.as_ref());
            // Added in the order of the drives, so that threads change no bit.
            let mut numbers = 0..;
            let added = parallel::in_order(drives.iter(), DRIVES_AHEAD, count, |counted| {
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

    /// Expected counts of a drive under a model.
    fn count(&self, model: &MatchModel, points: &[TracePoint<P>]) -> Result<Counts, MatchError> {
        let mut moves = Vec::new();
        let drive = MatchStep::new(self, model)
            .smooth(points, |of_step: &[Move]| moves.extend_from_slice(of_step))?;
        let SmoothedDrive { states, trellis, smoothed } = drive;
        let log_likelihood = smoothed.log_likelihood();
        let mut counts = Counts { log_likelihood, points: points.len(), ..Counts::default() };
        let [noise, outliers, detours, stops, leaves, returns] = &mut counts.ratios;
        let mut moves = moves.iter();
        for (number, (states_now, point)) in states.iter().zip(points).enumerate() {
            let step = number + 1;
            for (state, &p) in states_now.iter().zip(smoothed.smoothed(step)) {
                if state.is_off_road() {
                    continue;
                }
                outliers.add(if number == 0 { p * (1.0 - state.inlier) } else { 0.0 }, p);
                if let Some(across) = state.across.filter(|_| point.accuracy.is_none()) {
                    noise.add(p * state.inlier * across * across, p * state.inlier);
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
                    let events = if off_road[0] == off_road[1] { 0.0 } else { p };
                    let left = if off_road[0] { &mut *returns } else { &mut *leaves };
                    left.add(events, p * seconds);
                    if off_road == [true, false] {
                        outliers.sum += p * (1.0 - state.inlier);
                    }
                    if let Move::Along { stood, outlier, detour } = moved {
                        outliers.sum += p * outlier;
                        stops.add(p * stood, p);
                        detours.add(p * detour, p);
                    }
                }
            }
        }
        Ok(counts)
    }
}

impl Counts {
    fn add(&mut self, other: &Self) {
        let ratios = self.ratios.iter_mut().zip(&other.ratios);
        ratios.for_each(|(ratio, other)| ratio.add(other.sum, other.of));
        self.log_likelihood += other.log_likelihood;
        self.points += other.points;
    }

    /// Model under which the counts are most probable, with the prior.
    fn maximize(&self, now: &MatchModel, prior: &MatchModel) -> MatchModel {
        let mean = |value: f64, of: f64| Ratio { sum: value * of, of };
        let points = |value: f64| mean(value, PRIOR_POINTS);
        let priors = [
            // The first few points change the noise little.
            Ratio { sum: PRIOR_POINTS * now.noise * now.noise, of: PRIOR_POINTS },
            points(prior.outliers),
            points(prior.deviation),
            points(prior.stop),
            mean(prior.leave_road, PRIOR_SECONDS),
            Ratio { sum: PRIOR_RETURNS, of: PRIOR_RETURNS / prior.return_to_road },
        ];
        let mut model = *now;
        for ((ratio, prior), (_, value, _)) in self.ratios.iter().zip(priors).zip(LIMITS) {
            *value(&mut model) = (ratio.sum + prior.sum) / (ratio.of + prior.of);
        }
        model.noise = model.noise.sqrt();
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
        let none = Counts { ratios: [Ratio { sum: 0.0, of: many }; 6], ..Counts::default() };
        let mut all = none;
        for (ratio, sum) in all.ratios.iter_mut().zip([1e30, many, 1e30, many, many, many]) {
            ratio.sum = sum;
        }
        all.ratios[5].of = 1.0;
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
