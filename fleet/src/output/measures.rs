//! Mode and entropy of a belief, in one pass.
//!
//! Eight lanes of `f64` without branches on single values, which the compiler turns into vector
//! instructions of whatever width `pulp` dispatches to. Lanes are added in a fixed order, so
//! results are the same to the bit on every machine.

use std::f64::consts::LN_2;

use pulp::{Arch, Simd, WithSimd};

const EIGHT: usize = 8;
/// Total entropy, in nats, of states that may be left out.
const NEGLIGIBLE: f64 = 1e-14;

/// Computes measures of beliefs over a fixed number of states.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measures {
    arch: Arch,
    /// Probability below which −p ln p is negligible even if all states have it.
    least: f64,
}

/// Most probable state, its probability, and the entropy of the belief in nats.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) state: usize,
    pub(super) probability: f64,
    pub(super) entropy: f64,
}

impl Measures {
    pub(super) fn new(states: usize) -> Self {
        let share = NEGLIGIBLE / states.max(1) as f64;
        // −p ln p increases up to p = 1/e, and |ln least| < 64 as long as `least` > e^−64 =
        // 1.6e-28. So each of n states below `least` adds less than NEGLIGIBLE / n.
        Self { arch: Arch::new(), least: share / 64.0 }
    }

    /// Measures a belief. Ties go to the lowest state; the entropy agrees with that of the library
    /// to 2e-14.
    pub(super) fn of(self, belief: &[f64]) -> Measured {
        self.arch.dispatch(Measure { belief, least: self.least })
    }
}

/// A belief to be measured with the vector instructions of the machine.
struct Measure<'a> {
    belief: &'a [f64],
    least: f64,
}

impl WithSimd for Measure<'_> {
    type Output = Measured;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Measured {
        measure(self.belief, self.least)
    }
}

#[inline(always)]
fn measure(belief: &[f64], least: f64) -> Measured {
    let (eights, rest) = belief.as_chunks::<EIGHT>();
    let mut sums = [0.0; EIGHT];
    let (mut best, mut at) = (f64::NEG_INFINITY, 0);
    for (k, eight) in eights.iter().enumerate() {
        // Strictly greater: the first group of eight with the maximum wins, and `position` below
        // finds the first within it.
        let largest = largest(eight);
        if largest > best {
            (best, at) = (largest, k);
        }
        // Most groups of a peaked belief are negligible, and logarithms are what takes time here.
        if largest > least {
            add(&mut sums, eight);
        }
    }
    // Padding is 0, which adds nothing to the entropy and never wins against `best`, since a belief
    // has a positive value.
    let mut last = [0.0; EIGHT];
    last[..rest.len()].copy_from_slice(rest);
    let largest = largest(&last);
    if !rest.is_empty() && largest > best {
        (best, at) = (largest, eights.len());
    }
    if largest > least {
        add(&mut sums, &last);
    }
    let first = at * EIGHT;
    let end = belief.len().min(first + EIGHT);
    let inside = belief[first..end].iter().position(|&p| p == best).unwrap_or(0);
    let entropy = sums.iter().sum::<f64>();
    Measured { state: first + inside, probability: best, entropy }
}

#[inline(always)]
fn largest(eight: &[f64; EIGHT]) -> f64 {
    let mut four = [0.0; 4];
    // A tree of comparisons instead of a chain: `f64::max` would also have to treat NaN.
    for k in 0..4 {
        four[k] = if eight[k] > eight[k + 4] { eight[k] } else { eight[k + 4] };
    }
    let a = if four[0] > four[1] { four[0] } else { four[1] };
    let b = if four[2] > four[3] { four[2] } else { four[3] };
    if a > b { a } else { b }
}

/// Adds −p ln p. `ln(0)` is finite here, so 0 ln 0 is 0.
#[inline(always)]
fn add(sums: &mut [f64; EIGHT], eight: &[f64; EIGHT]) {
    for k in 0..EIGHT {
        sums[k] -= eight[k] * ln(eight[k]);
    }
}

/// Natural logarithm of a normal double, to a relative error of 1e-15; some finite value for 0 and
/// subnormals. The polynomial is that of FreeBSD's `e_log.c`.
#[inline(always)]
fn ln(x: f64) -> f64 {
    // Bits of √½: subtracting them first makes the mantissa range from √½ to √2, around 1, rather
    // than from 1 to 2.
    const ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const BIAS: u64 = 1024 << 52;
    // The double 2^52 + k has k in its last bits, so a subtraction converts k without an
    // integer-to-float instruction, which SSE2 and AVX2 lack for 64 bits.
    const TWO_52: u64 = 0x4330_0000_0000_0000;
    let shifted = x.to_bits().wrapping_sub(ROOT).wrapping_add(BIAS);
    let k = f64::from_bits((shifted >> 52) | TWO_52) - (4_503_599_627_370_496.0 + 1024.0);
    let m = f64::from_bits((shifted & 0x000f_ffff_ffff_ffff).wrapping_add(ROOT));
    // ln m = ln(1 + f) by the odd series in s = f / (2 + f), split into even and odd powers of z =
    // s² for two short chains.
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w
        * (0.399_999_999_994_094_2 + w * (0.222_221_984_321_497_84 + w * 0.153_138_376_992_093_73));
    let odd = z
        * (0.666_666_666_666_673_5
            + w * (0.285_714_287_436_623_9
                + w * (0.181_835_721_616_180_5 + w * 0.147_981_986_051_165_86)));
    let half = 0.5 * f * f;
    k * LN_2 + (f - (half - s * (half + (even + odd))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use wayfix::Belief;

    #[test]
    fn is_what_the_library_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for case in 0..2000 {
            let n = rng.random_range(1..40);
            let spread = rng.random_range(0.0..300.0_f64);
            let some: Vec<f64> = (0..n)
                .map(|_| {
                    let weight = (-spread * rng.random_range(0.0..1.0_f64)).exp();
                    // Ties and zeros.
                    match rng.random_range(0..5) {
                        0 => 0.0,
                        1 => 0.5,
                        _ => weight,
                    }
                })
                .collect();
            let Ok(belief) = Belief::from_weights(some) else { continue };
            let found = Measures::new(n).of(belief.as_slice());
            assert_eq!((found.state, found.probability), belief.peak(), "case {case}");
            assert!((found.entropy - belief.entropy()).abs() < 2e-14, "case {case}");
        }
        assert_eq!(Measures::new(9).of(Belief::certain(9, 8).unwrap().as_slice()).entropy, 0.0);
    }

    #[test]
    fn logarithms_are_those_of_the_platform() {
        for k in 0..20_000 {
            let x = 1.001_f64.powi(-k);
            assert!((ln(x) - x.ln()).abs() <= 1e-15 * x.ln().abs().max(1.0), "{x}");
        }
    }
}
