//! How far the vehicle has driven in a step, by its own count.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use crate::error::TransitionError;

/// What the wheels say of a step: a distance, with the variance of its error.
///
/// Both are in the unit of the operator: metres, say, for a
/// [`DistanceTransition`](crate::DistanceTransition), and **places** for a
/// [`RouteTransition`](crate::RouteTransition): a distance of 1.5 is one and a
/// half times the way from one reference image to the next, and negative if the
/// vehicle reverses. A variance of 0 is a distance without error, which is for routes
/// alone.
///
/// # What it says of moves along a route
///
/// How many references m the vehicle passes does not follow from the distance
/// d alone, since it may stand anywhere between two of them: on the way 0.4,
/// say, it passes one in four cases of ten. All places between two references
/// being alike, m has the triangular distribution max(0, 1 − |m − d|). With a
/// Gaussian error of variance s² the probability is the integral of triangle
/// times density,
///
/// o(m) = s \[h((m − d + 1) / s) − 2 h((m − d) / s) + h((m − d − 1) / s)\],
/// h(x) = x Φ(x) + φ(x),
///
/// since the triangle is the second difference of a ramp, and s h(x / s) is the
/// ramp max(0, x) blurred. Over all whole m it sums to one, with mean d.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Odometry {
    /// How far it has driven; finite.
    pub distance: f64,
    /// The variance of the distance, in squared units; finite and at least 0.
    pub variance: f64,
}

/// From this standard deviation on, the differences are had by a series.
const WIDE: f64 = 4.0;

impl Odometry {
    /// Whether the numbers are ones that a distance and a variance can have.
    pub(crate) fn check(&self) -> Result<(), TransitionError> {
        let Self { distance, variance } = self;
        if !distance.is_finite() {
            let text = format!("an odometry distance of {distance}, expected a finite value");
            return Err(TransitionError::Control(text));
        }
        if !(*variance >= 0.0 && variance.is_finite()) {
            let text = format!(
                "an odometry variance of {variance}, expected a finite value of at least 0"
            );
            return Err(TransitionError::Control(text));
        }
        Ok(())
    }

    /// o(m), for odometry that is valid: to about 1e-12 of itself, if it is not
    /// below 1e-290.
    pub(crate) fn probability(&self, moves: f64) -> f64 {
        let s = self.variance.sqrt();
        // It is even. On this side all three terms are tails, but for a ramp.
        let a = -(moves - self.distance).abs();
        if s == 0.0 {
            return (a + 1.0).max(0.0);
        }
        if s >= WIDE {
            return wide(a, s);
        }
        let ramp = |b: f64| b.max(0.0) + s * tail(b.abs() / s);
        // Only where the terms underflow may the difference come out below 0.
        (ramp(a + 1.0) - 2.0 * ramp(a) + ramp(a - 1.0)).max(0.0)
    }
}

fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// h(−y) = φ(y) − y (1 − Φ(y)), for y of at least 0.
fn tail(y: f64) -> f64 {
    if y < 3.0 {
        return density(y) - 0.5 * y * libm::erfc(y * FRAC_1_SQRT_2);
    }
    // The difference cancels. With Laplace's continued fraction
    // (1 − Φ(y)) / φ(y) = 1 / (y + t), t = 1 / (y + 2 / (y + 3 / (y + …))), it
    // is φ(y) t / (y + t). From y = 3 on, 60 terms are enough.
    let t = (1..=60).rev().fold(0.0, |t, k| f64::from(k) / (y + t));
    density(y) * (t / (y + t))
}

/// The second difference where it would cancel: its Taylor series,
/// φ(z) / s Σ 2 / (2j + 2)! He_2j(z) / s^2j with z = a / s, in which the first
/// term is the largest unless all are positive.
fn wide(a: f64, s: f64) -> f64 {
    let z = a / s;
    if z < -40.0 {
        return 0.0; // below the smallest double
    }
    // He_n(z) / s^n for two n in turn, and 2 / (2j + 2)!.
    let (mut even, mut odd, mut factor) = (1.0, z / s, 1.0);
    let mut sum = even;
    for j in 1..=24 {
        let n = f64::from(2 * j);
        even = z / s * odd - (n - 1.0) / (s * s) * even;
        odd = z / s * even - n / (s * s) * odd;
        factor /= (n + 1.0) * (n + 2.0);
        sum += factor * even;
    }
    density(z) / s * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangle times density by Gauss–Legendre quadrature, on pieces that are
    /// no wider than an eighth of the blur.
    fn by_quadrature(moves: f64, distance: f64, s: f64) -> f64 {
        const NODES: [(f64, f64); 4] = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
            (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
        ];
        let a = moves - distance;
        let pieces = (16..=100_000_u32).find(|count| f64::from(*count) * s >= 8.0).unwrap();
        let width = 1.0 / f64::from(pieces);
        let mut sum = 0.0;
        for piece in 0..pieces {
            for (node, weight) in NODES {
                for node in [-node, node] {
                    let t = (f64::from(piece) + 0.5 * (1.0 + node)) * width;
                    let both = density((a - t) / s) + density((a + t) / s);
                    sum += 0.5 * width * weight * (1.0 - t) * both / s;
                }
            }
        }
        sum
    }

    #[test]
    fn it_is_the_integral_of_triangle_and_density() {
        for s in [0.01, 0.1, 0.3, 0.7, 1.0, 2.0, 3.99, 4.0, 4.01, 9.0, 100.0, 1e4, 1e7] {
            for distance in [0.0, 0.25, 0.5, 1.0, -3.7, 0.999, 2.0, 12.6] {
                let odometry = Odometry { distance, variance: s * s };
                for moves in -60..=60 {
                    let moves = f64::from(moves);
                    let expected = by_quadrature(moves, distance, s);
                    let found = odometry.probability(moves);
                    assert!(found >= 0.0);
                    if expected > 1e-290 {
                        let error = (found / expected - 1.0).abs();
                        assert!(error < 1e-11, "{moves} {odometry:?}: {found} for {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn both_forms_agree_where_they_meet() {
        let direct = |a: f64, s: f64| {
            let ramp = |b: f64| b.max(0.0) + s * tail(b.abs() / s);
            ramp(a + 1.0) - 2.0 * ramp(a) + ramp(a - 1.0)
        };
        for s in [3.0, WIDE, 5.0] {
            for a in 0..1000 {
                let a = -f64::from(a) * s * 0.035;
                let (found, expected) = (wide(a, s), direct(a, s));
                assert!((found / expected - 1.0).abs() < 1e-12, "{a} {s}: {found} {expected}");
            }
        }
        assert!((density(3.0) - 1.5 * libm::erfc(3.0 * FRAC_1_SQRT_2) - tail(3.0)).abs() < 1e-17);
    }

    #[test]
    fn without_error_it_is_the_triangle() {
        for (distance, moves, expected) in [
            (0.0, 0.0, 1.0),
            (0.25, 0.0, 0.75),
            (0.25, 1.0, 0.25),
            (0.25, 2.0, 0.0),
            (-1.5, -1.0, 0.5),
        ] {
            let p = |variance| Odometry { distance, variance }.probability(moves);
            assert_eq!(p(0.0), expected);
            assert!((p(1e-30) - expected).abs() < 1e-14);
            assert_eq!(p(5e-324), expected);
        }
    }

    #[test]
    fn it_is_a_distribution_with_the_mean_of_the_distance() {
        for s in [0.0, 1e-3, 0.2, 1.0, 3.9, 4.1, 20.0] {
            let odometry = Odometry { distance: 3.4, variance: s * s };
            let p = |m: i32| odometry.probability(f64::from(m));
            let sum: f64 = (-800..800).map(p).sum();
            let mean: f64 = (-800..800).map(|m| f64::from(m) * p(m)).sum();
            assert!((sum - 1.0).abs() < 1e-13 && (mean - 3.4).abs() < 1e-12, "{s} {sum} {mean}");
        }
    }

    #[test]
    fn no_distance_is_too_far_and_no_variance_too_large() {
        for distance in [-1e308, -1e9, 0.3, 1e9, 1e308] {
            for variance in [0.0, 5e-324, 1e-200, 1e-9, 1.0, 1e9, 1e200, f64::MAX] {
                let p = Odometry { distance, variance }.probability(1.0);
                assert!((0.0..=1.0).contains(&p), "{distance} {variance}: {p}");
            }
        }
        let p = |distance| Odometry { distance, variance: 1.0 }.probability(0.0);
        assert!(p(30.0) > 0.0 && p(30.0) == p(-30.0) && p(31.0) < p(30.0));
    }
}
