//! Special functions against values that mpmath computed with 60 digits, at the doubles given.

use super::*;

/// Panics unless a value has a relative error of at most 1e-14.
fn right(what: &str, at: f64, found: f64, expected: f64) {
    let off = (found - expected).abs() / expected.abs().max(f64::MIN_POSITIVE);
    assert!(off <= 1e-14, "{what}({at:e}): {found:e}, not {expected:e}");
}

#[test]
fn excesses_of_logarithms() {
    for (u, expected) in [
        (-0.999, 5.908_755_278_982_136),
        (-0.5, 0.193_147_180_559_945_31),
        (-0.4, 0.110_825_623_765_990_7),
        (-1e-3, 5.003_335_835_335_002e-7),
        (-1e-9, 5.000_000_003_333_334e-19),
        (1e-12, 4.999_999_999_996_667e-25),
        (0.25, 0.026_856_448_685_790_246),
        (0.6, 0.129_996_370_754_264_43),
        (3.0, 1.613_705_638_880_109_4),
        (1e6, 999_986.184_488_442),
    ] {
        right("log_excess", u, log_excess(u), expected);
    }
    for (u, expected) in [(-1e-12, 0.500_000_000_000_333_4), (1e-9, 0.499_999_999_666_666_7)] {
        right("excess_ratio", u, excess_ratio(u), expected);
    }
    right("excess_ratio", 3.0, 9.0 * excess_ratio(3.0), 1.613_705_638_880_109_4);
    assert_eq!((log_excess(0.0), log_excess(-1.0)), (0.0, f64::INFINITY));
    assert_eq!(log_excess(f64::INFINITY), f64::INFINITY);
}

#[test]
fn gamma_functions() {
    for (a, error, gap, slope) in [
        (1e-9, 9.442_694_406_414_583, 999_999_979.853_949_8, -999_999_998.999_999_9),
        (0.01, 1.434_007_953_703_184_2, 95.955_715_271_880_58, -99.016_212_135_283_13),
        (0.5, 0.153_426_409_720_027_36, 1.270_362_845_461_478_2, -1.467_401_100_272_339_7),
        (1.0, 0.081_061_466_795_327_26, 0.577_215_664_901_532_9, -0.644_934_066_848_226_4),
        (2.5, 0.033_162_873_519_936_29, 0.213_134_091_228_911_9, -0.225_894_390_250_587_16),
        (15.9, 0.005_240_399_880_756_108, 0.031_776_039_050_411_986, -0.032_105_277_425_055_825),
        (16.0, 0.005_207_655_919_609_640_4, 0.031_575_393_912_320_87, -0.031_900_534_451_829_79),
        (100.0, 0.000_833_330_555_634_914_7, 0.005_008_333_250_003_967, -0.005_016_666_333_357_139),
        (1e8, 8.333_333_333_333_334e-10, 5.000_000_008_333_333_6e-9, -5.000_000_016_666_667e-9),
    ] {
        // It is a small correction of a logarithm, so its absolute error counts.
        assert!((stirling(a) - error).abs() < 1e-15 * error.max(1.0), "stirling({a:e})");
        let found = ln_minus_digamma(a);
        right("ln_minus_digamma", a, found.0, gap);
        // Only Newton's method uses the slope, which needs fewer digits.
        assert!((found.1 / slope - 1.0).abs() < 1e-11, "slope at {a:e}: {:e}", found.1);
    }
    for (n, expected) in [
        (2.0, std::f64::consts::LN_2),
        (10.0, 15.104_412_573_075_516),
        (170.0, 706.573_062_245_787_3),
        (1e6, 12_815_518.384_658_17),
    ] {
        let (all, rest) = ln_factorial(n);
        right("ln_factorial", n, all, expected);
        right("ln_factorial and its rest", n, rest + n * (n.ln() - 1.0), expected);
    }
    assert_eq!((ln_factorial(0.0).0, ln_factorial(1.0).0), (0.0, 0.0));
}

#[test]
fn ratios_of_gamma_functions_and_inverses() {
    // ln Γ(a + 1) − ln Γ(a) − ln a is 0, and for one half: ln(Γ(a + ½) / (Γ(a) √a)).
    for (a, half) in [
        (0.05, -0.990_982_208_163_609_3),
        (1.0, -0.120_782_237_635_245_22),
        (40.0, -0.003_124_918_635_043_224_4),
        (1e9, -1.25e-10),
    ] {
        assert!(ln_rising(a, 2).abs() < 1e-15, "{a}");
        assert!((ln_rising(a, 1) - half).abs() < 1e-15, "{a}: {:e}", ln_rising(a, 1));
        let back = inverse_ln_minus_digamma(ln_minus_digamma(a).0, 1.0);
        assert!((back / a - 1.0).abs() < 1e-12, "{a}: {back:e}");
    }
}

#[test]
fn bessel_functions() {
    for (order, x, log, ratio, complement) in [
        (0.0, 0.0, 0.0, 0.0, 1.0),
        (0.0, 0.5, -0.438_450_280_814_518_7, 0.242_499_612_580_801_94, 0.757_500_387_419_198),
        (0.0, 39.9, -2.758_953_537_316_137, 0.987_388_105_376_865_4, 0.012_611_894_623_134_612),
        (0.0, 40.1, -2.761_469_574_360_104_3, 0.987_451_417_958_298_9, 0.012_548_582_041_701_097),
        (0.0, 1e6, -7.826_693_687_186_747, 0.999_999_499_999_875, 5.000_001_250_001_25e-7),
        (0.5, 1e-8, -0.225_791_362_644_727_4, 3.333_333_333_333_333_4e-9, 0.999_999_996_666_666_6),
        (0.5, 10.0, -3.221_523_628_259_872, 0.900_000_004_122_307_3, 0.099_999_995_877_692_75),
        (1.0, 0.5, -1.162_058_266_465_389_1, 0.123_717_928_278_320_73, 0.876_282_071_721_679_3),
        (1.0, 1e3, -11.280_946_639_342_153, 0.998_500_375_375_493_1, 0.001_499_624_624_506_967),
        (4.5, 0.0, -7.076_976_280_138_47, 0.0, 1.0),
        (4.5, 39.9, -19.604_386_797_984_8, 0.881_110_002_350_655_4, 0.118_889_997_649_344_56),
        (4.5, 40.1, -19.628_108_662_140_33, 0.881_670_477_134_731_5, 0.118_329_522_865_268_54),
        (24.0, 10.0, -80.438_602_267_875_23, 0.192_830_801_651_955_54, 0.807_169_198_348_044_5),
        (24.0, 1e3, -170.446_948_098_766_94, 0.975_788_121_717_364_3, 0.024_211_878_282_635_737),
        (49.5, 40.1, -213.486_803_227_326_56, 0.349_325_113_013_018_2, 0.650_674_886_986_981_7),
        (49.5, 1e6, -691.695_691_432_030_7, 0.999_950_001_225_001_2, 4.999_877_499_877_575e-5),
    ] {
        let found = Bessel::new(order, x);
        right("Bessel::log", x, found.log, log);
        right("Bessel::ratio", x, found.ratio, ratio);
        right("Bessel::complement", x, found.complement, complement);
    }
}

#[test]
fn roots_of_steep_and_flat_functions() {
    for target in [1e-30, 0.3, 1.0, 1e30] {
        right("root", target, root(1.0, |x| (x - target, x)), target);
        // The derivative with respect to ln x vanishes far from the root.
        right(
            "flat root",
            target,
            root(1e-3, |x| ((x / target).powi(3) - 1.0, 3.0 * (x / target).powi(3))),
            target,
        );
    }
}
