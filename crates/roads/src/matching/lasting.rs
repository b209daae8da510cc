//! Share ρ of a receiver's error variance that lasts, and its time constant τ, estimated from the
//! errors across the most probable roads.
//!
//! The autocorrelation of a Gauss–Markov error plus white noise is ρ e^(−Δ/τ) at a lag of Δ
//! seconds. An error is only seen across its road, along the unit vector n; of two errors with the
//! covariance c in each direction, the product has the mean c (n·n'), so c is estimated by least
//! squares as Σ products (n·n') / Σ (n·n')². The curve is then fitted to these correlations, with a
//! prior.

use super::MatchModel;
use crate::matching::TracePoint;
use wayfix::map::Coordinates;

/// Lags in points at which errors are compared, and upper ends of the bins of their times in
/// seconds.
const LAGS: [usize; 10] = [1, 2, 3, 5, 8, 13, 21, 34, 55, 89];
const BINS: [f64; 7] = [1.5, 3.0, 6.0, 12.0, 24.0, 48.0, 96.0];

/// Prior weight of the logarithm of the time constant: 1 / 0.5², for a standard deviation of 0.5.
const PRIOR_LOG_LASTS: f64 = 4.0;
/// Range of the time constant in seconds, the number of steps of the search, and the largest
/// share.
const LASTS: [f64; 2] = [8.0, 60.0];
const STEPS: u32 = 40;
const MOST_LASTING: f64 = 0.995;

/// An error across a road, in metres, and the unit vector across.
#[derive(Debug, Clone, Copy)]
pub(super) struct Error {
    pub(super) metres: f64,
    pub(super) normal: [f64; 2],
}

/// Sums over pairs of errors in a bin, with the squares of the cosines between their directions as
/// weights.
#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    products: f64,
    seconds: f64,
    weight: f64,
}

/// Products of errors of drives, by the time between them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LastingErrors {
    bins: [Bin; BINS.len()],
    /// Sum of the squares of all errors, and their count.
    squares: [f64; 2],
    /// Seconds of all drives.
    seconds: f64,
}

impl LastingErrors {
    /// Sums of a drive over the points whose error is known.
    pub(super) fn of<P: Coordinates>(points: &[TracePoint<P>], errors: &[Option<Error>]) -> Self {
        let seconds = points.last().map_or(0.0, |last| last.time - points[0].time);
        let known = errors.iter().flatten();
        let squares = known
            .fold([0.0; 2], |[sum, count], error| [sum + error.metres * error.metres, count + 1.0]);
        let mut sums = Self { squares, seconds, ..Self::default() };
        for lag in LAGS {
            for (number, pair) in errors.iter().zip(errors.iter().skip(lag)).enumerate() {
                let (Some(a), Some(b)) = pair else { continue };
                let seconds = points[number + lag].time - points[number].time;
                // Lags above the last bin are longer than any time constant in range: they only add
                // noise.
                let Some(bin) = BINS.iter().position(|end| seconds < *end) else { continue };
                let cosine = a.normal[0] * b.normal[0] + a.normal[1] * b.normal[1];
                let bin = &mut sums.bins[bin];
                bin.products += a.metres * b.metres * cosine;
                bin.weight += cosine * cosine;
                bin.seconds += cosine * cosine * seconds;
            }
        }
        sums
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            bin.products += other.products;
            bin.seconds += other.seconds;
            bin.weight += other.weight;
        }
        self.seconds += other.seconds;
        for (sum, other) in self.squares.iter_mut().zip(other.squares) {
            *sum += other;
        }
    }

    /// Standard deviation of all errors.
    pub(super) fn deviation(&self) -> f64 {
        let [squares, count] = self.squares;
        (squares / count.max(1.0)).sqrt()
    }

    /// Share of the variance that lasts, and its time constant in seconds, by least squares with
    /// the prior, whose share counts as `prior_weight` independent pairs of errors.
    pub(super) fn fit(&self, prior: &MatchModel, prior_weight: f64) -> [f64; 2] {
        let variance = self.deviation().powi(2);
        // Pairs within one time constant τ count as one: however densely points are sampled, a
        // drive of T seconds has about T / 2τ independent pairs.
        let independent = self.seconds / (2.0 * prior.lasts);
        let found = self.bins.iter().filter(|bin| bin.weight > 0.0 && variance > 0.0);
        let found = found.map(|bin| {
            let correlation = bin.products / bin.weight / variance;
            (bin.seconds / bin.weight, correlation, bin.weight.min(independent))
        });
        let mut best = (f64::INFINITY, [prior.lasting, prior.lasts]);
        for step in 0..=STEPS {
            // For a fixed time constant the share is a linear least squares problem; the time
            // constant is searched on a logarithmic grid.
            let lasts = LASTS[0] * (LASTS[1] / LASTS[0]).powf(f64::from(step) / f64::from(STEPS));
            let (mut xy, mut xx) = (prior_weight * prior.lasting, prior_weight);
            for (seconds, correlation, weight) in found.clone() {
                let kept = (-seconds / lasts).exp();
                xy += weight * kept * correlation;
                xx += weight * kept * kept;
            }
            let lasting = (xy / xx).clamp(0.0, MOST_LASTING);
            let error = |seconds: f64, correlation: f64, weight: f64| {
                weight * (correlation - lasting * (-seconds / lasts).exp()).powi(2)
            };
            // All three terms are on one scale, so their sum can compare time constants.
            let mut errors = prior_weight * (lasting - prior.lasting).powi(2);
            errors += PRIOR_LOG_LASTS * (lasts / prior.lasts).ln().powi(2);
            errors += found.clone().map(|(s, c, w)| error(s, c, w)).sum::<f64>();
            if errors < best.0 {
                best = (errors, [lasting, lasts]);
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wayfix::map::PlanePosition;

    /// A share of .7 that lasts 25 s is found from ten hours of errors, and 60 s apart they say so
    /// little that the prior stays.
    #[test]
    fn finds_what_lasts() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        // A sum of twelve is near a normal variable.
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let prior = MatchModel::default();
        for (seconds, count, margin) in [(1.0, 36_000, 0.1), (5.0, 7_200, 0.1), (60.0, 600, 0.3)] {
            let kept = (-seconds / 25.0_f64).exp();
            let (mut slow, mut errors, mut points) = (normal(), Vec::new(), Vec::new());
            for number in 0..count {
                slow = kept * slow + (1.0 - kept * kept).sqrt() * normal();
                let metres = 4.0 * (0.7_f64.sqrt() * slow + 0.3_f64.sqrt() * normal());
                errors.push(Some(Error { metres, normal: [1.0, 0.0] }));
                let position = PlanePosition { x: 0.0, y: 0.0 };
                points.push(TracePoint::new(seconds * f64::from(number), position));
            }
            let [lasting, lasts] = LastingErrors::of(&points, &errors).fit(&prior, 25.0);
            assert!((lasting - 0.7).abs() < margin, "{seconds}: {lasting}, {lasts}");
            assert!(seconds > 10.0 || (lasts / 25.0).ln().abs() < 0.35, "{seconds}: {lasts}");
            assert!(seconds < 10.0 || (lasting - prior.lasting).abs() < 0.1, "{lasting}");
        }
    }
}
