//! Tails against values of 60 digits, computed by mpmath at the doubles given.

use wayfix_learn::{
    Bernoulli, Beta, Binomial, Cumulative, Exponential, Gamma, Gaussian, GaussianMixture, Hurdle,
    LogNormal, Marginals, NegativeBinomial, Poisson, StudentT, Tails, VonMises, Weibull,
    WrappedCauchy, ZeroInflated,
};

/// Panics unless all three have a relative error of at most 1e-12.
#[track_caller]
fn right(found: Tails, expected: [f64; 3]) {
    for (found, expected) in [found.below, found.at, found.above].into_iter().zip(expected) {
        let off = (found - expected).abs();
        assert!(off <= 1e-12 * expected, "{found:e}, expected {expected:e}");
    }
}

#[test]
fn normal_numbers() {
    let family = Gaussian::spherical(&[[3.0]], &[4.0]).unwrap();
    for (z, [below, above]) in [
        (-37.0, [5.725_571_222_524_577e-300, 1.0]),
        (-9.0, [1.128_588_405_953_840_5e-19, 1.0]),
        (-1.5, [0.066_807_201_268_858_07, 0.933_192_798_731_141_9]),
        (0.0, [0.5, 0.5]),
        (2.5, [0.993_790_334_674_223_8, 0.006_209_665_325_776_135]),
        (20.0, [1.0, 2.753_624_118_606_233_7e-89]),
    ] {
        let tails = family.tails(0, 0, 3.0 + 2.0 * z);
        right(tails, [below, 0.0, above]);
        assert!((tails.normal() - z).abs() <= 1e-13 * z.abs().max(1e-3), "{}", tails.normal());
    }
    for (p, z) in [
        (2.3e-308, -37.518_497_245_012_3),
        (1e-300, -37.047_096_299_361_2),
        (1e-20, -9.262_340_089_798_407),
        (0.001, -3.090_232_306_167_813_6),
        (0.1, -1.281_551_565_544_600_4),
        (0.49, -0.025_068_908_258_711_057),
        (0.499_999_9, -2.506_628_274_703_106_3e-7),
    ] {
        let found = Tails { below: p, at: 0.0, above: 1.0 - p }.normal();
        // The distribution function itself is right to some 1e-16.
        assert!((found - z).abs() <= 1e-14 * z.abs() + 5e-16, "{found}, expected {z}");
        assert_eq!(Tails { below: 1.0 - p, at: 0.0, above: p }.normal(), -found);
    }
    let all = Tails { below: 0.0, at: 1.0, above: 0.0 };
    assert_eq!(all.normal_segment(), [f64::NEG_INFINITY, f64::INFINITY]);
    assert_eq!((all.normal(), all.uniform()), (0.0, 0.5));
    let mixture = GaussianMixture::diagonal(&[[0.5, 0.5]], &[[[0.0], [1.0]]], &[[[1.0], [4.0]]]);
    let tails = mixture.unwrap().tails(0, 0, -3.0);
    let part = |z: f64| Gaussian::spherical(&[[0.0]], &[1.0]).unwrap().tails(0, 0, z).below;
    right(tails, [0.5 * (part(-3.0) + part(-2.0)), 0.0, 1.0 - tails.below]);
}

#[test]
fn incomplete_gamma_functions() {
    for ([shape, y], [below, above]) in [
        ([0.01, 1e-30], [0.504_047_272_859_995_4, 0.495_952_727_140_004_55]),
        ([0.01, 0.5], [0.994_373_243_806_032_9, 0.005_626_756_193_967_184_4]),
        ([1e-8, 3.0], [0.999_999_999_869_516_2, 1.304_838_134_165_440_3e-10]),
        ([0.5, 20.0], [0.999_999_999_746_037_1, 2.539_628_589_470_865e-10]),
        ([1.0, 1e-5], [9.999_950_000_166_666e-6, 0.999_990_000_049_999_8]),
        ([3.7, 0.01], [2.559_623_384_291_716_2e-9, 0.999_999_997_440_376_6]),
        ([3.7, 60.0], [1.0, 1.389_272_768_363_358_8e-22]),
        ([150.0, 90.0], [4.795_302_327_588_349e-9, 0.999_999_995_204_697_6]),
        ([150.0, 400.0], [1.0, 4.071_147_763_561_617_6e-47]),
        ([1e6, 1_002_000.0], [0.977_195_904_101_230_1, 0.022_804_095_898_769_864]),
        ([1e6, 980_000.0], [1.837_185_732_907_132_7e-90, 1.0]),
    ] {
        let tails = Gamma::new(shape, 1.0).unwrap().tails(y);
        right(tails, [below, 0.0, above]);
    }
    let gamma = Gamma::new(2.0, 3.0).unwrap();
    for y in [f64::NEG_INFINITY, -1.0, 0.0] {
        right(gamma.tails(y), [0.0, 0.0, 1.0]);
    }
    right(gamma.tails(f64::INFINITY), [1.0, 0.0, 0.0]);
    for ([rate, y], expected) in [
        ([0.3, 0.0], [0.0, 0.740_818_220_681_717_9, 0.259_181_779_318_282_1]),
        (
            [0.3, 12.0],
            [0.999_999_999_999_999_1, 8.219_203_777_551_32e-16, 1.938_212_151_031_804e-17],
        ),
        (
            [7.0, 3.0],
            [0.029_636_163_880_521_777, 0.052_129_252_364_199_845, 0.918_234_583_755_278_3],
        ),
        ([1e3, 700.0], [4.837_272_987_346_096_4e-24, 2.095_736_914_380_318_3e-24, 1.0]),
        ([1e3, 1300.0], [1.0, 1.606_560_638_609_706e-20, 5.280_526_026_820_459e-20]),
        ([0.0, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 3.0], [1.0, 0.0, 0.0]),
        ([5.0, -1e-9], [0.0, 0.0, 1.0]),
        ([5.0, f64::INFINITY], [1.0, 0.0, 0.0]),
    ] {
        right(Poisson::new(rate).unwrap().tails(y), expected);
    }
    // Between counts.
    let poisson = Poisson::new(7.0).unwrap();
    right(poisson.tails(2.5), [0.029_636_163_880_521_777, 0.0, 0.970_363_836_119_478_2]);
}

#[test]
fn incomplete_beta_functions() {
    for ([a, b, y], [below, above]) in [
        ([0.01, 0.5, 0.3], [0.976_233_186_545_598_7, 0.023_766_813_454_401_303]),
        ([0.01, 0.5, 1e-200], [0.009_863_926_119_737_094, 0.990_136_073_880_262_9]),
        ([2.0, 3.0, 1e-9], [5.999_999_992_000_001e-18, 1.0]),
        ([2.0, 3.0, 0.9999], [0.999_999_999_996_000_3, 3.999_699_999_998_679e-12]),
        ([300.0, 20.0, 0.5], [1.774_716_486_397_520_3e-66, 1.0]),
        ([300.0, 20.0, 0.99], [0.999_999_999_846_056_6, 1.539_433_644_699_137_7e-10]),
        ([1e-5, 1e3, 0.01], [0.999_999_999_960_436, 3.956_397_669_638_576e-11]),
        ([1e4, 3e4, 0.26], [0.999_997_684_667_537_5, 2.315_332_462_520_565_6e-6]),
    ] {
        right(Beta::new(a, b).unwrap().tails(y), [below, 0.0, above]);
        // The mirror image, where 1 − y is the same number.
        if y == 0.5 {
            right(Beta::new(b, a).unwrap().tails(y), [above, 0.0, below]);
        }
    }
    right(Beta::new(2.0, 3.0).unwrap().tails(-0.1), [0.0, 0.0, 1.0]);
    right(Beta::new(2.0, 3.0).unwrap().tails(1.0), [1.0, 0.0, 0.0]);
    for (trials, [p, y], expected) in [
        (10, [0.3, 0.0], [0.0, 0.028_247_524_900_000_005, 0.971_752_475_1]),
        (
            10,
            [0.3, 9.0],
            [0.999_856_314_1, 0.000_137_780_999_999_999_96, 5.904_899_999_999_997_5e-6],
        ),
        (
            1000,
            [0.01, 40.0],
            [0.999_999_999_999_531_2, 3.587_910_713_200_96e-13, 1.100_642_853_048_845_7e-13],
        ),
        (4000, [0.5, 1500.0], [2.641_844_710_769_376e-57, 1.769_975_536_185_419_3e-57, 1.0]),
        (10, [0.0, 0.0], [0.0, 1.0, 0.0]),
        (10, [1.0, 10.0], [1.0, 0.0, 0.0]),
        (10, [0.3, 11.0], [1.0, 0.0, 0.0]),
    ] {
        let expected = if p == 1.0 { [0.0, 1.0, 0.0] } else { expected };
        right(Binomial::new(trials, p).unwrap().tails(y), expected);
    }
    for ([mean, dispersion, y], expected) in [
        (
            [4.0, 0.5, 2.0],
            [0.259_259_259_259_259_24, 0.148_148_148_148_148_14, 0.592_592_592_592_592_5],
        ),
        (
            [4.0, 0.5, 90.0],
            [0.999_999_999_999_995_6, 1.434_120_249_066_321_9e-15, 2.962_797_877_191_961_6e-15],
        ),
        (
            [30.0, 1e-9, 12.0],
            [6.387_703_723_482_534e-5, 0.000_103_820_640_348_075_16, 0.999_832_302_322_417_2],
        ),
        (
            [0.2, 40.0, 3.0],
            [0.977_167_651_718_149_6, 0.005_749_419_811_592_079, 0.017_082_928_470_258_347],
        ),
        ([0.0, 2.0, 0.0], [0.0, 1.0, 0.0]),
    ] {
        right(NegativeBinomial::new(mean, dispersion).unwrap().tails(y), expected);
    }
    let (poisson, alike) = (Poisson::new(30.0).unwrap(), NegativeBinomial::new(30.0, 0.0).unwrap());
    assert_eq!(poisson.tails(12.0), alike.tails(12.0));
    for ([degrees, e], [beyond, within]) in [
        ([0.5, 1e200], [6.414_019_508_284_458e-101, 1.0]),
        ([1.0, 1e-9], [0.999_999_999_363_380_2, 6.366_197_723_675_814e-10]),
        ([3.0, 50.0], [1.761_715_204_127_197_5e-5, 0.999_982_382_847_958_7]),
        ([7.5, 1.2], [0.266_668_922_793_222_1, 0.733_331_077_206_777_9]),
        ([1e6, 8.0], [1.245_506_343_320_252e-15, 0.999_999_999_999_998_8]),
    ] {
        let family = StudentT::new(&[degrees], Gaussian::spherical(&[[0.0]], &[1.0]).unwrap());
        let family = family.unwrap();
        right(family.tails(0, 0, -e), [0.5 * beyond, 0.0, 0.5 + 0.5 * within]);
        right(family.tails(0, 0, e), [0.5 + 0.5 * within, 0.0, 0.5 * beyond]);
    }
}

#[test]
fn angles() {
    for ([mean, concentration, y], [below, above]) in [
        ([0.0, 2.0, -3.0], [0.001_346_862_288_929_320_2, 0.998_653_137_711_070_7]),
        ([2.5, 0.3, 1.0], [0.581_859_055_136_643_5, 0.418_140_944_863_356_5]),
        ([2.5, 30.0, -3.1], [0.000_162_639_557_593_151_57, 0.999_837_360_442_406_9]),
        ([-2.0, 8.0, 2.9], [0.998_837_910_621_933_5, 0.001_162_089_378_066_548_8]),
        ([1.0, 500.0, 0.5], [9.654_685_160_187_938e-29, 1.0]),
        ([3.0, 1e4, 3.02], [0.977_246_718_299_979, 0.022_753_281_700_020_99]),
    ] {
        let part = VonMises::new(mean, concentration).unwrap();
        let (found, turned) = (part.tails(y), VonMises::new(-mean, concentration).unwrap());
        // Rounding of angles, where the density is steep.
        for (found, expected) in [(found.below, below), (found.above, above)] {
            assert!(
                (found - expected).abs() <= 1e-12 * expected,
                "{found:e}, expected {expected:e}"
            );
        }
        assert_eq!(turned.tails(-y), Tails { below: found.above, at: 0.0, above: found.below });
    }
    for ([mean, concentration, y], [below, above]) in [
        ([2.5, 0.3, 1.0], [0.490_833_243_120_164_13, 0.509_166_756_879_835_8]),
        ([2.5, 0.99, -3.125], [0.000_130_189_499_313_838_69, 0.999_869_810_500_686_1]),
        ([-2.0, 0.0, 2.9], [0.961_549_334_966_496_4, 0.038_450_665_033_503_54]),
        ([1.0, 0.9, 3.125], [0.999_818_856_314_258_7, 0.000_181_143_685_741_304_98]),
    ] {
        let found = WrappedCauchy::new(mean, concentration).unwrap().tails(y);
        // A distance from π is known only to the last digit of π.
        let room = |expected: f64| 1e-12 * expected + 1e-16;
        assert!((found.below - below).abs() <= room(below), "{found:?}, expected {below:e}");
        assert!((found.above - above).abs() <= room(above), "{found:?}, expected {above:e}");
    }
    for far in [4.0, f64::INFINITY] {
        let [von_mises, cauchy] = [far, -far].map(|y| {
            let cauchy = WrappedCauchy::new(2.5, 0.3).unwrap().tails(y);
            (VonMises::new(2.5, 0.3).unwrap().tails(y), cauchy)
        });
        assert_eq!(von_mises.0, Tails { below: 1.0, at: 0.0, above: 0.0 });
        assert_eq!(cauchy.0, Tails { below: 0.0, at: 0.0, above: 1.0 });
        assert!(von_mises.1.above.abs() < 1e-15 && cauchy.1.below.abs() < 1e-15);
    }
}

#[test]
fn closed_forms() {
    let exponential = Exponential::new(0.5).unwrap();
    right(exponential.tails(1e-20), [5e-21, 0.0, 1.0]);
    right(exponential.tails(1000.0), [1.0, 0.0, (-500.0_f64).exp()]);
    right(exponential.tails(-1.0), [0.0, 0.0, 1.0]);
    let weibull = Weibull::new(2.0, 3.0).unwrap();
    right(weibull.tails(6.0), [-(-4.0_f64).exp_m1(), 0.0, (-4.0_f64).exp()]);
    right(weibull.tails(0.0), [0.0, 0.0, 1.0]);
    right(weibull.tails(f64::INFINITY), [1.0, 0.0, 0.0]);
    let log_normal = LogNormal::new(1.0, 0.5).unwrap();
    let normal = Gaussian::spherical(&[[1.0]], &[0.25]).unwrap();
    assert_eq!(log_normal.tails(4.0), normal.tails(0, 0, 4.0_f64.ln()));
    right(log_normal.tails(-4.0), [0.0, 0.0, 1.0]);
    let bernoulli = Bernoulli::new(0.25).unwrap();
    for (y, expected) in [
        (-1.0, [0.0, 0.0, 1.0]),
        (0.0, [0.0, 0.75, 0.25]),
        (0.5, [0.75, 0.0, 0.25]),
        (1.0, [0.75, 0.25, 0.0]),
        (2.0, [1.0, 0.0, 0.0]),
    ] {
        right(bernoulli.tails(y), expected);
    }
}

#[test]
fn zeros() {
    let inner = Poisson::new(1.2).unwrap();
    let p = |k: u32| inner.tails(f64::from(k)).at;
    let inflated = ZeroInflated::new(0.3, inner).unwrap();
    right(inflated.tails(-1.0), [0.0, 0.0, 1.0]);
    right(inflated.tails(0.0), [0.0, 0.3 + 0.7 * p(0), 0.7 * inner.tails(0.0).above]);
    right(
        inflated.tails(2.0),
        [0.3 + 0.7 * (p(0) + p(1)), 0.7 * p(2), 0.7 * inner.tails(2.0).above],
    );
    let (hurdle, share) = (Hurdle::new(0.3, inner).unwrap(), 0.7 / (1.0 - p(0)));
    right(hurdle.tails(-1.0), [0.0, 0.0, 1.0]);
    right(hurdle.tails(0.0), [0.0, 0.3, 0.7]);
    right(hurdle.tails(1.0), [0.3, share * p(1), share * inner.tails(1.0).above]);
    right(hurdle.tails(2.5), [0.3 + share * (p(1) + p(2)), 0.0, share * inner.tails(2.0).above]);
    right(hurdle.tails(70.0), [1.0, share * p(70), share * inner.tails(70.0).above]);
    // Beside a density, only 0 has a probability. A hurdle without zeros has nothing below 1.
    let gamma = Gamma::new(2.0, 3.0).unwrap();
    let rain = ZeroInflated::new(0.3, gamma).unwrap();
    right(rain.tails(0.0), [0.0, 0.3, 0.7]);
    let tails = gamma.tails(4.0);
    right(rain.tails(4.0), [0.3 + 0.7 * tails.below, 0.0, 0.7 * tails.above]);
    assert_eq!(Hurdle::new(0.0, inner).unwrap().tails(1.0).below, 0.0);
}
