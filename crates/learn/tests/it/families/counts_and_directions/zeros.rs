//! Zero-inflated and hurdle distributions: densities, draws and learning against the formulas.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix_learn::{
    Binomial, EmissionError, Gamma, Hurdle, Independent, NegativeBinomial, Poisson, Univariate,
    VonMises, ZeroInflated,
};

use super::kit::density;
use crate::kit::{cases_of, rng};

type Seen = Vec<(f64, f64)>;

fn learned<F: Univariate>(
    start: &Independent<F>,
    seen: &Seen,
) -> Result<Independent<F>, EmissionError> {
    let mut sums = start.statistics();
    seen.iter().for_each(|(y, weight)| start.add(&mut sums, &[*y], &[*weight]));
    start.maximize(&sums, 0.0).map_err(|error| *error.downcast().unwrap())
}

fn fit<F: Univariate>(start: F, seen: &Seen) -> Result<F, EmissionError> {
    let start = Independent::from_rows(&[[start]]).unwrap();
    learned(&start, seen).map(|family| family.component(0, 0).unwrap().clone())
}

fn likelihood<F: Univariate>(of: &F, seen: &Seen) -> f64 {
    seen.iter().map(|(y, weight)| weight * of.log_density(&F::point(*y).unwrap())).sum()
}

#[test]
fn densities_are_those_of_the_formulas() {
    let counts = Poisson::new(1.3).unwrap();
    let one = |y: f64| density(&Poisson::family(&[[1.3]]).unwrap(), 0, &[y]).exp();
    for w in [0.0, 1e-12, 0.3, 1.0] {
        let inflated = ZeroInflated::family(&[[w]], &[[counts]]).unwrap();
        let hurdle = Hurdle::family(&[[w]], &[[counts]]).unwrap();
        for y in [0.0, 1.0, 4.0] {
            let zero = f64::from(u8::from(y == 0.0));
            let expected = [w * zero + (1.0 - w) * one(y), {
                if y == 0.0 { w } else { (1.0 - w) * one(y) / (1.0 - one(0.0)) }
            }];
            let found = [density(&inflated, 0, &[y]), density(&hurdle, 0, &[y])];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found.exp() - expected).abs() <= 1e-15, "{w}, {y}: {found} {expected}");
            }
        }
    }
    // A zero that is nearly certain, or nearly impossible.
    let rare = |rate: f64, w: f64| ZeroInflated::new(w, Poisson::new(rate).unwrap()).unwrap();
    let of = |family: ZeroInflated<Poisson>, y: f64| {
        family.log_density(&ZeroInflated::<Poisson>::point(y).unwrap())
    };
    assert!((of(rare(1e-20, 0.5), 0.0) / -5e-21 - 1.0).abs() < 1e-13);
    assert!((of(rare(1e4, 0.0), 0.0) / -1e4 - 1.0).abs() < 1e-13);
    assert!((of(rare(700.0, 1e-320), 0.0) / -700.0 - 1.0).abs() < 1e-13);
    assert!((of(rare(800.0, 1e-300), 0.0) / 1e-300_f64.ln() - 1.0).abs() < 1e-13);
    let few = Hurdle::new(0.5, Poisson::new(1e-20).unwrap()).unwrap();
    let one = few.log_density(&Hurdle::<Poisson>::point(1.0).unwrap());
    assert!((one - 0.5_f64.ln()).abs() < 1e-13);
    // An angle of exactly 0 has a probability, not a density.
    let angles = ZeroInflated::family(&[[0.25]], &[[VonMises::new(0.0, 1e9).unwrap()]]).unwrap();
    assert!((density(&angles, 0, &[-0.0]).exp() - 0.25).abs() < 1e-15);
}

/// Few counts, whose zeros may be of either origin: the best point of a fine grid is not better
/// than the result of one step, from any start.
#[test]
fn one_step_finds_the_maximum_among_small_counts() {
    let weights = vec(0.0..2.0, 5);
    TestRunner::new(cases_of(100))
        .run(&(weights, 0.02..0.98, 0.05..5.0), |(weights, w, rate)| {
            let seen: Seen = (0..5).map(f64::from).zip(weights).collect();
            let start = ZeroInflated::new(w, Poisson::new(rate).unwrap()).unwrap();
            let found = fit(start, &seen).unwrap();
            let most = likelihood(&found, &seen);
            let hurdle = fit(Hurdle::new(w, Poisson::new(rate).unwrap()).unwrap(), &seen).unwrap();
            let most_of_hurdle = likelihood(&hurdle, &seen);
            for step in 1..400 {
                let inner = Poisson::new(0.0125 * f64::from(step)).unwrap();
                for w in (0..40).map(|k| 0.025 * f64::from(k)) {
                    let other = likelihood(&ZeroInflated::new(w, inner).unwrap(), &seen);
                    prop_assert!(other <= most + 1e-12 * most.abs(), "{w}, {inner:?}, {found:?}");
                }
                let other = Hurdle::new(hurdle.probability(), inner).unwrap();
                let other = likelihood(&other, &seen);
                prop_assert!(other <= most_of_hurdle + 1e-12 * most.abs(), "{inner:?}, {hurdle:?}");
            }
            let again = fit(found, &seen).unwrap();
            prop_assert!((again.inner().rate() - found.inner().rate()).abs() < 1e-13);
            prop_assert!((again.probability() - found.probability()).abs() < 1e-13);
            Ok(())
        })
        .unwrap();
}

/// If the inner distribution takes several steps, none leads down, and they end at a point where
/// every direction leads down.
#[test]
fn steps_with_dispersed_counts_lead_to_the_maximum() {
    for seed in 0..6 {
        let truth = NegativeBinomial::new(4.0, 0.8).unwrap();
        let truth = ZeroInflated::family(&[[0.3]], &[[truth]]).unwrap();
        let mut rng = rng(seed);
        let seen: Seen = (0..400).map(|_| (truth.sample(0, &mut rng)[0], 1.0)).collect();
        let start = NegativeBinomial::new(20.0, 0.1).unwrap();
        let mut inflated = ZeroInflated::new(0.01, start).unwrap();
        let mut hurdle = Hurdle::new(0.01, start).unwrap();
        for _ in 0..30 {
            let (a, b) = (fit(inflated, &seen).unwrap(), fit(hurdle, &seen).unwrap());
            assert!(likelihood(&a, &seen) >= likelihood(&inflated, &seen) - 1e-9, "{a:?}");
            assert!(likelihood(&b, &seen) >= likelihood(&hurdle, &seen) - 1e-9, "{b:?}");
            (inflated, hurdle) = (a, b);
        }
        let (at, above) = (inflated.inner(), hurdle.inner());
        for (mean, dispersion) in [(1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)] {
            let moved = |of: &NegativeBinomial| {
                NegativeBinomial::new(of.mean() + mean, of.dispersion() + dispersion).unwrap()
            };
            let other = ZeroInflated::new(inflated.probability(), moved(at)).unwrap();
            assert!(likelihood(&other, &seen) < likelihood(&inflated, &seen));
            let other = Hurdle::new(hurdle.probability(), moved(above)).unwrap();
            assert!(likelihood(&other, &seen) < likelihood(&hurdle, &seen));
        }
        // Both are the same model of counts with more zeros.
        assert!((at.mean() - above.mean()).abs() < 1e-6, "{at:?} {above:?}");
    }
}

#[test]
fn draws_have_the_moments_of_the_distribution() {
    fn assert_moments<F: Univariate>(of: &F, zeros: f64, mean: f64) {
        const DRAWS: usize = 20_000;
        let mut rng = rng(3);
        let drawn: Vec<f64> = (0..DRAWS).map(|_| of.draw(&mut rng)).collect();
        let share = drawn.iter().filter(|y| **y == 0.0).count() as f64 / DRAWS as f64;
        assert!((share - zeros).abs() <= 5.0 * (zeros * (1.0 - zeros) / DRAWS as f64).sqrt());
        let found = drawn.iter().sum::<f64>() / DRAWS as f64;
        let square = drawn.iter().map(|y| (y - found).powi(2)).sum::<f64>() / DRAWS as f64;
        let error = (square / DRAWS as f64).sqrt();
        assert!((found - mean).abs() <= 5.0 * error + 1e-9, "{found}, not {mean}: {of:?}");
    }
    let gamma = Gamma::new(2.0, 3.0).unwrap();
    assert_moments(&ZeroInflated::new(0.3, gamma).unwrap(), 0.3, 0.7 * 6.0);
    assert_moments(&Hurdle::new(0.3, gamma).unwrap(), 0.3, 0.7 * 6.0);
    let counts = Poisson::new(0.5).unwrap();
    let zero = (-0.5_f64).exp();
    assert_moments(&ZeroInflated::new(0.2, counts).unwrap(), 0.2 + 0.8 * zero, 0.4);
    assert_moments(&Hurdle::new(0.2, counts).unwrap(), 0.2, 0.4 / (1.0 - zero));
    // Nearly all draws of the inner distribution are zeros, which a hurdle must not return.
    let rare = Poisson::new(0.01).unwrap();
    assert_moments(&Hurdle::new(0.0, rare).unwrap(), 0.0, 0.01 / -(-0.01_f64).exp_m1());
    assert_moments(&Hurdle::new(0.0, Poisson::new(1e-300).unwrap()).unwrap(), 0.0, 1.0);
    let seats = Binomial::new(4, 0.001).unwrap();
    let some = 1.0 - 0.999_f64.powi(4);
    assert_moments(&Hurdle::new(0.0, seats).unwrap(), 0.0, 0.004 / some);
}

/// Only ones, only zeros, and no observations.
#[test]
fn what_is_not_determined_stays_or_is_an_error() {
    let inner = Poisson::new(2.0).unwrap();
    let error = fit(Hurdle::new(0.5, inner).unwrap(), &vec![(1.0, 3.0), (0.0, 1.0)]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the distribution of values above 0 of state 0, component 0, cannot be estimated from 3 expected observations: they may stand beside any number of zeros; give a prior"
    );
    let alone: Seen = vec![(0.0, 5.0)];
    let found = fit(Hurdle::new(0.5, inner).unwrap(), &alone).unwrap();
    assert_eq!((found.probability(), found.inner().rate()), (1.0, 2.0));
    let found = fit(ZeroInflated::new(0.5, inner).unwrap(), &alone).unwrap();
    assert_eq!((found.probability(), found.inner().rate()), (1.0, 2.0));
    // Fewer zeros than Poisson counts have: no extra zeros are learned.
    let few: Seen = vec![(0.0, 0.1), (1.0, 3.0), (2.0, 3.0)];
    let found = fit(ZeroInflated::new(0.5, inner).unwrap(), &few).unwrap();
    assert_eq!(found.probability(), 0.0);
    assert!((found.inner().rate() - 9.0 / 6.1).abs() < 1e-15);
}
