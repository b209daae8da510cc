//! Learning of the model from unlabelled drives, by expectation maximisation, with a test on
//! held-out drives of whether it pays.

use std::ops::ControlFlow;

use super::counts::{Counts, LIMITS, Limits};
use super::matcher::DRIVES_AHEAD;
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
        let mut learned = self.climb(&drives, iterations)?;
        if learned.iterations > 0 {
            // The model to be returned has seen all drives and cannot be tested on them, so two
            // others, each learned from one half, stand for it.
            learned.held_out = self.held_out(&drives, iterations)?;
        }
        if learned.held_out < LEAST_GAIN {
            learned.model = self.model;
        }
        Ok(learned)
    }

    /// Learns from drives without a test of whether it pays.
    fn climb(
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
            // The prior is the model that learning started with, not the last one: otherwise each
            // iteration would move it along with the estimate.
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
        for [taught, held_out] in [[&even, &odd], [&odd, &even]] {
            let model = self.climb(taught, iterations)?.model;
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
