//! One step of the filter: the states near the next point, the moves to them from the previous
//! states, and the filtered distribution of the new states.
//!
//! Live vehicles, whole drives and learning all take this step. Candidates, likelihoods and weights
//! come from the layers below; a trellis stores them for smoothing, decoding and distinct routes.
//! The filter is that of section 2 of the guide's formulas, in logarithms, with evidence on moves:
//! weights are not normalised, and their sum belongs to the normaliser.

use super::candidates::{Candidate, CandidateSearch, log_density_off_road, metres_between};
use super::matcher::Memory;
use super::moves::{Interval, Move};
use super::receiver::ROUGH_AT;
use super::sighting::Sighting;
use super::ways::Ways;
use super::{MatchError, MatchModel, Matcher, TracePoint};
use wayfix::inference::{SmoothedTrellis, Trellis};
use wayfix::internal::{Scale, TrellisForward};
use wayfix::map::Coordinates;

/// Steps of a matcher under a model, in memory that returns to the matcher when this is dropped.
#[derive(Debug)]
pub(super) struct MatchStep<'a, P> {
    pub(super) matcher: &'a Matcher<P>,
    pub(super) model: &'a MatchModel,
    pub(super) memory: Memory,
}

/// Last step of a drive so far: its point, and its states with their filtered distribution.
#[derive(Debug, Clone, Copy)]
pub(super) struct PreviousStep<'a, P> {
    pub(super) point: &'a TracePoint<P>,
    pub(super) states: &'a [Candidate],
    pub(super) log_filtered: &'a [f64],
    /// Speed in metres per second at which vehicles continue unseen.
    pub(super) speed: f64,
    /// Probability that the vehicle was stationary.
    pub(super) stood: f64,
}

impl<P> PreviousStep<'_, P> {
    /// Probability that the receiver is rough, given that the vehicle is on a road.
    fn rough(&self) -> f64 {
        let (mut rough, mut sum) = (0.0, 0.0);
        for (state, log) in self.states.iter().zip(self.log_filtered) {
            if !state.is_off_road() {
                let p = log.exp();
                (rough, sum) = (rough + p * state.place.shares[ROUGH_AT], sum + p);
            }
        }
        if sum > 0.0 { rough / sum } else { 0.0 }
    }
}

/// States of a completed step, with their filtered distribution.
#[derive(Debug)]
pub(super) struct ForwardStep {
    pub(super) states: Vec<Candidate>,
    pub(super) log_filtered: Vec<f64>,
    /// ln p(point | all before), in parts.
    pub(super) scale: Scale,
    pub(super) speed: f64,
    /// Probability that the vehicle was stationary.
    pub(super) stood: f64,
}

/// Distributions of the states of all points of a drive.
#[derive(Debug, Clone)]
pub(super) struct SmoothedDrive {
    pub(super) states: Vec<Vec<Candidate>>,
    pub(super) trellis: Trellis,
    pub(super) smoothed: SmoothedTrellis,
}

impl<P> Drop for MatchStep<'_, P> {
    fn drop(&mut self) {
        self.matcher.spare.push(std::mem::take(&mut self.memory));
    }
}

impl<'a, P: Coordinates> MatchStep<'a, P> {
    pub(super) fn new(matcher: &'a Matcher<P>, model: &'a MatchModel) -> Self {
        Self { matcher, model, memory: matcher.spare.pop().unwrap_or_default() }
    }

    /// Takes the first step of a drive and adds it to an empty trellis.
    pub(super) fn first(
        &mut self,
        point: &TracePoint<P>,
        trellis: &mut Trellis,
    ) -> Result<ForwardStep, MatchError> {
        let mut states = self.near(point);
        let log_likelihoods = self.place(point, &mut states);
        states.push(Candidate::off_road(point));
        trellis.begin_step();
        let [leaves, returns] = [self.model.leaves(1.0), self.model.returns(1.0)];
        // All moves of the first step come from one start, number 0, with its weight.
        for (log, log_heading) in log_likelihoods.iter().zip(&self.memory.log_headings) {
            trellis.state(log + log_heading, [(0, 0.0)])?;
        }
        // The stationary distribution of the chain that leaves the road and returns to it.
        let off_road = (leaves / (leaves + returns)).ln();
        trellis.state(log_density_off_road(self.model, point), [(0, off_road)])?;
        let mut log_filtered = Vec::new();
        let scale = trellis.forward_step(1, &[0.0], &mut log_filtered);
        Ok(ForwardStep {
            states,
            log_filtered,
            scale,
            speed: point.speed.unwrap_or(0.0),
            stood: self.model.stop,
        })
    }

    /// Takes the next step and adds it to the trellis, whose last step must be `before`. After an
    /// error the trellis is unchanged.
    pub(super) fn next(
        &mut self,
        before: &PreviousStep<'_, P>,
        point: &TracePoint<P>,
        trellis: &mut Trellis,
    ) -> Result<ForwardStep, MatchError> {
        let known = [before.stood, before.rough()];
        let interval = Interval::new(self.model, before.point, point, known);
        let mut states = self.near(point);
        // The state off the road comes after all others: sightings and headings have one entry for
        // each state on a road, in this order.
        self.carry(before, point, &interval, &mut states);
        states.push(Candidate::off_road(point));
        self.weigh(before, point, &mut states, &interval);
        trellis.begin_step();
        let Memory { entries, moves, log_headings, .. } = &mut self.memory;
        moves.clear();
        // Off the road all headings are equally likely. The zero also lines up the last state,
        // which has no sighting, with its entries.
        let log_headings = log_headings.iter().copied().chain([0.0]);
        let added = log_headings.zip(&*entries).try_for_each(|(log_heading, entries)| {
            moves.extend(entries.iter().map(|entry| entry.kind));
            trellis.state(log_heading, entries.iter().map(|entry| (entry.from, entry.log)))
        });
        if let Err(error) = added {
            trellis.remove_last();
            return Err(error.into());
        }
        let mut log_filtered = Vec::with_capacity(states.len());
        // The window of a live vehicle drops old steps, so steps are numbered from its oldest.
        let scale = trellis.forward_step(trellis.steps(), before.log_filtered, &mut log_filtered);
        let shown = || {
            let from = &before.states[mode(before.log_filtered)?];
            let to = &states[mode(&log_filtered)?];
            speed_between::<P>(from, to, interval.seconds)
        };
        // A position without information on the speed leaves it unchanged; others are smoothed
        // exponentially, since a single displacement is noisy.
        let speed = point
            .speed
            .unwrap_or_else(|| shown().map_or(before.speed, |shown| 0.5 * (before.speed + shown)));
        Ok(ForwardStep { states, log_filtered, scale, speed, stood: interval.stood() })
    }

    /// Filters and smooths a whole drive. `visit` receives, for each step, the sightings of its
    /// states, the moves into them in the order of the trellis (none for the first step), and the
    /// probability that the vehicle was stationary.
    pub(super) fn smooth(
        &mut self,
        points: &[TracePoint<P>],
        mut visit: impl FnMut(&[Sighting], &[Move], f64),
    ) -> Result<SmoothedDrive, MatchError> {
        let first = points.first().ok_or(MatchError::Empty)?;
        first.check(0, None)?;
        for (number, pair) in (1..).zip(points.windows(2)) {
            pair[1].check(number, Some(&pair[0]))?;
        }
        // All points are checked first, so that a bad last point is reported before any work is
        // done.
        let (mut trellis, mut forward) = (Trellis::new(), TrellisForward::default());
        let mut states = Vec::with_capacity(points.len());
        let mut last = self.first(first, &mut trellis)?;
        forward.push(&last.log_filtered, last.scale)?;
        visit(&self.memory.sightings, &[], last.stood);
        for pair in points.windows(2) {
            let ForwardStep { states: before, log_filtered, scale: _, speed, stood } = &last;
            let (point, speed, stood) = (&pair[0], *speed, *stood);
            let before = PreviousStep { point, states: before, log_filtered, speed, stood };
            let next = self.next(&before, &pair[1], &mut trellis)?;
            forward.push(&next.log_filtered, next.scale)?;
            visit(&self.memory.sightings, &self.memory.moves, next.stood);
            states.push(std::mem::replace(&mut last, next).states);
        }
        states.push(last.states);
        let smoothed = trellis.smooth_after(forward);
        Ok(SmoothedDrive { states, trellis, smoothed })
    }

    /// Searches for the ways from a state to those of the next point. Returns them with the
    /// standard deviation of the difference of the two positions.
    pub(super) fn ways(
        &mut self,
        from: &Candidate,
        to: &[Candidate],
        points: [&TracePoint<P>; 2],
    ) -> (Ways<'_, P>, f64) {
        // Ways depend on the times and positions alone, not on these probabilities, so the search
        // finds the ways of the step itself.
        let unknown = [self.model.stop, 0.0];
        let interval = Interval::new(self.model, points[0], points[1], unknown);
        let Matcher { network, measures, .. } = self.matcher;
        let mut ways = Ways { network, measures, search: &mut self.memory.search };
        ways.set_targets(to, self.model, &interval);
        ways.search_from(from, &interval);
        (ways, interval.spread)
    }

    /// Finds the states on roads near a point, with their sightings.
    fn near(&mut self, point: &TracePoint<P>) -> Vec<Candidate> {
        let Memory { near, sightings, log_headings, .. } = &mut self.memory;
        sightings.clear();
        log_headings.clear();
        let network = &self.matcher.network;
        let mut search =
            CandidateSearch { network, model: self.model, point, sightings, log_headings };
        search.near(&self.matcher.index, near)
    }

    /// Adds the states of vehicles that continued unseen.
    fn carry(
        &mut self,
        before: &PreviousStep<'_, P>,
        point: &TracePoint<P>,
        interval: &Interval,
        states: &mut Vec<Candidate>,
    ) {
        let Memory { sightings, log_headings, .. } = &mut self.memory;
        let network = &self.matcher.network;
        let mut search =
            CandidateSearch { network, model: self.model, point, sightings, log_headings };
        let metres = before.speed * interval.seconds;
        search.carry((before.states, before.log_filtered), metres, interval.spread, states);
    }
}

/// Speed between the most probable states before and after a step; `None` off the road, or if the
/// position is rather an outlier.
fn speed_between<P: Coordinates>(from: &Candidate, to: &Candidate, seconds: f64) -> Option<f64> {
    /// Largest speed in metres per second that two positions may show.
    const LARGEST: f64 = 50.0;
    if from.is_off_road() || to.is_off_road() || to.inlier <= 0.5 {
        return None;
    }
    Some((metres_between::<P>(from.point, to.point) / seconds).min(LARGEST))
}

/// Most probable state; the lowest index among ties.
fn mode(logs: &[f64]) -> Option<usize> {
    // `max_by` returns the last maximum, which in reverse order is the lowest index.
    (0..logs.len()).rev().max_by(|&a, &b| logs[a].total_cmp(&logs[b]))
}
