//! Tracking of a simulated drive, live and afterwards.
//!
//! Times cover the matcher alone, without the bookkeeping of the measures.

use std::collections::VecDeque;
use std::time::Instant;

use wayfix_roads::matching::{MatchError, MatchedDrive, Matcher, Stretch};

use super::roads::measures::{Forecasts, Lengths, edges_of, is_among};
use super::roads::off_road::OffRoad;
use super::roads::simulate::Simulated;

/// Sums of the measures of drives.
#[derive(Default)]
pub(crate) struct Tracked {
    pub(crate) points: usize,
    pub(crate) live_seconds: f64,
    pub(crate) match_seconds: f64,
    /// Largest size of a vehicle in bytes.
    pub(crate) bytes: usize,
    /// Sum of the numbers of candidates over all points.
    pub(crate) candidates: f64,
    pub(crate) lengths: Lengths,
    pub(crate) forecasts: Forecasts,
    pub(crate) off_road: OffRoad,
}

impl Tracked {
    pub(crate) fn add(&mut self, other: &Self) {
        self.points += other.points;
        self.live_seconds += other.live_seconds;
        self.match_seconds += other.match_seconds;
        self.bytes = self.bytes.max(other.bytes);
        self.candidates += other.candidates;
        self.lengths.add(other.lengths);
        self.forecasts.extend(&other.forecasts);
        self.off_road.add(other.off_road);
    }
}

/// Tracks a drive live, as a vehicle would, then matches it as a whole.
pub(crate) fn track(
    matcher: &Matcher,
    drive: &Simulated,
    lag: usize,
) -> Result<(Tracked, MatchedDrive), MatchError> {
    let points = &drive.points;
    let mut tracked = Tracked { points: points.len(), ..Tracked::default() };
    let start = Instant::now();
    let mut vehicle = matcher.start(&points[0], lag)?;
    tracked.live_seconds += start.elapsed().as_secs_f64();
    let (mut live, mut late) = (vec![vehicle.live()], VecDeque::new());
    for point in &points[1..] {
        let start = Instant::now();
        vehicle.step(matcher, point)?;
        live.push(vehicle.live());
        tracked.live_seconds += start.elapsed().as_secs_f64();
        // Not part of the time.
        tracked.bytes = tracked.bytes.max(vehicle.bytes());
        // After this each step completes one late answer, for the point `lag` points ago: the
        // first is for point 0.
        if vehicle.points_late() == lag {
            late.push_back(vehicle.late());
        }
    }
    let start = Instant::now();
    let matched = matcher.match_drive(points)?;
    tracked.match_seconds = start.elapsed().as_secs_f64();
    // Back to a sum, so that drives of different lengths can be added.
    tracked.candidates = matched.candidates() * points.len() as f64;
    let network = matcher.network();
    for (point, &truth) in drive.truth.iter().enumerate() {
        // At the end of the drive no later points follow, and a late answer is a smoothed one.
        let late = late.pop_front().unwrap_or_else(|| matched.smoothed(point));
        let answers = [live[point], late, matched.smoothed(point)];
        tracked.off_road.push(truth.is_none(), answers);
        let right = edges_of(network, truth.into_iter().map(|(edge, _)| edge));
        tracked.forecasts.push(answers, |answer| match truth {
            Some(_) => is_among(network, &right, answer),
            None => answer.edge.is_none(),
        });
    }
    let driven = |part: &Stretch| Some((part.edge?, [part.enter, part.exit]));
    let truth: Vec<_> = drive.route.iter().filter_map(driven).collect();
    tracked.lengths = Lengths::of(network, &truth, matched.route());
    Ok((tracked, matched))
}
