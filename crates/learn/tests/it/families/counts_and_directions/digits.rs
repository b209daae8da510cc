//! Digits of densities and parameters, against values of fifty digits.

use wayfix_learn::{
    Beta, Gamma, Multinomial, NegativeBinomial, Poisson, VonMises, Weibull, WrappedCauchy,
};

use super::kit::{density, fit, try_density};

/// Values computed with fifty digits.
#[test]
fn densities_of_large_numbers_keep_their_digits() {
    let known = [
        (density(&Poisson::family(&[[3.0]]).unwrap(), 0, &[5.0]), LN_POISSON_SMALL),
        (density(&Poisson::family(&[[1e12]]).unwrap(), 0, &[1e12 + 2e6]), LN_POISSON_LARGE),
        (density(&Poisson::family(&[[1e-9]]).unwrap(), 0, &[1e6]), LN_POISSON_FAR),
        (density(&Gamma::family(&[[1e12]], &[[1e-6]]).unwrap(), 0, &[1e6 + 0.25]), LN_GAMMA_LARGE),
        (density(&Gamma::family(&[[0.01]], &[[2.0]]).unwrap(), 0, &[1e-200]), LN_GAMMA_SMALL),
        (
            density(
                &VonMises::family(&[[1.0]], &[[1e12]]).unwrap(),
                0,
                &[1.0 + 9.536_743_164_062_5e-7],
            ),
            LN_VON_MISES,
        ),
        (
            density(
                &Multinomial::new(&[[0.25, 0.75]]).unwrap(),
                0,
                &[250_100_000.0, 749_900_000.0],
            ),
            LN_MULTINOMIAL,
        ),
    ];
    for (y, mean, dispersion, expected) in LN_NEGATIVE_BINOMIAL {
        let counts = NegativeBinomial::family(&[[mean]], &[[dispersion]]).unwrap();
        let found = density(&counts, 0, &[y]);
        let off = (found - expected).abs();
        assert!(off <= 1e-13 * expected.abs(), "{y}, {mean}, {dispersion}: {found} {expected}");
    }
    let checked = |found: f64, expected: f64, of: &dyn std::fmt::Debug| {
        let off = (found - expected).abs();
        assert!(off <= 1e-13 * expected.abs().max(1.0), "{of:?}: {found} {expected}");
    };
    for (y, shape, scale, expected) in LN_WEIBULL {
        let family = Weibull::family(&[[shape]], &[[scale]]).unwrap();
        checked(density(&family, 0, &[y]), expected, &family);
    }
    for (y, a, b, expected) in LN_BETA {
        let family = Beta::family(&[[a]], &[[b]]).unwrap();
        checked(density(&family, 0, &[y]), expected, &family);
    }
    for (y, mean, concentration, expected) in LN_WRAPPED_CAUCHY {
        let family = WrappedCauchy::family(&[[mean]], &[[concentration]]).unwrap();
        checked(density(&family, 0, &[y]), expected, &family);
    }
    for (at, (found, expected)) in known.into_iter().enumerate() {
        assert!((found - expected).abs() <= 2e-11 * expected.abs(), "{at}: {found} {expected}");
    }
}

const TINY: f64 = 1.0 / 1_048_576.0; // 2^-20

/// Values, parameters and log densities.
const LN_WEIBULL: [(f64, f64, f64, f64); 5] = [
    (2.5, 1.7, 3.0, -1.429_095_216_555_636_8),
    (1e-200, 0.01, 2.0, 451.289_815_830_073),
    (1_000_000.25, 1e6, 1e6, -1.034_025_657_811_918),
    (3.0, 1e-90, 2.0, -209.331_270_658_132_2),
    (1e300, 0.5, 1e298, -699.166_089_985_779_6),
];
const LN_BETA: [(f64, f64, f64, f64); 7] = [
    (0.3, 2.5, 4.0, 0.710_135_681_851_066_2),
    (1e-200, 0.01, 2.0, 451.316_628_557_686_1),
    (0.25 + TINY, 2.5e11, 7.5e11, 11.308_242_605_617_245),
    (1.0 - TINY * TINY / 1024.0, 3.0, 0.02, 30.081_941_800_158_52),
    (0.5, 1e-90, 3.0, -207.925_805_550_024_06),
    (0.7, 1e-50, 1e-50, -114.261_754_081_997_56),
    (0.001, 1e6, 4.0, -6_907_694.903_939_596),
];
const LN_WRAPPED_CAUCHY: [(f64, f64, f64, f64); 5] = [
    (0.3, 2.5, 0.0, -1.837_877_066_409_345_6),
    (1.0, 2.5, 0.7, -2.841_221_468_125_008_5),
    (2.5 + TINY, 2.5, 1.0 - TINY / 1024.0, 5.786_740_966_541_927),
    (-0.6, 2.5, 1.0 - 0.5 * f64::EPSILON, -39.267_392_298_260_44),
    (1e15, 1.0, 0.5, -1.908_730_739_160_462),
];
/// Count, mean, dispersion and log probability.
const LN_NEGATIVE_BINOMIAL: [(f64, f64, f64, f64); 11] = [
    (5.0, 3.0, 0.5, -2.594_950_113_350_208_6),
    (16.0, 15.0, 1e-12, -2.343_056_888_452_811_6),
    (17.0, 15.0, 1e-12, -2.468_220_031_405_818),
    (1_002_000.0, 1e6, 1e-9, -9.824_863_643_586_57),
    (1_002_000.0, 1e6, 0.3, -14.159_395_825_078_878),
    (1_000_002e6, 1e12, 1e-15, -16.732_950_507_004_9),
    (3.0, 1e-9, 1e90, -208.331_270_658_132_2),
    (1e9, 1e-9, 2.0, -20_030_118_669.320_465),
    (40.0, 1e9, 0.001, -13_648.752_098_401_517),
    (20.0, 1e15, 4.0, -12.520_796_076_541_863),
    (100.0, 120.0, 1e-20, -4.990_201_277_358_891),
];
const LN_POISSON_SMALL: f64 = -2.294_430_299_441_497_6;
const LN_POISSON_LARGE: f64 = -16.734_448_757_836_03;
const LN_POISSON_FAR: f64 = -33_538_784.221_604_582;
const LN_GAMMA_LARGE: f64 = -0.950_188_778_007_705_4;
const LN_GAMMA_SMALL: f64 = 451.305_437_062_973_4;
const LN_VON_MISES: f64 = 12.441_824_673_873_047;
const LN_MULTINOMIAL: f64 = -37.108_013_373_408_525;

/// Angles after many turns: 2π is not a double, and its error is multiplied by the number of turns.
#[test]
fn directions_of_large_angles_keep_their_digits() {
    for start in [1e6, 1e9, -1e15, 1e300] {
        let seen: Vec<f64> = [0.0, 0.25, -0.125, 0.5].iter().map(|x| start + x).collect();
        let family = VonMises::family(&[[start]], &[[2.0]]).unwrap();
        let rows: Vec<_> = seen.iter().map(|y| (vec![*y], 1.0)).chain([(vec![1.0], 1.0)]).collect();
        let learned = fit(&family, &rows, 0.0).component(0, 0).unwrap().mean();
        let all = || rows.iter().map(|(y, _)| y[0]);
        let mean = f64::atan2(all().map(f64::sin).sum(), all().map(f64::cos).sum());
        assert!((learned - mean).sin().abs() < 1e-14, "{start}: {learned}, not {mean}");
    }
}

/// The rounding of a probability just below one, which 1e15 trials would multiply.
#[test]
fn rare_outcomes_in_many_trials_have_their_probability() {
    let trials = 1e15;
    for rare in (0..50).map(|k| 3.8e-15 + 7e-18 * f64::from(k)) {
        let family = Multinomial::new(&[[rare, 1.0 - rare]]).unwrap();
        for many in [0_u32, 1, 4, 12] {
            let ways: f64 =
                (0..many).map(|i| ((trials - f64::from(i)) / f64::from(i + 1)).ln()).sum();
            let count = f64::from(many);
            let expected = ways + count * rare.ln() + (trials - count) * (-rare).ln_1p();
            let found = try_density(&family, 0, &[count, trials - count]).unwrap();
            assert!((found - expected).abs() < 1e-9, "{rare}, {count}: {found}, not {expected}");
        }
    }
}
