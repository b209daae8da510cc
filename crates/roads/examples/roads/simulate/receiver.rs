//! Positions that a receiver reports.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix_roads::matching::TracePoint;

use super::{Movable, Scenario};

/// Share of the variance of positions that lasts, and for how many seconds.
const LASTING: f64 = 0.7;
const LASTS: f64 = 25.0;

/// Metres by which an outlier is off in each direction, at most.
const OUTLIER: f64 = 150.0;

/// Seconds of a gap, the share of gaps without points, and how many times as large the errors are
/// in the others.
const GAP: std::ops::Range<f64> = 20.0..120.0;
const LOST: f64 = 0.5;
const POOR: f64 = 4.0;

/// Error of a receiver that lasts, in deviations to the east and to the north.
struct Offset([f64; 2]);

impl Offset {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        Self([StandardNormal.sample(rng), StandardNormal.sample(rng)])
    }

    /// Goes on by a time.
    fn go_on(&mut self, seconds: f64, rng: &mut ChaCha8Rng) {
        let kept = (-seconds / LASTS).exp();
        for part in &mut self.0 {
            let new: f64 = StandardNormal.sample(rng);
            *part = kept * *part + (1.0 - kept * kept).sqrt() * new;
        }
    }
}

/// Points reported from places, one an interval; `None` where reception is lost.
pub(crate) fn receive<P: Movable>(
    places: &[P],
    scenario: &Scenario,
    rng: &mut ChaCha8Rng,
) -> Vec<Option<TracePoint<P>>> {
    let seconds = (places.len() - 1) as f64 * scenario.every;
    let gap = rng.random_bool(scenario.gaps).then(|| rng.random_range(GAP));
    // The first point and the last one are there.
    let gap = gap.filter(|gap| *gap < seconds).map(|gap| {
        let start = rng.random_range(0.0..seconds - gap);
        (start, start + gap)
    });
    let is_lost = rng.random_bool(LOST);
    let mut offset = Offset::new(rng);
    let mut point = |(number, place): (usize, &P)| {
        let time = number as f64 * scenario.every;
        let is_in_gap = gap.is_some_and(|(start, end)| start < time && time < end);
        let noise = scenario.noise * if is_in_gap { POOR } else { 1.0 };
        let mut metres = offset.0.map(|lasting| {
            let white: f64 = StandardNormal.sample(rng);
            noise * (LASTING.sqrt() * lasting + (1.0 - LASTING).sqrt() * white)
        });
        if rng.random_bool(scenario.outliers) {
            metres = metres.map(|_| rng.random_range(-OUTLIER..OUTLIER));
        }
        offset.go_on(scenario.every, rng);
        (!is_lost || !is_in_gap).then(|| TracePoint::new(time, place.moved(metres)))
    };
    places.iter().enumerate().map(&mut point).collect()
}
