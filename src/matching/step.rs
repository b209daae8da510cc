//! One step forward: the states near the next point, the moves to them from the states before, and
//! the filtered distribution of the new states.
//!
//! Vehicles live, whole drives and learning all go forward by it. Candidates, likelihoods and
//! weights of moves are of the layers below; a trellis holds them, for whatever is asked of it
//! afterwards.

use super::candidates::{Candidate, CandidateSearch, metres_between};
use super::matcher::Memory;
use super::moves::{Interval, Move, Ways, speed_of};
use super::{MatchError, MatchModel, Matcher, TracePoint};
use crate::inference::{Scale, SmoothedTrellis, Trellis, TrellisForward};
use crate::map::Coordinates;

/// Logarithm of the share of the belief below which the way from a state is not looked for.
const NEGLIGIBLE: f64 = -14.0;
/// Logarithm of the weight below which a move is left out.
const LEAST_WEIGHT: f64 = -40.0;

/// Steps of a matcher under a model, with memory that goes back to the matcher in the end.
#[derive(Debug)]
pub(super) struct MatchStep<'a, P> {
    matcher: &'a Matcher<P>,
    model: &'a MatchModel,
    memory: Memory,
}

/// Last step of a drive so far: its point, and its states with their filtered distribution.
#[derive(Debug, Clone, Copy)]
pub(super) struct PreviousStep<'a, P> {
    pub(super) point: &'a TracePoint<P>,
    pub(super) states: &'a [Candidate],
    pub(super) log_filtered: &'a [f64],
    /// Speed in metres per second by which vehicles go on unseen.
    pub(super) speed: f64,
}

/// States of a step that was taken, with their filtered distribution.
#[derive(Debug)]
pub(super) struct ForwardStep {
    pub(super) states: Vec<Candidate>,
    pub(super) log_filtered: Vec<f64>,
    /// ln p(point | all before), in parts.
    pub(super) scale: Scale,
    pub(super) speed: f64,
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

    /// Takes the first step of a drive, and adds it to a trellis without steps.
    pub(super) fn first(
        &mut self,
        point: &TracePoint<P>,
        trellis: &mut Trellis,
    ) -> Result<ForwardStep, MatchError> {
        let mut states = self.search(point).near(&self.matcher.index, &mut self.memory.near);
        states.push(Candidate::off_road(point, self.model));
        trellis.begin_step();
        let [leaves, returns] = [self.model.leaves(1.0), self.model.returns(1.0)];
        let off_road = (leaves / (leaves + returns)).ln();
        for state in &states {
            let prior = if state.is_off_road() { off_road } else { 0.0 };
            trellis.state(state.log_likelihood, [(0, prior)])?;
        }
        let mut log_filtered = Vec::new();
        let scale = trellis.forward_step(1, &[0.0], &mut log_filtered);
        Ok(ForwardStep { states, log_filtered, scale, speed: point.speed.unwrap_or(0.0) })
    }

    /// Takes the next step, and adds it to the trellis whose last step is the one before. On an
    /// error the trellis is as before.
    pub(super) fn next(
        &mut self,
        before: &PreviousStep<'_, P>,
        point: &TracePoint<P>,
        trellis: &mut Trellis,
    ) -> Result<ForwardStep, MatchError> {
        let interval = Interval::new(self.model, before.point, point);
        let search = self.search(point);
        let mut states = search.near(&self.matcher.index, &mut self.memory.near);
        let metres = before.speed * interval.seconds;
        let carried = (before.states, before.log_filtered);
        search.carry(carried, metres, interval.jitter, &mut states);
        states.push(Candidate::off_road(point, self.model));
        self.weigh(before, &states, &interval);
        trellis.begin_step();
        self.memory.moves.clear();
        for (state, entries) in states.iter().zip(&self.memory.entries) {
            trellis.state(state.log_likelihood, entries.iter().map(|entry| (entry.0, entry.1)))?;
            self.memory.moves.extend(entries.iter().map(|entry| entry.2));
        }
        let mut log_filtered = Vec::with_capacity(states.len());
        let scale = trellis.forward_step(trellis.steps(), before.log_filtered, &mut log_filtered);
        let shown = || {
            let from = &before.states[mode(before.log_filtered)?];
            let to = &states[mode(&log_filtered)?];
            speed_between::<P>(from, to, interval.seconds)
        };
        // A position that says nothing of the speed leaves it as it was.
        let speed = point
            .speed
            .unwrap_or_else(|| shown().map_or(before.speed, |shown| 0.5 * (before.speed + shown)));
        Ok(ForwardStep { states, log_filtered, scale, speed })
    }

    /// Takes all steps of a drive forward and back. `visit` is given the moves of each step but
    /// the first, in the order in which they are in the trellis.
    pub(super) fn smooth(
        &mut self,
        points: &[TracePoint<P>],
        mut visit: impl FnMut(&[Move]),
    ) -> Result<SmoothedDrive, MatchError> {
        let first = points.first().ok_or(MatchError::Empty)?;
        first.check(0, None)?;
        for (number, pair) in (1..).zip(points.windows(2)) {
            pair[1].check(number, Some(&pair[0]))?;
        }
        let (mut trellis, mut forward) = (Trellis::new(), TrellisForward::default());
        let mut states = Vec::with_capacity(points.len());
        let mut last = self.first(first, &mut trellis)?;
        forward.push(&last.log_filtered, last.scale)?;
        for pair in points.windows(2) {
            let ForwardStep { states: before, log_filtered, speed, .. } = &last;
            let before =
                PreviousStep { point: &pair[0], states: before, log_filtered, speed: *speed };
            let next = self.next(&before, &pair[1], &mut trellis)?;
            forward.push(&next.log_filtered, next.scale)?;
            visit(&self.memory.moves);
            states.push(std::mem::replace(&mut last, next).states);
        }
        states.push(last.states);
        let smoothed = trellis.smooth_after(forward);
        Ok(SmoothedDrive { states, trellis, smoothed })
    }

    /// Searches for the ways from a state to those of the next point. Returns them with the deviation
    /// of the difference of the two positions.
    pub(super) fn ways(
        &mut self,
        from: &Candidate,
        to: &[Candidate],
        points: [&TracePoint<P>; 2],
    ) -> (Ways<'_, P>, f64) {
        let interval = Interval::new(self.model, points[0], points[1]);
        let Matcher { network, measures, .. } = self.matcher;
        let mut ways = Ways { network, measures, search: &mut self.memory.search };
        ways.from(from, to, self.model, &interval);
        (ways, interval.jitter)
    }

    fn search<'b>(&self, point: &'b TracePoint<P>) -> CandidateSearch<'b, P>
    where
        'a: 'b,
    {
        CandidateSearch { network: &self.matcher.network, model: self.model, point }
    }

    /// Finds the moves into each state, of which the last is the one off the road.
    fn weigh(&mut self, before: &PreviousStep<'_, P>, states: &[Candidate], interval: &Interval) {
        let (model, Memory { search, entries, .. }) = (self.model, &mut self.memory);
        let [leaves, returns] = [model.leaves(interval.seconds), model.returns(interval.seconds)];
        entries.resize_with(entries.len().max(states.len()), Vec::new);
        entries.iter_mut().for_each(Vec::clear);
        let (off_road, by_speed) = (states.len() - 1, interval.off_road().ln());
        let (to_road, stays_off) = (returns.ln() + by_speed, (-returns).ln_1p() + by_speed);
        let stays = (-leaves).ln_1p();
        for (number, (from, log)) in before.states.iter().zip(before.log_filtered).enumerate() {
            if from.is_off_road() {
                let on_road = entries[..off_road].iter_mut();
                on_road.for_each(|list| list.push((number, to_road, Move::OffRoad)));
                entries[off_road].push((number, stays_off, Move::OffRoad));
                continue;
            }
            if *log < NEGLIGIBLE {
                continue;
            }
            entries[off_road].push((number, leaves.ln() + by_speed, Move::OffRoad));
            let Matcher { network, measures, .. } = self.matcher;
            let mut ways = Ways { network, measures, search };
            ways.from(from, states, model, interval);
            for (to, list) in states[..off_road].iter().zip(entries.iter_mut()) {
                let Some(way) = ways.way(from, to, interval.jitter) else { continue };
                let fastest = self.matcher.speed(from).max(self.matcher.speed(to));
                let (log, moved) = interval.weight(model, &way, fastest, to.inlier);
                if log > LEAST_WEIGHT {
                    list.push((number, stays + log, moved));
                }
            }
        }
    }
}

impl<P> Matcher<P> {
    /// Speed of the road of a state, the faster of the posted and the typical one.
    fn speed(&self, state: &Candidate) -> f64 {
        let edge = &self.network.edges()[state.edge as usize];
        edge.speed.unwrap_or(0.0).max(speed_of(edge.class))
    }
}

/// Speed that the most probable states before and after a step show; `None` if the position says
/// nothing of it.
fn speed_between<P: Coordinates>(from: &Candidate, to: &Candidate, seconds: f64) -> Option<f64> {
    /// Largest speed in metres per second that two positions may show.
    const LARGEST: f64 = 50.0;
    if from.is_off_road() || to.is_off_road() || to.inlier <= 0.5 {
        return None;
    }
    Some((metres_between::<P>(from.point, to.point) / seconds).min(LARGEST))
}

/// Most probable state, the lowest of those as probable.
fn mode(logs: &[f64]) -> Option<usize> {
    (0..logs.len()).rev().max_by(|&a, &b| logs[a].total_cmp(&logs[b]))
}
