//! Tests of numbers against the limits. All are false for NaN.

use super::{
    EVIDENCE_SUMS, LARGEST_LOG, LARGEST_RATIO, LEAST_ENTRY, LEAST_NORMALIZER, LEAST_PREDICTED,
    LIFT, TINY, UNSCALED,
};

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
    // A weight may lose 2^-1075, which is no more than 2^-75 of the least of these sums.
    (1.0 / LIFT..=f64::MAX).contains(&total)
}

/// True for a finite logarithm that sums can take.
#[inline]
pub fn is_log(value: f64) -> bool {
    value.abs() <= LARGEST_LOG
}

#[cfg(test)]
mod tests {
    use super::super::power;
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
