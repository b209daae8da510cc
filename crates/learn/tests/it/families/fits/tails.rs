//! Tails against sums and integrals of the density.

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix_learn::{
    Beta, Binomial, Cumulative, Gamma, Hurdle, LogNormal, NegativeBinomial, Poisson, VonMises,
    Weibull, WrappedCauchy, ZeroInflated,
};

use super::units;
use crate::kit::{cases, cases_of, close, rng};

fn density<F: Cumulative>(part: &F, y: f64) -> f64 {
    F::point(y).map_or(0.0, |y| part.log_density(&y).exp())
}

/// Number of counts that are summed; for all parameters below, the rest is less than 1e-16 of the
/// tail.
fn counts_add_up<F: Cumulative>(part: &F, y: u32) -> TestCaseResult {
    let y = f64::from(y);
    let sum =
        |from: u32, to: u32| -> f64 { (from..to).rev().map(|k| density(part, f64::from(k))).sum() };
    let tails = part.tails(y);
    #[expect(clippy::cast_sign_loss, reason = "it was a number of this type")]
    let count = y as u32;
    close(tails.below, sum(0, count), 1e-10, 1e-200)?;
    close(tails.at, density(part, y), 1e-12, 1e-200)?;
    close(tails.above, sum(count + 1, 1500), 1e-10, 1e-200)?;
    close(tails.below + tails.at + tails.above, 1.0, 1e-12, 1.0)?;
    let between = part.tails(y + 0.5);
    close(between.below, tails.up_to(), 1e-10, 1e-200)?;
    close(between.above, tails.above, 1e-12, 1e-200)
}

/// Both tails change from one drawn number to another by the integral of the density between them
/// (by Simpson's rule, in a coordinate where it is smooth), and sum to one.
fn densities_add_up<F: Cumulative>(
    part: &F,
    seed: u64,
    [to, from]: [fn(f64) -> f64; 2],
    slope: fn(f64) -> f64,
) -> TestCaseResult {
    let mut rng = rng(seed);
    let mut ends = [part.draw(&mut rng), part.draw(&mut rng)];
    ends.sort_by(f64::total_cmp);
    let tails = ends.map(|y| part.tails(y));
    for tails in tails {
        close(tails.below + tails.above, 1.0, 1e-12, 1.0)?;
        prop_assert!(tails.at == 0.0 && tails.below >= 0.0 && tails.above >= 0.0);
    }
    let [low, high] = ends.map(to);
    let steps = 2000;
    let width = (high - low) / f64::from(steps);
    let mut integral = 0.0;
    for k in 0..=steps {
        let t = low + width * f64::from(k);
        let weight = if k == 0 || k == steps { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
        integral += weight * width / 3.0 * slope(t) * density(part, from(t));
    }
    close(tails[1].below - tails[0].below, integral, 1e-6, 1e-2)?;
    close(tails[0].above - tails[1].above, integral, 1e-6, 1e-2)
}

const LOGS: [fn(f64) -> f64; 2] = [f64::ln, f64::exp];
const SAME: [fn(f64) -> f64; 2] = [|y| y, |y| y];

proptest! {
    #![proptest_config(cases_of(500))]

    #[test]
    fn of_counts(unit in units(3), y in 0..80_u32) {
        let mean = (6.0 * unit[0] - 2.0).exp();
        let poisson = Poisson::new(mean).unwrap();
        counts_add_up(&poisson, y)?;
        counts_add_up(&NegativeBinomial::new(unit[0] * 20.0, 2.0 * unit[1]).unwrap(), y)?;
        counts_add_up(&Binomial::new(80, unit[1]).unwrap(), y)?;
        counts_add_up(&ZeroInflated::new(unit[2], poisson).unwrap(), y)?;
        let binomial = Binomial::new(90, 0.01 + 0.98 * unit[1]).unwrap();
        counts_add_up(&ZeroInflated::new(unit[2], binomial).unwrap(), y)?;
    }

    #[test]
    fn of_counts_over_a_hurdle(unit in units(2), y in 0..80_u32) {
        // Differences beyond 64 have the digits of 1.
        let part = Hurdle::new(unit[0], Poisson::new((5.0 * unit[1] - 2.0).exp()).unwrap()).unwrap();
        counts_add_up(&part, y)?;
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn of_positive_numbers(unit in units(2), seed in 0..1000_u64) {
        let (shape, scale) = ((8.0 * unit[0] - 2.0).exp(), (10.0 * unit[1] - 5.0).exp());
        densities_add_up(&Gamma::new(shape, scale).unwrap(), seed, LOGS, f64::exp)?;
        densities_add_up(&Weibull::new(shape, scale).unwrap(), seed, LOGS, f64::exp)?;
        densities_add_up(&LogNormal::new(scale.ln(), 0.1 + 3.0 * unit[0]).unwrap(), seed, LOGS, f64::exp)?;
    }

    #[test]
    fn of_shares(unit in units(2), seed in 0..1000_u64) {
        let odds: [fn(f64) -> f64; 2] = [|y| (y / (1.0 - y)).ln(), |t| 1.0 / (1.0 + (-t).exp())];
        let slope = |t: f64| 1.0 / (2.0 + t.exp() + (-t).exp());
        let [a, b] = [unit[0], unit[1]].map(|u| (6.0 * u - 1.0).exp());
        densities_add_up(&Beta::new(a + 0.5, b + 0.5).unwrap(), seed, odds, slope)?;
    }

    #[test]
    fn of_angles(unit in units(2), seed in 0..1000_u64) {
        let (mean, share) = (20.0 * unit[0] - 10.0, unit[1]);
        let concentration = (8.0 * share - 4.0).exp();
        densities_add_up(&VonMises::new(mean, concentration).unwrap(), seed, SAME, |_| 1.0)?;
        densities_add_up(&WrappedCauchy::new(mean, 0.8 * share).unwrap(), seed, SAME, |_| 1.0)?;
    }

    /// Parameters of any size: no tail is NaN, and both sum to one.
    #[test]
    fn of_any_parameters(a in -290.0..290.0_f64, b in -290.0..290.0_f64, y in -300.0..300.0_f64) {
        let [large, other, y] = [a, b, y].map(|log| 10.0_f64.powf(log));
        let mut all = Vec::new();
        all.extend(Gamma::new(large, other).map(|part| part.tails(y)));
        all.extend(Beta::new(large, other).map(|part| part.tails(y)));
        all.extend(Beta::new(large, other).map(|part| part.tails(y / (1.0 + y))));
        all.extend(Poisson::new(large).map(|part| part.tails(y)));
        all.extend(Poisson::new(large).map(|part| part.tails(y.floor())));
        all.extend(NegativeBinomial::new(large, other).map(|part| part.tails(y.floor())));
        all.extend(Binomial::new(u32::MAX, large / (1.0 + large)).map(|part| part.tails(y.floor())));
        all.extend(VonMises::new(other, large).map(|part| part.tails(y)));
        all.extend(Weibull::new(large, other).map(|part| part.tails(y)));
        for tails in all {
            let sum = tails.below + tails.at + tails.above;
            prop_assert!((sum - 1.0).abs() < 1e-6, "{tails:?}");
            let Some(least) = [tails.below, tails.at, tails.above].into_iter().reduce(f64::min) else {
                continue;
            };
            prop_assert!(least >= 0.0, "{tails:?}");
        }
    }
}
