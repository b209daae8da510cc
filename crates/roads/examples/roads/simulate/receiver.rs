//! Positions that a simulated receiver reports: a Gauss–Markov offset, white noise, outliers and
//! gaps.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix_roads::matching::TracePoint;

use super::{Movable, Scenario};

/// Share of the variance of positions that lasts, and its time constant in seconds.
const LASTING: f64 = 0.7;
const LASTS: f64 = 25.0;

/// Largest error of an outlier in each direction, in metres.
const OUTLIER: f64 = 150.0;

/// Length of a gap in seconds, the share of gaps without points, and the factor of the errors in
/// the others.
const GAP: std::ops::Range<f64> = 20.0..120.0;
const LOST: f64 = 0.5;
const POOR: f64 = 4.0;

/// Lasting error of a receiver, in standard deviations to the east and to the north.
struct Offset([f64; 2]);

impl Offset {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        Self([StandardNormal.sample(rng), StandardNormal.sample(rng)])
    }

    /// Advances by a time.
    fn go_on(&mut self, seconds: f64, rng: &mut ChaCha8Rng) {
        // A stationary Gauss–Markov step: κ² + (1 − κ²) keeps the variance at 1.
        let kept = (-seconds / LASTS).exp();
        for part in &mut self.0 {
            let new: f64 = StandardNormal.sample(rng);
            *part = kept * *part + (1.0 - kept * kept).sqrt() * new;
        }
    }
}

/// Points reported from places, one per interval; `None` where reception is lost.
pub(crate) fn receive<P: Movable>(
    places: &[P],
    scenario: &Scenario,
    rng: &mut ChaCha8Rng,
) -> Vec<Option<TracePoint<P>>> {
    let seconds = (places.len() - 1) as f64 * scenario.every;
    let gap = rng.random_bool(scenario.gaps).then(|| rng.random_range(GAP));
    // The gap lies strictly between the first point and the last one.
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
