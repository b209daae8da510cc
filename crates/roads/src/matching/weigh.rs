//! Weights of the moves into the states of a step, and the placement of the states by them.
//!
//! Each state holds a Gaussian of its place along the road and of the receiver's error, for each
//! kind of reception. A move from state j predicts that Gaussian and updates it by the new
//! position; the normaliser of this update is the density within the move's weight. The Gaussians
//! of all moves into a state, weighted by their shares of its belief, are then merged by their
//! first two moments (Blom and Bar-Shalom 1988), so that a state stays of constant size.

use super::candidates::{Candidate, deviation, usual_deviation};
use super::matcher::{Entry, Memory};
use super::moves::{Interval, Move, speed_of};
use super::place::PlaceMixture;
use super::receiver::Receiver;
use super::sighting::{Ahead, Fit, Sighting};
use super::step::{MatchStep, PreviousStep};
use super::ways::Ways;
use super::{Matcher, TracePoint};
use wayfix::map::Coordinates;

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
            let Fit { density, log_factor, inlier, share, shares, .. } = fit;
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
            (density * (1.0 - inlier + inlier * share)).ln() + log_factor
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
            // The others have no moves, so their places are never read.
            let is_left = *log >= NEGLIGIBLE;
            if is_left { receiver.predicted(&state.place, seconds, kept) } else { state.place }
        }));
        let (off_road, by_area) = (states.len() - 1, interval.off_road(model));
        let (into_off_road, stays) = (by_area + leaves.ln(), (-leaves).ln_1p());
        let onto_road = by_area + returns.ln() - METRES_OF_ROAD.ln();
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
                    let Fit { density, log_factor, inlier, share, shares, .. } = fit;
                    let position = density * (1.0 - inlier + inlier * share);
                    let log = position.ln() + log_factor;
                    list.push(entry(onto_road + log, inlier, shares));
                }
                let stays = by_area + (-returns).ln_1p();
                entries[off_road].push(entry(stays, 0.0, unknown.shares));
                continue;
            }
            if *log < NEGLIGIBLE {
                continue;
            }
            // Any state can be left for the state off the road, so that every step has an allowed
            // move.
            entries[off_road].push(entry(into_off_road, 0.0, from.place.shares));
            ways.search_from(from, interval);
            for ((to, sighting), list) in targets.zip(entries.iter_mut()) {
                let Some(way) = ways.way(from, to, interval.spread) else { continue };
                let starts = way.starts.unwrap_or(0.0);
                // The distance is measured from the place before to the position. After a U-turn
                // the edge of the state has no start on the way, so the distance is that of the
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
            // Shares of the state's belief up to a factor, by which none overflows and the largest
            // is 1.
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
                let stood = match entry.kind {
                    Move::Along { stood, .. } => stood,
                    Move::OffRoad => 0.0,
                };
                let place = places[from].counted_from(starts.unwrap_or(0.0));
                let error = sighting.across(&place, shares, receiver);
                let [still, moving] = [stood, 1.0 - stood].map(|share| p * inlier * share);
                if still > LEAST_SHARE {
                    // A stationary vehicle is where it was, so its position is one more measurement
                    // of that place.
                    mixture.add(still, &sighting.within(&sighting.stood(&error, receiver)));
                }
                // For a moving vehicle the place before does not matter, only the error: these are
                // merged first, and placed by the position once for all moves.
                moved.add(moving, &error);
                moves += moving;
                if p * (1.0 - inlier) > LEAST_SHARE {
                    let unseen = match starts {
                        // On the same edge the place before still holds; elsewhere only the
                        // candidate's is known.
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
