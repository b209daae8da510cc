//! One step of the filter: the states near the next point, the moves to them from the previous
//! states, and the filtered distribution of the new states.
//!
//! Live vehicles, whole drives and learning all take this step. Candidates, likelihoods and weights
//! come from the layers below; a trellis stores them for smoothing, decoding and distinct routes.
//! The filter is that of section 2 of the guide's formulas, in logarithms, with evidence on moves:
//! weights are not normalised, and their sum belongs to the normaliser.
//!
//! Each state holds a Gaussian of its place along the road and of the receiver's error, for each
//! kind of reception. A move from state j predicts that Gaussian and updates it by the new
//! position; the normaliser of this update is the density within the move's weight. The Gaussians
//! of all moves into a state, weighted by their shares of its belief, are then merged by their
//! first two moments (Blom and Bar-Shalom 1988), so that a state stays of constant size.

use super::candidates::{
    Candidate, CandidateSearch, deviation, log_density_off_road, metres_between, usual_deviation,
};
use super::matcher::{Entry, Memory};
use super::moves::{Interval, Move, Ways, speed_of};
use super::receiver::{PlaceMixture, ROUGH_AT, Receiver};
use super::sighting::{Ahead, Fit, Sighting};
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
    pub(super) p_stationary: f64,
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
    pub(super) p_stationary: f64,
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
        for (log, log_heading_likelihood) in
            log_likelihoods.iter().zip(&self.memory.log_heading_likelihoods)
        {
            trellis.state(log + log_heading_likelihood, [(0, 0.0)])?;
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
            p_stationary: self.model.stop,
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
        let known = [before.p_stationary, before.rough()];
        let interval = Interval::new(self.model, before.point, point, known);
        let mut states = self.near(point);
        // The state off the road comes after all others: sightings and headings have one entry for
        // each state on a road, in this order.
        self.carry(before, point, &interval, &mut states);
        states.push(Candidate::off_road(point));
        self.weigh(before, point, &mut states, &interval);
        trellis.begin_step();
        let Memory { entries, moves, log_heading_likelihoods, .. } = &mut self.memory;
        moves.clear();
        // Off the road all headings are equally likely. The zero also pairs the last state, which
        // has no sighting, with its entries.
        let log_heading_likelihoods = log_heading_likelihoods.iter().copied().chain([0.0]);
        let added = log_heading_likelihoods.zip(&*entries).try_for_each(
            |(log_heading_likelihood, entries)| {
                moves.extend(entries.iter().map(|entry| entry.kind));
                trellis.state(
                    log_heading_likelihood,
                    entries.iter().map(|entry| (entry.from, entry.log)),
                )
            },
        );
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
        Ok(ForwardStep {
            states,
            log_filtered,
            scale,
            speed,
            p_stationary: interval.p_stationary(),
        })
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
        visit(&self.memory.sightings, &[], last.p_stationary);
        for pair in points.windows(2) {
            let ForwardStep { states: before, log_filtered, scale: _, speed, p_stationary } = &last;
            let (point, speed, p_stationary) = (&pair[0], *speed, *p_stationary);
            let before = PreviousStep { point, states: before, log_filtered, speed, p_stationary };
            let next = self.next(&before, &pair[1], &mut trellis)?;
            forward.push(&next.log_filtered, next.scale)?;
            visit(&self.memory.sightings, &self.memory.moves, next.p_stationary);
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
        // Ways depend on the times and positions alone, not on these probabilities, so this search
        // finds the same ways as the step did.
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
        let Memory { near, sightings, log_heading_likelihoods, .. } = &mut self.memory;
        sightings.clear();
        log_heading_likelihoods.clear();
        let network = &self.matcher.network;
        let mut search = CandidateSearch {
            network,
            model: self.model,
            point,
            sightings,
            log_heading_likelihoods,
        };
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
        let Memory { sightings, log_heading_likelihoods, .. } = &mut self.memory;
        let network = &self.matcher.network;
        let mut search = CandidateSearch {
            network,
            model: self.model,
            point,
            sightings,
            log_heading_likelihoods,
        };
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

/// Logarithm of the share of the belief below which no ways from a state are searched.
const NEGLIGIBLE: f64 = -12.0;
/// Logarithm of the weight below which a move is dropped.
const LEAST_WEIGHT: f64 = -40.0;
/// Share of a state's belief below which a move does not count towards its place.
const LEAST_SHARE: f64 = 1e-4;
/// Acceleration after a U-turn, in metres per second squared.
const ACCELERATION: f64 = 2.0;
/// Metres of road for each square metre. A vehicle that returns to the road ends on one of few such
/// metres, so this turns a density in the plane into one along roads.
const METRES_OF_ROAD: f64 = 0.01;

impl<P: Coordinates> MatchStep<'_, P> {
    /// Places the states of the first step, where no place along the road is known yet. Returns the
    /// log-likelihood of the position for each state on a road.
    pub(super) fn place(&mut self, point: &TracePoint<P>, states: &mut [Candidate]) -> Vec<f64> {
        let sigma = deviation(self.model, point);
        let receiver = Receiver::new(self.model, usual_deviation(self.model, point));
        let unknown = receiver.unknown();
        let states = states.iter_mut().zip(&self.memory.sightings);
        let place = |(state, sighting): (&mut Candidate, &Sighting)| {
            let fit = sighting.fit(&unknown, 0.0, &receiver);
            let Fit { density, log_factor, inlier, on_edge, shares, .. } = fit;
            let error = sighting.across(&unknown, shares, &receiver);
            let moved = sighting.moved(&error, &receiver);
            // Either the position belongs to the road and tells the place, or it is an outlier, and
            // the place stays where the candidate lies, known to within the noise.
            let mut mixture = PlaceMixture::default();
            mixture.add(inlier, &sighting.within(&moved));
            mixture.add(1.0 - inlier, &unknown.unseen(state.along, sigma));
            (state.place, state.inlier) = (mixture.merged().unwrap_or(unknown).rounded(), inlier);
            // Given the position, `inlier` is the probability that it belongs to the road. That
            // part counts only as far as its place along lies on the edge.
            (density * (1.0 - inlier + inlier * on_edge)).ln() + log_factor
        };
        states.map(place).collect()
    }

    /// Finds the moves into each state and places the states by them. The last state is the one off
    /// the road.
    pub(super) fn weigh(
        &mut self,
        before: &PreviousStep<'_, P>,
        point: &TracePoint<P>,
        states: &mut [Candidate],
        interval: &Interval,
    ) {
        let receiver = Receiver::new(self.model, usual_deviation(self.model, point));
        let (matcher, model) = (self.matcher, self.model);
        let Memory { search, entries, sightings, places, .. } = &mut self.memory;
        let [leaves, returns] = [model.leaves(interval.seconds), model.returns(interval.seconds)];
        entries.resize_with(entries.len().max(states.len()), Vec::new);
        entries.iter_mut().for_each(Vec::clear);
        let Interval { seconds, kept, .. } = *interval;
        places.clear();
        places.extend(before.states.iter().zip(before.log_filtered).map(|(state, log)| {
            // Less probable states have no moves, so their places are never read.
            let is_left = *log >= NEGLIGIBLE;
            if is_left { receiver.predicted(&state.place, seconds, kept) } else { state.place }
        }));
        let (off_road, by_area) = (states.len() - 1, interval.off_road(model));
        let (log_weight_leaving, stays) = (by_area + leaves.ln(), (-leaves).ln_1p());
        let log_weight_returning = by_area + returns.ln() - METRES_OF_ROAD.ln();
        let Matcher { network, measures, .. } = matcher;
        let mut ways = Ways { network, measures, search };
        ways.set_targets(states, model, interval);
        for (number, (from, log)) in before.states.iter().zip(before.log_filtered).enumerate() {
            let entry = |log, inlier, shares| Entry {
                from: number,
                log,
                kind: Move::OffRoad,
                inlier,
                starts: None,
                shares,
            };
            let targets = states[..off_road].iter().zip(&*sightings);
            if from.is_off_road() {
                // Off the road no position tells the error, so nothing is known about it on the way
                // back.
                let unknown = receiver.unknown();
                places[number] = unknown;
                let is_likely = *log >= NEGLIGIBLE;
                for ((_, sighting), list) in targets.zip(entries.iter_mut()).filter(|_| is_likely) {
                    let fit = sighting.fit(&unknown, 0.0, &receiver);
                    let Fit { density, log_factor, inlier, on_edge, shares, .. } = fit;
                    let position = density * (1.0 - inlier + inlier * on_edge);
                    let log = position.ln() + log_factor;
                    list.push(entry(log_weight_returning + log, inlier, shares));
                }
                let stays = by_area + (-returns).ln_1p();
                entries[off_road].push(entry(stays, 0.0, unknown.shares));
                continue;
            }
            if *log < NEGLIGIBLE {
                continue;
            }
            // Every state may move to the state off the road, so every step has an allowed move.
            entries[off_road].push(entry(log_weight_leaving, 0.0, from.place.shares));
            ways.search_from(from, interval);
            for ((to, sighting), list) in targets.zip(entries.iter_mut()) {
                let Some(way) = ways.way(from, to, interval.spread) else { continue };
                let starts = way.starts.unwrap_or(0.0);
                // The distance is measured from the previous place to the position. After a U-turn
                // the way does not contain the start of this edge, so the distance is that of the
                // way, with independent errors.
                let mut fit = sighting.fit(&places[number], starts, &receiver);
                if way.starts.is_none() {
                    fit.ahead = Ahead::of(way.metres, interval.spread * interval.spread);
                }
                let mut fastest = matcher.speed(from).max(matcher.speed(to));
                if way.u_turns > 0 {
                    // A U-turn begins at a stop.
                    fastest = fastest.min(ACCELERATION * interval.seconds);
                }
                let (log, kind) = interval.weight(model, &way, fastest, &fit);
                if log > LEAST_WEIGHT {
                    let (log, starts) = (stays + log, way.starts);
                    // Kept for `place_by_moves`, which then needs no second fit.
                    let Fit { inlier, shares, .. } = fit;
                    list.push(Entry { from: number, log, kind, inlier, starts, shares });
                }
            }
        }
        self.place_by_moves(before, &mut states[..off_road], interval, &receiver);
    }

    /// Places the states on roads by the moves into them: for a vehicle that was stationary, one
    /// that moved, and one whose position is an outlier.
    fn place_by_moves(
        &self,
        before: &PreviousStep<'_, P>,
        states: &mut [Candidate],
        interval: &Interval,
        receiver: &Receiver,
    ) {
        let Memory { entries, sightings, places, .. } = &self.memory;
        for (number, state) in states.iter_mut().enumerate() {
            let log = |entry: &Entry| entry.log + before.log_filtered[entry.from];
            // Shares of the state's belief, scaled so that the largest is 1 and none overflows.
            let most = entries[number].iter().map(log).fold(f64::NEG_INFINITY, f64::max);
            let [mut mixture, mut moved] = [PlaceMixture::default(); 2];
            let [mut inliers, mut moves, mut sum] = [0.0; 3];
            let sighting = &sightings[number];
            for entry in &entries[number] {
                let p = (log(entry) - most).exp();
                // NaN comes from −∞ − −∞: all moves into the state are impossible.
                if p < LEAST_SHARE || p.is_nan() {
                    continue;
                }
                let Entry { from, inlier, starts, shares, .. } = *entry;
                let p_stationary = match entry.kind {
                    Move::Along { p_stationary, .. } => p_stationary,
                    Move::OffRoad => 0.0,
                };
                let place = places[from].counted_from(starts.unwrap_or(0.0));
                let error = sighting.across(&place, shares, receiver);
                let [still, moving] =
                    [p_stationary, 1.0 - p_stationary].map(|share| p * inlier * share);
                if still > LEAST_SHARE {
                    // A stationary vehicle is where it was, so its position is one more measurement
                    // of that place.
                    mixture.add(still, &sighting.within(&sighting.stationary(&error, receiver)));
                }
                // For a moving vehicle only the error matters, not the previous place. So the
                // errors of all moves are merged first, and placed by the position once.
                moved.add(moving, &error);
                moves += moving;
                if p * (1.0 - inlier) > LEAST_SHARE {
                    let unseen = match starts {
                        // An outlier tells nothing about the place. On the same edge the previous
                        // place is still the best estimate; on another edge it means nothing, so
                        // only the candidate's own place is known.
                        Some(0.0) => places[from],
                        _ => places[from].unseen(state.along, interval.spread),
                    };
                    mixture.add(p * (1.0 - inlier), &unseen);
                }
                inliers += p * inlier;
                sum += p;
            }
            if let Some(error) = moved.merged() {
                mixture.add(moves, &sighting.within(&sighting.moved(&error, receiver)));
            }
            state.place = mixture.merged().unwrap_or_else(|| receiver.unknown()).rounded();
            state.inlier = if sum > 0.0 { inliers / sum } else { 0.0 };
        }
    }
}

impl<P> Matcher<P> {
    /// Speed of a state's road: the posted or the typical one, whichever is higher.
    fn speed(&self, state: &Candidate) -> f64 {
        let edge = &self.network.edges()[state.edge as usize];
        edge.speed.unwrap_or(0.0).max(speed_of(edge.class))
    }
}
