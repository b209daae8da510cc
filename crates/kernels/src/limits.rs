//! The range of doubles: when a step takes a belief as it is, lifted, or in logarithms.
//!
//! Positive doubles have all their digits if they are at least 2^-1022 ("normal"); below 2^-1075
//! they round to 0, and at 2^1024 they overflow to infinity. The limits of all recursions are here,
//! with the tests of numbers against them; `inference::step::state` keeps a belief in its form.
//!
//! # Forms
//!
//! α is the belief before a step, p = A α the prediction, s = Σ p, b the likelihoods, c the
//! largest of them, x = p ∘ b, N = Σ x, and α' = x / N. No entry of a stochastic A is above 1 (up
//! to 1e-9), so that s is one; with evidence on the move s is from 2^-100 to 2^7 ([`EVIDENCE_SUMS`]).
//!
//! | form | numbers | invariant |
//! |---|---|---|
//! | plain | α | a possible state is above 0, with all digits; an impossible one is 0 |
//! | lifted | α and 2^1000 α | the same |
//! | in logarithms | ln α, and α with 0 below 2^-1022 | a possible state has a finite logarithm |
//!
//! A step in any form keeps the invariant with a relative error of a few roundings, or notices that
//! it does not, and is taken again in the next form. A step needs logarithms if α has them;
//! otherwise it is plain or lifted. Its results stay in logarithms as long as a possible state is 0
//! as a double ([`needs_log`]).
//!
//! # Common to both linear forms
//!
//! 1. c is from 2^-300 to 2^16 ([`UNSCALED`]); otherwise, and for logarithms, b is divided by c,
//!    which leaves c = 1.
//! 2. N ≥ 2^-32 s c, or the step is taken in logarithms ([`linear_holds`]). So N is from 2^-332 to
//!    2^16, and from 2^-432 to 2^23 with evidence (each up to the 1e-6 by which s may be off).
//!
//! # A plain step
//!
//! Taken if each α is 0 or at least 2^-900 ([`TINY`]), and each entry of A is 0 or at least 2^-100
//! ([`LEAST_ENTRY`]).
//!
//! - Each term A α is at least 2^-1000: p has all its digits, and is 0 only where it should be.
//! - An x below 2^-1000 where neither p nor b is 0 is noticed, and the step is taken lifted. (For
//!   divided b, any x where p is not 0: b may have become 0.) Other x are normal.
//! - α' ≥ 2^-1000 / 2^16 is normal; with evidence it is at least 2^-1023, where a double lacks one
//!   bit: a further rounding.
//!
//! No bit differs from those of a lifted step, since a power of two commutes with rounding
//! where all is normal. After an x that was too small, [`LIFTED_STEPS`] steps are lifted at once.
//!
//! # A lifted step
//!
//! - 2^1000 α is exact. After a step, α is at least 2^-1023, and 2^1000 α at least 2^-23; a
//!   belief that was given may have 2^-1074, lifted 2^-74.
//! - Nothing overflows: Σ 2^1000 x ≤ 2^1000 · 2^7 · 2^16 = 2^1023. Its inverse is 2^-1023 at
//!   least, where it lacks one bit: a further rounding.
//! - Σ 2^1000 x ≥ 2^(1000 - 432) = 2^568. A lifted x below 2^-1022 of that sum becomes 0; what is
//!   kept is at least 2^-454, and its lifted p at least 2^-470: normal. Terms of the sum p that
//!   were not normal have lost 2^-1075 each, which is 2^-605 of p.
//! - A lifted x below 1 where neither p nor b is 0 is noticed (for divided b, where p is not
//!   0). Then all states are searched for one that has been [lost](is_lost), and if there is one,
//!   the step is taken in logarithms. That includes a lifted p below 2^-1022, which may
//!   lack digits: its x is below 2^-1006, and became 0. It includes a divided b below 2^-1022:
//!   its lifted x is below 2^(1000 + 7 - 1022) < 1.
//! - A p that has itself become 0 is not noticed: each term A α was below 2^-2075. That takes an
//!   entry below 2^-1052 (2^-1001 out of a belief that was given), or several factors within an
//!   operator. The guide names this exception.
//! - With evidence, entries below 2^-1022 that the operator has lost are 2^-922 of s at
//!   most, unless it asks for logarithms itself.
//!
//! **Rounded tails.** In a model with these, nothing is watched in a lifted step. A state below
//! 2^-1022 becomes 0, and one below 2^-990 may lack digits: a divided b below 2^-1022, over
//! N ≥ 2^-32 s.
//!
//! **In lanes** (`inference::engines::lanes`) all steps are lifted. Entries are at least 2^-100, α
//! is normal, and b is at least 2^-900, or the sequence is taken by itself. So a lifted x that is
//! possible is at least 2^(1000 - 1022 - 100 - 900) = 2^-1022: it does not become 0 before it is
//! compared with 2^-1022 of the sum, where a loss is noticed. (c is near 1, or 2^24 at most if b
//! is beyond 2^1000: then a sum may overflow, and is noticed as infinite.)
//!
//! # The way back
//!
//! With γ smoothed, r = γ / p and q = γ / α, a step is r = q ∘ b / N, q' = A' r, γ' = α ∘ q'. It
//! conserves Σ γ, so that what a step loses remains that part of the whole; the test that Σ γ is
//! [one](is_one) notices what matters. Small parts of γ need not keep their digits.
//!
//! - r and q are lifted by 2^700 ([`BACK_LIFT`]), which leaves room up to 2^324. Beyond, they are
//!   infinite, and Σ γ is infinite or NaN: not one.
//! - r and γ' become 0 below 2^-1022. For r that is p r ≤ 2^-1022 s of the whole. Products A r
//!   lose digits below 2^-1722 only.
//! - b / N ≥ α / s, which is at least 2^-1030. Below 2^-1022 it lacks up to 8 bits, in a state with
//!   α ≤ 2^-1015, so that γ = α q is at most 2^-691.
//! - Where r is made from lifted predictions, 2^1000 γ / p, it is [trusted](is_trusted) if p is at
//!   least 2^40, so that r ≤ 2^960, or if r ≤ 2^64: then p ≥ 2^936 γ is normal, since γ is 0
//!   or at least 2^-1074. A' averages, and terms α A r are probabilities: lifted, 2^1000 at most.
//!
//! # Scores and draws
//!
//! The first scores of the decoders are logarithms of a lifted product: of a prior that is not
//! [tiny](is_tiny), at least 2^100, with any entry that is a double, at least 2^-1074: 2^-974.
//! Weights for a [draw](can_draw) are lifted too; each may lose 2^-1075, 2^-75 of their sum.
//!
//! # Few states
//!
//! Vectors of few states are scaled by powers of two, which is exact, and only where their sum
//! leaves the middle range, 2^-40 to 2^40 ([`MIDDLE_RANGE`]). Values above 0 then are at least
//! 2^-300 ([`LEAST_IN_CHAIN`]), or the sequence is taken step by step.
//!
//! - A chain is checked after every step, and its entries and likelihoods are at least 2^-200
//!   ([`LEAST_FACTOR`]): no product is below 2^(-300 - 2 · 200) = 2^-700.
//! - Segments are checked after every four steps ([`STEPS_BETWEEN_CHECKS`]), and the least entry
//!   times the least likelihood is at least 2^-50 ([`LEAST_SEGMENT_PRODUCT`]): no product is below
//!   2^(-300 - 4 · 50), and with likelihoods up to 2^16 none is above 2^(40 + 4 · 16).
//! - Products of x and r, of the way forward and the way back, are normal in either.
//! - Columns of the product of a segment have exponents of their own. They are added only if these
//!   differ by 400 at most ([`LARGEST_EXPONENT_GAP`]): the least value of a column, times that of x
//!   and 2^-400, is 2^(-300 - 300 - 400), which is normal.
//!
//! Scores of segments are at least -50 after every four steps ([`LEAST_SCORE`]), and fall by 50 a
//! step at most: above -256 sums on the grid of 2^-45 are exact, in any order. Products of segments
//! and scores before them are added down to -200 ([`LEAST_EXACT_SCORE`]).
//!
//! Two routines have limits of their own: `inference::pruned` and `inference::beam`.

use std::ops::RangeInclusive;

/// 2^exponent, for exponents from -1022 to 1023.
#[inline(always)]
pub const fn power(exponent: i64) -> f64 {
    f64::from_bits((1023 + exponent).cast_unsigned() << 52)
}

/// Factor of a lifted belief. Products of a lifted belief with entries are normal down to 2^-2022,
/// 2e-609.
pub const LIFT: f64 = power(1000);

/// Factor of γ / p and γ / α on the way back.
pub const BACK_LIFT: f64 = power(700);

/// Least probability whose products with entries of at least [`LEAST_ENTRY`] have all their digits
/// without a lift.
pub const TINY: f64 = power(-900);

/// Least entry of a matrix for plain steps.
pub const LEAST_ENTRY: f64 = power(-100);

/// Number of steps with a lift after a result that was too small without one.
pub const LIFTED_STEPS: u32 = 64;

/// Range of the largest likelihood c for which a step needs no division.
pub const UNSCALED: RangeInclusive<f64> = power(-300)..=power(16);

/// Least ratio of the normaliser to the largest likelihood in linear space, for predictions that
/// sum to one.
pub const LEAST_NORMALIZER: f64 = power(-32);

/// Range of the sum of a prediction with evidence on the move that linear space holds.
pub const EVIDENCE_SUMS: RangeInclusive<f64> = power(-100)..=power(7);

/// Least lifted prediction for which every ratio γ / p is in the range of doubles.
pub const LEAST_PREDICTED: f64 = power(40);

/// Largest ratio γ / p of a lifted prediction below [`LEAST_PREDICTED`].
pub const LARGEST_RATIO: f64 = power(64);

/// Largest magnitude of a logarithm from outside. Sums and differences of such logarithms stay
/// finite over 10^8 steps.
pub const LARGEST_LOG: f64 = 1e300;

/// Range of the sum of a vector of few states that is not scaled.
pub const MIDDLE_RANGE: [f64; 2] = [power(-40), power(40)];

/// Least value above 0 of such a vector.
pub const LEAST_IN_CHAIN: f64 = power(-300);

/// Least entry and likelihood of a step of such a vector.
pub const LEAST_FACTOR: f64 = power(-200);

/// Number of steps between two checks of the range of segments.
pub const STEPS_BETWEEN_CHECKS: usize = 4;

/// Least product of an entry and a likelihood in segments.
pub const LEAST_SEGMENT_PRODUCT: f64 = power(-50);

/// Least score above −∞ of a vector in segments, whose best is about 0.
pub const LEAST_SCORE: f64 = -50.0;

/// Lowest score that sums of vectors and products of segments may have, to be exact.
pub const LEAST_EXACT_SCORE: f64 = -200.0;

/// Largest difference of exponents of columns that are added, so that no term is lost.
pub const LARGEST_EXPONENT_GAP: f64 = 400.0;

/// Range of the largest likelihood of a step for which scores of few states need no shift.
pub const UNSHIFTED: RangeInclusive<f64> = power(-16)..=power(16);

/// Exponent of the power of two below a normal number.
#[inline(always)]
pub const fn exponent(x: f64) -> i64 {
    (x.to_bits() >> 52).cast_signed() - 1023
}

// Tests of numbers against the limits. All are false for NaN.

/// True for a sum of one, up to rounding and the deviation that columns are allowed.
#[inline]
pub fn is_one(sum: f64) -> bool {
    // A thousand times what columns may deviate by (1e-9), and far above the rounding of any sum.
    (sum - 1.0).abs() <= 1e-6
}

/// Tolerance for the logarithm of a sum of one, if the logarithms of its terms are sums of numbers
/// up to `size`.
pub fn log_rounding(size: f64) -> f64 {
    1e-6 + 16.0 * f64::EPSILON * size
}

/// True if likelihoods with this largest value need no division.
#[inline]
pub fn is_unscaled(largest: f64) -> bool {
    UNSCALED.contains(&largest)
}

/// True if linear space holds a prediction with evidence on the move that has this sum.
#[inline]
pub fn is_evidence_sum(sum: f64) -> bool {
    EVIDENCE_SUMS.contains(&sum)
}

/// True if linear space holds an update of a prediction that should sum to `lift`:
/// `products` is the sum of its products with the likelihoods, `largest` the largest of these.
#[inline]
pub fn linear_holds(products: f64, predicted: f64, largest: f64, lift: f64) -> bool {
    // Each comparison is false for a NaN: one in any argument means no.
    let normalizer = products / lift;
    is_unscaled(largest)
        && is_one(predicted / lift)
        && normalizer >= LEAST_NORMALIZER * largest
        && normalizer.is_finite()
}

/// True for a probability above 0 that is so small that products take it lifted.
#[inline]
pub fn is_tiny(p: f64) -> bool {
    0.0 < p && p < TINY
}

/// True for an entry whose products with probabilities that are not [tiny](is_tiny) have all their
/// digits.
#[inline]
pub fn is_plain(entry: f64) -> bool {
    entry >= LEAST_ENTRY
}

/// True for a predicted state that its likelihood allows, and that has become 0 or has a likelihood
/// too small to keep all its digits after scaling.
#[inline]
pub fn is_lost(predicted: f64, after: f64, scaled: f64) -> bool {
    // A state that was impossible before is not lost: 0 stays 0.
    predicted > 0.0 && (after == 0.0 || scaled < f64::MIN_POSITIVE)
}

/// True for a value above 0 that becomes 0 when values of this sum are normalised.
#[inline]
pub fn rounds_to_zero(value: f64, sum: f64) -> bool {
    value > 0.0 && value < f64::MIN_POSITIVE * sum
}

/// True if a probability above 0 is 0 as a double.
#[inline]
pub fn needs_log(p: f64, log: f64) -> bool {
    p == 0.0 && log > f64::NEG_INFINITY
}

/// True if a ratio γ / p from a lifted prediction, and its products, are in the range of doubles.
#[inline]
pub fn is_trusted(ratio: f64, predicted: f64) -> bool {
    // Only evidence makes a prediction too large.
    predicted <= f64::MAX && (predicted >= LEAST_PREDICTED || ratio <= LARGEST_RATIO)
}

/// True if lifted weights of this sum have enough digits for a draw.
#[inline]
pub fn can_draw(total: f64) -> bool {
    // A weight may lose 2^-1075: at most 2^-75 of the smallest of these sums.
    (1.0 / LIFT..=f64::MAX).contains(&total)
}

/// True for a finite logarithm that sums can take.
#[inline]
pub fn is_log(value: f64) -> bool {
    value.abs() <= LARGEST_LOG
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOT_NUMBERS: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

    /// Asserts that a test is true on a closed range, and false just outside of it.
    fn assert_range(test: impl Fn(f64) -> bool, least: f64, most: f64) {
        assert!(test(least) && test(most), "{least} to {most}");
        assert!(!test(least.next_down()), "below {least}");
        assert!(!test(most.next_up()), "above {most}");
        assert!(!test(f64::NAN));
    }

    #[test]
    fn powers_are_exact() {
        assert_eq!([power(0), power(-1), power(10)], [1.0, 0.5, 1024.0]);
        assert_eq!(power(-1022), f64::MIN_POSITIVE);
        assert_eq!(power(1023), f64::MAX / (2.0 - f64::EPSILON));
    }

    #[test]
    fn ranges_include_their_ends_only() {
        assert_range(is_unscaled, power(-300), power(16));
        assert_range(is_evidence_sum, power(-100), power(7));
        assert!(is_plain(power(-100)) && !is_plain(power(-100).next_down()));
        assert!(!is_plain(f64::NAN) && !is_plain(f64::NEG_INFINITY));
        assert_range(is_tiny, f64::from_bits(1), power(-900).next_down());
        assert_range(is_log, -1e300, 1e300);
        assert_range(can_draw, power(-1000), f64::MAX);
        for x in NOT_NUMBERS {
            assert!(!is_unscaled(x) && !is_evidence_sum(x) && !is_one(x), "{x}");
            assert!(!is_tiny(x) && !is_log(x) && !can_draw(x), "{x}");
        }
        assert!(is_one(1.0) && is_one(1.0 + 0.99e-6) && is_one(1.0 - 0.99e-6));
        assert!(!is_one(1.0 + 1.01e-6) && !is_one(1.0 - 1.01e-6));
    }

    #[test]
    fn an_update_holds_in_any_scale() {
        for lift in [1.0, power(7), LIFT] {
            for largest in [power(-300), 1.0, power(16)] {
                let least = power(-32) * largest * lift;
                assert!(linear_holds(least, lift, largest, lift));
                assert!(!linear_holds(least.next_down(), lift, largest, lift));
                for x in NOT_NUMBERS {
                    assert!(!linear_holds(x, lift, largest, lift), "{x}");
                    assert!(!linear_holds(least, x, largest, lift), "{x}");
                    assert!(!linear_holds(least, lift, x, lift), "{x}");
                    assert!(!linear_holds(least, lift, largest, x), "{x}");
                }
            }
            assert!(linear_holds(lift, lift * (1.0 + 0.99e-6), 1.0, lift));
            assert!(!linear_holds(lift, lift * (1.0 + 1.01e-6), 1.0, lift));
            assert!(!linear_holds(lift, lift, power(16).next_up(), lift));
            assert!(!linear_holds(lift, lift, power(-300).next_down(), lift));
        }
        assert!(!linear_holds(0.0, 0.0, 1.0, 0.0));
    }

    #[test]
    fn losses_are_noticed_and_zeros_are_none() {
        let least = f64::MIN_POSITIVE;
        assert!(is_lost(1e-300, 0.0, 1.0) && is_lost(1e-300, 1.0, least.next_down()));
        assert!(!is_lost(1e-300, least, least) && !is_lost(0.0, 0.0, 0.0));
        assert!(!is_lost(f64::NAN, 0.0, 1.0) && !is_lost(1.0, f64::NAN, f64::NAN));
        for sum in [LIFT, power(568), 1.0] {
            assert!(rounds_to_zero((least * sum).next_down(), sum));
            assert!(!rounds_to_zero(least * sum, sum) && !rounds_to_zero(0.0, sum));
            assert!(!rounds_to_zero(f64::NAN, sum) && !rounds_to_zero(1e-300, f64::NAN));
        }
        assert!(needs_log(0.0, -1e300) && !needs_log(f64::from_bits(1), -744.0));
        assert!(!needs_log(0.0, f64::NEG_INFINITY) && !needs_log(0.0, f64::NAN));
        assert!(!needs_log(f64::NAN, 0.0));
    }

    #[test]
    fn ratios_are_trusted_by_their_size_or_that_of_the_prediction() {
        let (predicted, ratio) = (power(40), power(64));
        assert!(is_trusted(power(960), predicted) && is_trusted(power(960), f64::MAX));
        assert!(is_trusted(ratio, predicted.next_down()) && is_trusted(0.0, 0.0));
        assert!(!is_trusted(ratio.next_up(), predicted.next_down()));
        assert!(!is_trusted(f64::INFINITY, 0.0) && !is_trusted(f64::NAN, 0.0));
        assert!(!is_trusted(0.0, f64::INFINITY) && !is_trusted(0.0, f64::NAN));
    }

    /// Products at the limits that the module's docs state.
    #[test]
    fn limits_fit_together() {
        // A plain step: terms, and the result, where one bit may be missing.
        assert_eq!(TINY * LEAST_ENTRY, power(-1000));
        assert!((TINY * LEAST_ENTRY / UNSCALED.end()).is_normal());
        assert_eq!(
            TINY * LEAST_ENTRY / (UNSCALED.end() * EVIDENCE_SUMS.end()) * 2.0,
            f64::MIN_POSITIVE
        );
        // A lifted step: the largest and the least sum, and what is kept of it.
        assert_eq!(LIFT * EVIDENCE_SUMS.end() * UNSCALED.end(), power(1023));
        let least = LIFT * EVIDENCE_SUMS.start() * UNSCALED.start() * LEAST_NORMALIZER;
        assert_eq!((least, least * f64::MIN_POSITIVE), (power(568), power(-454)));
        assert!(LIFT * EVIDENCE_SUMS.end() * f64::MIN_POSITIVE < 1.0);
        // In lanes: the least product.
        assert_eq!(LIFT * f64::MIN_POSITIVE * LEAST_ENTRY * TINY, f64::MIN_POSITIVE);
        // The way back: the largest ratio, and the least trusted prediction.
        assert_eq!(LIFT / LEAST_PREDICTED, power(960));
        assert!((f64::from_bits(1) * LIFT / LARGEST_RATIO).is_normal());
        // First scores: the least product.
        assert!((TINY * LIFT * f64::from_bits(1)).is_normal());
    }
}
