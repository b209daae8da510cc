//! Learning of the model from unlabelled drives, by expectation maximisation (Baum et al. 1970),
//! with a prior, and a test on held-out drives of whether it pays.
//!
//! The E step counts expected events of drives. Every parameter but the lasting share and its time
//! is a mean of expected events over expected opportunities, so the M step is one quotient, and the
//! prior adds pseudo-counts to both.

use std::ops::ControlFlow;

use super::candidates::Candidate;
use super::lasting::{Error, LastingErrors};
use super::matcher::DRIVES_AHEAD;
use super::moves::Move;
use super::receiver::{FACTORS, POOR_AT, REDRAWN_AFTER, ROUGH};
use super::sighting::Sighting;
use super::step::{MatchStep, SmoothedDrive};
use super::{MatchError, MatchModel, Matcher, TracePoint};
use wayfix::internal::parallel;
use wayfix::map::Coordinates;

/// Least gain in ln p of held-out drives for which a learned model is kept: one nat per parameter,
/// as in Akaike's criterion.
const LEAST_GAIN: f64 = LIMITS.len() as f64;

/// Model learned from drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedMatchModel {
    /// Learned model, or the original one if learning did not pay.
    pub model: MatchModel,
    /// Number of iterations.
    pub iterations: usize,
    /// True if the last iteration changed no parameter by more than 1 %.
    pub converged: bool,
    /// ln p(all points) before the last iteration, as densities in metres.
    pub log_likelihood: f64,
    /// Number of points.
    pub points: usize,
    /// Gain in ln p of each half of the drives under the model learned from the other half. Below
    /// 7, one nat per parameter, the model is the one that learning started with.
    pub held_out: f64,
    /// Median interval between two points in seconds. Above 15 s, points hardly show how often
    /// vehicles are stationary, and how often and how long they are off the road.
    pub median_interval: f64,
}

impl LearnedMatchModel {
    /// Names of the learned parameters that are at a limit of the range to which
    /// [`learn`](Matcher::learn) restricts them: the drives call for a value there or beyond.
    #[must_use]
    pub fn at_limits(&self) -> Vec<&'static str> {
        let mut model = self.model;
        let at_limit = |(_, value, limits): &&Limits| limits.contains(value(&mut model));
        LIMITS.iter().filter(at_limit).map(|entry| entry.0).collect()
    }
}

impl<P: Coordinates> Matcher<P> {
    /// Learns the model from unlabelled drives, by expectation maximisation: the noise, how much of
    /// it lasts and for how long, how often reception is poor, the share of outliers, detours,
    /// stops, and how often vehicles leave the road and return.
    ///
    /// The matcher's own model is both the start and the prior, which counts as much as 100 points
    /// and 20,000 seconds on the road; the prior of the noise is the default's, with the weight of
    /// 100 points. That is more than it seems: of 100 points a second apart, only one or two are
    /// independent. Noise is learned from points without an accuracy, of moving vehicles. Intervals
    /// above 10 s count less, since they hardly show what happens within them. If less than nine
    /// tenths of the variance of errors lasts, the receiver is considered rough, with errors all of
    /// one kind.
    ///
    /// Learning must pay: a model is learned from each half of the drives and tested on the other.
    /// If ln p gains less than one nat per parameter, the model stays as it was;
    /// [`LearnedMatchModel::held_out`] is the gain.
    ///
    /// Results are kept within plausible ranges: `noise` from 0.1 to 1000 m, `lasting` up to 0.995
    /// and `lasts` from 8 to 60 s, `poor` from 0.001 to 0.5, `outliers` from 0.001 to 0.5,
    /// `deviation` from 1.5 to 100 m per second, `stop` from 0.001 to 0.3, `leave_road` from 1e-7
    /// to 0.005, and `return_to_road` from 1e-4 to 0.1; [`LearnedMatchModel::at_limits`] names
    /// those that ended at a limit, except `lasting` and `lasts`.
    ///
    /// Drives may be slices, vectors or traces from a file. Makes at most `iterations` passes over
    /// all drives, each as long as [`match_drive`](Self::match_drive), and as many again to test
    /// the result; with the feature `rayon`, drives run in parallel, with the same result to the
    /// bit.
    ///
    /// ```
    /// # use wayfix_roads::NetworkBuilder;
    /// # use wayfix::map::{PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 2000.0, y: 0.0 })?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use wayfix_roads::matching::{Matcher, TracePoint};
    ///
    /// let matcher = Matcher::new(network);
    /// // East at 10 m/s, some 9 m to the left or to the right of the street.
    /// let off = [3.0, -11.0, 7.0, 13.0, -6.0, -12.0, 6.0];
    /// let point = |k: usize| {
    ///     let position = PlanePosition { x: 10.0 * k as f64, y: off[k % 7] };
    ///     TracePoint::new(k as f64, position)
    /// };
    /// let drives: Vec<Vec<_>> = (0..20).map(|k| (k..k + 100).map(point).collect()).collect();
    ///
    /// let learned = matcher.learn(&drives, 20)?;
    /// // Half an hour of errors that do not last.
    /// assert!((learned.model.noise - 9.0).abs() < 1.0, "{learned:?}");
    /// assert!(learned.model.lasting < 0.3, "{learned:?}");
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
    /// [`MatchError::Drive`] with the index of a drive, and an error of
    /// [`match_drive`](Self::match_drive).
    pub fn learn<D: AsRef<[TracePoint<P>]> + Sync>(
        &self,
        drives: &[D],
        iterations: usize,
    ) -> Result<LearnedMatchModel, MatchError> {
        let drives: Vec<&[TracePoint<P>]> = drives.iter().map(AsRef::as_ref).collect();
        let mut learned = self.learn_unchecked(&drives, iterations)?;
        if learned.iterations > 0 {
            // The model to be returned has seen all drives, so it cannot be tested on them. Two
            // others stand in for it, each learned from one half.
            learned.held_out = self.held_out(&drives, iterations)?;
        }
        if learned.held_out < LEAST_GAIN {
            learned.model = self.model;
        }
        Ok(learned)
    }

    /// Learns from drives without a test of whether it pays.
    fn learn_unchecked(
        &self,
        drives: &[&[TracePoint<P>]],
        iterations: usize,
    ) -> Result<LearnedMatchModel, MatchError> {
        let mut learned = LearnedMatchModel {
            model: self.model,
            iterations: 0,
            converged: false,
            log_likelihood: 0.0,
            points: 0,
            held_out: 0.0,
            median_interval: median_interval(drives),
        };
        while learned.iterations < iterations && !learned.converged {
            // The prior is the model that learning started with, not the last one: otherwise the
            // prior would follow the estimate.
            let counts = self.count_all(&learned.model, drives)?;
            let next = counts.maximize(&learned.model, &self.model);
            learned.iterations += 1;
            learned.converged = next.is_near(&learned.model);
            learned.model = next;
            (learned.log_likelihood, learned.points) = (counts.log_likelihood, counts.points);
        }
        Ok(learned)
    }

    /// Gain in ln p of each half of the drives under the model learned from the other; for a single
    /// drive, of its two halves.
    fn held_out(&self, drives: &[&[TracePoint<P>]], iterations: usize) -> Result<f64, MatchError> {
        let halves = match drives {
            [drive] => drive.chunks(drive.len().div_ceil(2)).collect(),
            _ => drives.to_vec(),
        };
        let [mut even, mut odd] = [Vec::new(), Vec::new()];
        // Every other drive, so that a change over time (weather, another receiver) falls into both
        // halves.
        for (number, drive) in halves.into_iter().enumerate() {
            if number % 2 == 0 { &mut even } else { &mut odd }.push(drive);
        }
        let mut gain = 0.0;
        for [training, held_out] in [[&even, &odd], [&odd, &even]] {
            let model = self.learn_unchecked(training, iterations)?.model;
            gain += self.count_all(&model, held_out)?.log_likelihood;
            gain -= self.count_all(&self.model, held_out)?.log_likelihood;
        }
        Ok(gain)
    }

    /// Expected counts of all drives under a model.
    fn count_all(
        &self,
        model: &MatchModel,
        drives: &[&[TracePoint<P>]],
    ) -> Result<Counts, MatchError> {
        let mut counts = Counts::default();
        let count = |drive: &&[TracePoint<P>]| self.count(model, drive);
        // Added in the order of the drives: sums round the same way for any number of threads.
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
        match added {
            ControlFlow::Break(error) => Err(error),
            ControlFlow::Continue(()) => Ok(counts),
        }
    }
}

/// Median interval between two points in seconds; 0 if there are none.
fn median_interval<P>(drives: &[&[TracePoint<P>]]) -> f64 {
    let pairs = drives.iter().flat_map(|drive| drive.windows(2));
    let mut seconds: Vec<f64> = pairs.map(|pair| pair[1].time - pair[0].time).collect();
    let middle = seconds.len() / 2;
    if middle == 0 {
        return seconds.first().copied().unwrap_or(0.0);
    }
    *seconds.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Name of a learned parameter, its field in a model, and the limits within which learning keeps
/// it.
pub(super) type Limits = (&'static str, fn(&mut MatchModel) -> &mut f64, [f64; 2]);

pub(super) const LIMITS: [Limits; 7] = [
    ("noise", |model| &mut model.noise, [0.1, 1000.0]),
    ("outliers", |model| &mut model.outliers, [1e-3, 0.5]),
    ("deviation", |model| &mut model.deviation, [1.5, 100.0]),
    ("stop", |model| &mut model.stop, [1e-3, 0.3]),
    ("leave_road", |model| &mut model.leave_road, [1e-7, 0.005]),
    ("return_to_road", |model| &mut model.return_to_road, [1e-4, 0.1]),
    ("poor", |model| &mut model.poor, [1e-3, 0.5]),
];

/// Expected counts of drives: for each parameter, in the order of [`LIMITS`], the sum and the
/// weight of the terms that it is the mean of.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    means: [Mean; 7],
    lasting: LastingErrors,
    pub(super) log_likelihood: f64,
    pub(super) points: usize,
}

#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    weight: f64,
}

impl Mean {
    fn add(&mut self, sum: f64, weight: f64) {
        self.sum += sum;
        self.weight += weight;
    }
}

/// Numbers of points and of seconds that the prior values count for.
const PRIOR_POINTS: f64 = 100.0;
const PRIOR_SECONDS: f64 = 20_000.0;
/// Number of returns to the road that the prior rate of returns counts for.
const PRIOR_RETURNS: f64 = 5.0;
/// Number of draws of the reception that the prior share of poor reception counts for.
const PRIOR_RECEPTIONS: f64 = 3.0;
/// Standard deviations from a road up to which errors count towards the noise.
const FARTHEST_OFF: f64 = 3.0;
/// Weights of the prior's lasting share, for receivers about which little is known and for rough
/// ones.
const PRIOR_LASTING: f64 = 80.0;
const PRIOR_LASTING_IN_ROUGH: f64 = 10.0;
/// Least lasting share of the errors of a fine receiver.
const LASTING_IN_FINE: f64 = 0.9;
/// Interval in seconds above which two points hardly show what happened between them.
const SHOWN: f64 = 10.0;

impl<P: Coordinates> Matcher<P> {
    /// Expected counts of a drive under a model.
    pub(super) fn count(
        &self,
        model: &MatchModel,
        points: &[TracePoint<P>],
    ) -> Result<Counts, MatchError> {
        let (mut sightings, mut moves, mut stops_by_point) = (Vec::new(), Vec::new(), Vec::new());
        let drive = MatchStep::new(self, model).smooth(
            points,
            |sightings_now, moves_now, p_stationary| {
                sightings.push(sightings_now.to_vec());
                stops_by_point.push(p_stationary);
                moves.extend_from_slice(moves_now);
            },
        )?;
        let SmoothedDrive { states, trellis, smoothed } = drive;
        let log_likelihood = smoothed.log_likelihood();
        let mut counts = Counts { log_likelihood, points: points.len(), ..Counts::default() };
        let [noise, outliers, detours, stops, leaves, returns, poor] = &mut counts.means;
        let (mut moves, mut errors) = (moves.iter(), Vec::with_capacity(points.len()));
        for (number, (states_now, point)) in states.iter().zip(points).enumerate() {
            let step = number + 1;
            // Points in quick succession are hardly independent: with the correlation `kept`
            // between neighbours, a point carries (1 − kept) / (1 + kept) of the information of an
            // independent one. A stationary vehicle may be parked beside any road, so it carries
            // none.
            let (mut witness, mut elapsed) = (1.0, 0.0);
            if number > 0 {
                let seconds = point.time - points[number - 1].time;
                let kept = model.lasting * (-seconds / model.lasts).exp();
                // After this time the reception is drawn anew, so a longer gap still shows only one
                // draw.
                elapsed = seconds.min(REDRAWN_AFTER);
                witness = (1.0 - stops_by_point[number]) * (1.0 - kept) / (1.0 + kept);
            }
            let has_accuracy = point.accuracy.is_some();
            let error = |state: &Candidate, sighting: &Sighting| {
                let is_known = sighting.is_beside && !has_accuracy && state.inlier > 0.0;
                let Sighting { across, normal, .. } = *sighting;
                is_known.then_some(Error { metres: across, normal })
            };
            let probabilities = smoothed.smoothed(step);
            let most_probable =
                |a: &usize, b: &usize| probabilities[*a].total_cmp(&probabilities[*b]);
            let best = (0..states_now.len()).max_by(most_probable);
            // The state off the road is last and has no sighting: `get` gives none for it.
            errors.push(best.and_then(|best| {
                let (state, sighting) = (&states_now[best], sightings[number].get(best)?);
                error(state, sighting).filter(|_| state.inlier > 0.5)
            }));
            // The last state is the one off the road.
            let on_road = states_now.iter().zip(&sightings[number]);
            for ((state, sighting), &p) in on_road.zip(probabilities) {
                // After the first point, outliers are counted move by move, below: a merged state
                // no longer knows which moves led to an outlier.
                outliers.add(if number == 0 { p * (1.0 - state.inlier) } else { 0.0 }, p);
                poor.add(elapsed * p * state.place.shares[POOR_AT], elapsed * p);
                let Some(across) = error(state, sighting).map(|error| error.metres) else {
                    continue;
                };
                // If the error is larger, the vehicle is more likely beside the road than badly
                // received.
                if across.abs() < FARTHEST_OFF * model.over_all_time(model.noise) {
                    let weight = witness * p * state.inlier;
                    let shares = state.place.shares.iter().zip(FACTORS);
                    // E[1 / factor²] brings squared errors of all receptions to the scale of usual
                    // reception.
                    let usual: f64 = shares.map(|(share, factor)| share / (factor * factor)).sum();
                    noise.add(weight * usual * across * across, weight);
                }
            }
            if number == 0 {
                continue;
            }
            let (before, seconds) = (&states[number - 1], point.time - points[number - 1].time);
            let shown = (SHOWN / seconds).min(1.0);
            for (to, state) in states_now.iter().enumerate() {
                let into = smoothed.moves(&trellis, step, to);
                // The trellis lists moves in the order the steps found them, so both
                // iterators stay in step: every move is taken, even one of probability 0.
                for ((from, p), moved) in into.zip(&mut moves) {
                    let off_road = [before[from].is_off_road(), state.is_off_road()];
                    let events = if off_road[0] == off_road[1] { 0.0 } else { p };
                    let left = if off_road[0] { &mut *returns } else { &mut *leaves };
                    // Rates per second: expected changes over expected seconds spent on or off the
                    // road.
                    left.add(shown * events, shown * p * seconds);
                    if off_road == [true, false] {
                        outliers.sum += p * (1.0 - state.inlier);
                    }
                    if let Move::Along { p_stationary, outlier, detour } = moved {
                        outliers.sum += p * outlier;
                        stops.add(shown * p * p_stationary, shown * p);
                        detours.add(shown * p * detour, shown * p);
                    }
                }
            }
        }
        counts.lasting = LastingErrors::of(points, &errors);
        Ok(counts)
    }
}

impl Counts {
    pub(super) fn add(&mut self, other: &Self) {
        let means = self.means.iter_mut().zip(&other.means);
        means.for_each(|(mean, other)| mean.add(other.sum, other.weight));
        self.lasting.add(&other.lasting);
        self.log_likelihood += other.log_likelihood;
        self.points += other.points;
    }

    /// Model that maximises the probability of the counts and the prior.
    pub(super) fn maximize(&self, now: &MatchModel, prior: &MatchModel) -> MatchModel {
        let mean_of = |value: f64, weight: f64| Mean { sum: value * weight, weight };
        let points = |value: f64| mean_of(value, PRIOR_POINTS);
        let usual = MatchModel::default().noise;
        let priors = [
            // The noise is drawn towards the default, whatever the prior's: otherwise a vehicle
            // that is mostly parked beside roads would make it grow without end.
            points(usual * usual),
            points(prior.outliers),
            points(prior.deviation),
            points(prior.stop),
            mean_of(prior.leave_road, PRIOR_SECONDS),
            Mean { sum: PRIOR_RETURNS, weight: PRIOR_RETURNS / prior.return_to_road },
            mean_of(prior.poor, PRIOR_RECEPTIONS * REDRAWN_AFTER),
        ];
        let mut model = *now;
        for ((mean, prior), (_, value, _)) in self.means.iter().zip(priors).zip(LIMITS) {
            *value(&mut model) = (mean.sum + prior.sum) / (mean.weight + prior.weight);
        }
        // The mean is that of the squared errors.
        model.noise = model.noise.sqrt();
        [model.lasting, model.lasts] = self.lasting.fit(prior, PRIOR_LASTING);
        if model.lasting < LASTING_IN_FINE {
            // A rough receiver: what looks like poor reception is white noise, and all errors are
            // of one kind.
            [model.lasting, model.lasts] = self.lasting.fit(prior, PRIOR_LASTING_IN_ROUGH);
            (model.noise, model.poor) = (self.lasting.deviation(), ROUGH.min(prior.poor));
        }
        for (_, value, [least, most]) in LIMITS {
            let value = value(&mut model);
            *value = value.clamp(least, most);
        }
        model
    }
}

impl MatchModel {
    /// True if no learned parameter differs by more than 1 %.
    pub(super) fn is_near(&self, other: &Self) -> bool {
        let (mut a, mut b) = (*self, *other);
        LIMITS.iter().all(|(_, value, _)| (*value(&mut a) / *value(&mut b) - 1.0).abs() <= 0.01)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::LearnedMatchModel;

    /// Learning that runs into a limit stops there and reports it.
    #[test]
    fn limits() {
        let prior = MatchModel::default();
        let many = 1e15;
        let none = Counts { means: [Mean { sum: 0.0, weight: many }; 7], ..Counts::default() };
        let mut all = none;
        for (mean, sum) in all.means.iter_mut().zip([1e30, many, 1e30, many, many, many, many]) {
            mean.sum = sum;
        }
        all.means[5].weight = 1.0;
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
                held_out: 10.0,
                median_interval: 1.0,
            };
            assert_eq!(learned.at_limits().len(), LIMITS.len());
            let inside = MatchModel { noise: 8.0, deviation: 3.0, ..model };
            let inside = LearnedMatchModel { model: inside, ..learned };
            let expected = ["outliers", "stop", "leave_road", "return_to_road", "poor"];
            assert_eq!(inside.at_limits(), expected);
        }
    }
}
