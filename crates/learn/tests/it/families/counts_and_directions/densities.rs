//! Densities against independent formulas, sums and integrals.

use std::f64::consts::{PI, TAU};

use wayfix::Likelihood;
use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Gamma, LogNormal, Multinomial, NegativeBinomial,
    Poisson, VonMises, VonMisesFisher, Weibull, WrappedCauchy,
};

use super::kit::density;

/// Sum of p(y) times the width over a grid, which is one.
#[track_caller]
fn assert_one(
    family: &impl Likelihood<Observation = [f64]>,
    grid: impl Iterator<Item = (f64, f64)>,
) {
    let sum: f64 = grid.map(|(y, width)| width * density(family, 0, &[y]).exp()).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
}

/// Points y and y dx of an even grid in x = ln y.
fn in_logs(middle: f64, width: f64) -> impl Iterator<Item = (f64, f64)> {
    let step = width / 10_000.0;
    (-10_000..=10_000).map(move |k| {
        let y = (middle + step * f64::from(k)).exp();
        (y, y * step)
    })
}

#[test]
fn sums_and_integrals_are_one() {
    for rate in [0.0, 0.3, 1.0, 17.5, 63.0, 900.0] {
        let family = Poisson::family(&[[rate]]).unwrap();
        assert_one(&family, (0..3000).map(|y| (f64::from(y), 1.0)));
    }
    for shape in [0.5, 1.0, 7.5, 300.0, 1e9] {
        for scale in [1e-9, 1.0, 3e5] {
            let family = Gamma::family(&[[shape]], &[[scale]]).unwrap();
            let middle = f64::ln(shape * scale);
            assert_one(
                &family,
                in_logs(middle, f64::min(60.0, 12.0 / f64::sqrt(shape) + 40.0 / shape)),
            );
        }
    }
    for deviation in [1e-6, 0.3, 5.0] {
        let family = LogNormal::family(&[[-3.0]], &[[deviation]]).unwrap();
        assert_one(&family, in_logs(-3.0, 10.0 * deviation));
    }
    for concentration in [0.0, 1e-3, 1.0, 39.0, 41.0, 1e4, 1e9] {
        let family = VonMises::family(&[[2.5]], &[[concentration]]).unwrap();
        let width = f64::min(PI, 10.0 / f64::sqrt(concentration));
        let step = width / 2000.0;
        assert_one(&family, (-2000..2000).map(|k| (2.5 + step * f64::from(k), step)));
    }
    for mean in [0.3, 17.5, 900.0] {
        for dispersion in [0.0, 1e-9, 0.01, 2.0] {
            let family = NegativeBinomial::family(&[[mean]], &[[dispersion]]).unwrap();
            assert_one(&family, (0..60_000).map(|y| (f64::from(y), 1.0)));
        }
    }
    for shape in [0.3, 1.0, 4.5, 1e6] {
        let family = Weibull::family(&[[shape]], &[[3e5]]).unwrap();
        assert_one(&family, in_logs(3e5_f64.ln(), 40.0 / shape));
    }
    // Doubles just below 1 are sparse, so that a small second shape would lose some mass.
    for (a, b) in [(0.5, 2.0), (2.0, 7.5), (300.0, 1e3), (1e9, 3e9)] {
        // In log odds.
        let family = Beta::family(&[[a]], &[[b]]).unwrap();
        let width = f64::min(80.0, 12.0 * (1.0 / a + 1.0 / b).sqrt() + 20.0 * (1.0 / a + 1.0 / b));
        let grid = (-5000..=5000).map(|k| {
            let odds = (width / 5000.0 * f64::from(k)).exp() * a / b;
            (odds / (1.0 + odds), width / 5000.0 * odds / (1.0 + odds).powi(2))
        });
        assert_one(&family, grid.filter(|(y, _)| *y > 0.0 && *y < 1.0));
    }
    for concentration in [0.0, 1e-3, 0.5, 0.99] {
        let family = WrappedCauchy::family(&[[2.5]], &[[concentration]]).unwrap();
        let step = PI / 4000.0;
        assert_one(&family, (-4000..4000).map(|k| (2.5 + step * f64::from(k), step)));
    }
    let family = Bernoulli::family(&[[0.3]]).unwrap();
    assert_one(&family, [(0.0, 1.0), (1.0, 1.0)].into_iter());
}

#[test]
fn distributions_that_are_others_have_their_densities() {
    let same = |a: f64, b: f64| assert!((a - b).abs() <= 1e-13 * a.abs().max(1.0), "{a} {b}");
    for rate in [1e-300_f64, 0.2, 7e5] {
        let times = Exponential::family(&[[rate]]).unwrap();
        let gamma = Gamma::family(&[[1.0]], &[[rate.recip()]]).unwrap();
        for y in [1e-9, 0.3, 1.0, 200.0].map(|y| y / rate) {
            same(density(&times, 0, &[y]), density(&gamma, 0, &[y]));
        }
    }
    for (trials, p) in [(1, 0.3), (5, 0.25), (63, 0.9), (64, 0.9), (1_000_000, 0.75)] {
        let counts = Binomial::family(&[trials], &[[p]]).unwrap();
        let both = Multinomial::new(&[[p, 1.0 - p]]).unwrap();
        for y in [0, 1, trials / 3, trials - 1, trials].map(f64::from) {
            let row = [y, f64::from(trials) - y];
            let (a, b) = (density(&counts, 0, &[y]), density(&both, 0, &row));
            assert!((a - b).abs() <= 1e-12 * a.abs().max(1.0), "{trials}, {y}: {a} {b}");
        }
        let above = [f64::from(trials) + 1.0];
        assert_eq!(density(&counts, 0, &above), f64::NEG_INFINITY);
    }
}

/// Area of the unit sphere in d dimensions.
fn area(dimensions: usize) -> f64 {
    match dimensions {
        1 => 2.0,
        2 => TAU,
        d => TAU / (d as f64 - 2.0) * area(d - 2),
    }
}

/// Integral over the angle to the mean direction: the density depends on nothing else.
#[test]
fn densities_of_directions_integrate_to_one() {
    for dimensions in [2, 3, 4, 7, 20, 101] {
        for concentration in [0.0, 0.1, 3.0, 39.0, 41.0, 300.0, 1e4, 1e8] {
            let mut mean = vec![0.0; dimensions];
            mean[0] = 1.0;
            let family = VonMisesFisher::new(&[mean], &[concentration]).unwrap();
            let widest = 5.0 * f64::sqrt(dimensions as f64) + 8.0;
            let width = f64::min(PI, widest / f64::sqrt(concentration));
            let step = width / 4000.0;
            let mut sum = 0.0;
            for k in 0..4000 {
                let angle = step * (f64::from(k) + 0.5);
                let mut y = vec![0.0; dimensions];
                (y[1], y[0]) = angle.sin_cos();
                // In logarithms, since one factor may be huge and the other tiny.
                let ring = area(dimensions - 1).ln() + (dimensions - 2) as f64 * angle.sin().ln();
                sum += step * (ring + density(&family, 0, &y)).exp();
            }
            assert!((sum - 1.0).abs() < 1e-6, "{sum} for {dimensions} and {concentration}");
        }
    }
}

#[test]
fn directions_in_the_plane_are_angles() {
    for concentration in [0.0, 0.7, 50.0, 1e7] {
        let angles = VonMises::family(&[[0.9]], &[[concentration]]).unwrap();
        let (sin, cos) = f64::sin_cos(0.9);
        let vectors = VonMisesFisher::new(&[[cos, sin]], &[concentration]).unwrap();
        for y in [-2.0, 0.85, 0.9, 0.9001, 4.0] {
            let (sin, cos) = f64::sin_cos(y);
            let (a, b) = (density(&angles, 0, &[y]), density(&vectors, 0, &[cos, sin]));
            assert!((a - b).abs() <= 1e-12 * a.abs().max(1.0), "{a} {b}");
        }
    }
}

#[test]
fn neighbouring_counts_have_the_ratio_of_the_rate_and_the_count() {
    for rate in [0.5, 40.0, 300.0] {
        let family = Poisson::family(&[[rate]]).unwrap();
        let log = |count: u16| density(&family, 0, &[f64::from(count)]);
        for count in 1..600 {
            let (before, after) = (log(count - 1), log(count));
            let expected = before + (rate / f64::from(count)).ln();
            assert!((after - expected).abs() < 1e-14 * (10.0 + after.abs()), "{rate}, {count}");
        }
    }
}

#[test]
fn multinomial_counts_are_poisson_counts_given_their_sum() {
    let shares = [0.2, 0.0, 0.5, 0.3];
    let multinomial = Multinomial::new(&[shares]).unwrap();
    for row in [[1.0, 0.0, 2.0, 0.0], [9.0, 0.0, 30.0, 20.0], [10.0, 0.0, 30.0, 24.0], [0.0; 4]] {
        let total: f64 = row.iter().sum();
        let rates = shares.map(|p| 40.0 * p);
        let parts = density(&Poisson::family(&[rates]).unwrap(), 0, &row);
        let expected = parts - density(&Poisson::family(&[[40.0]]).unwrap(), 0, &[total]);
        let found = density(&multinomial, 0, &row);
        assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{found} {expected}");
    }
    assert_eq!(density(&multinomial, 0, &[0.0, 1.0, 0.0, 0.0]), f64::NEG_INFINITY);
    assert_eq!(density(&multinomial, 0, &[100.0, 1.0, 0.0, 0.0]), f64::NEG_INFINITY);
}

/// Components multiply, and a missing one is integrated out.
#[test]
fn missing_components_leave_the_marginal() {
    let one = |rate: f64| Poisson::family(&[[rate], [2.0 * rate]]).unwrap();
    let two = Poisson::family(&[[3.0, 8.0], [6.0, 16.0]]).unwrap().with_missing();
    for state in 0..2 {
        let parts = density(&one(3.0), state, &[4.0]) + density(&one(8.0), state, &[5.0]);
        assert!((density(&two, state, &[4.0, 5.0]) - parts).abs() < 1e-13);
        let second = density(&one(8.0), state, &[5.0]);
        assert_eq!(density(&two, state, &[f64::NAN, 5.0]), second);
        assert_eq!(density(&two, state, &[f64::NAN; 2]), 0.0);
    }
    let rows = Multinomial::new(&[[0.5, 0.5]]).unwrap().with_missing();
    assert_eq!(density(&rows, 0, &[f64::NAN; 2]), 0.0);
    let vectors = VonMisesFisher::new(&[[0.6, 0.8]], &[3.0]).unwrap().with_missing();
    assert_eq!(density(&vectors, 0, &[f64::NAN; 2]), 0.0);
}
