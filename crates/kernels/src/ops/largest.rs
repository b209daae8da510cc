//! Largest value of a sensor, with a check of all of them: the divisor c of formula 2 of the guide
//! ("Scale").
//!
//! No value from outside reaches a recursion unchecked. One pass finds the largest value and tests
//! that all are valid; only after a failure, a second pass finds the first invalid one.

use crate::limits::LARGEST_LOG;
use crate::simd::{LANES, Simd, kernels};

/// Condition that values have to meet.
#[derive(Debug, Clone, Copy)]
pub enum Valid {
    /// Finite, and at least 0.
    Likelihoods,
    /// At most 1e300 in size, or −∞.
    Logs,
}

impl Valid {
    pub fn is(self, x: f64) -> bool {
        match self {
            Self::Likelihoods => (0.0..=f64::MAX).contains(&x),
            Self::Logs => x.abs() <= LARGEST_LOG || x == f64::NEG_INFINITY,
        }
    }

    /// Name of a value, in errors.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Likelihoods => "likelihood",
            Self::Logs => "log-likelihood",
        }
    }

    /// Condition, in errors.
    pub fn expected(self) -> &'static str {
        match self {
            Self::Likelihoods => "a finite value of at least 0",
            Self::Logs => "a value from -1e300 to 1e300, or negative infinity",
        }
    }

    /// Range of valid values, in the form of [`within`].
    #[inline(always)]
    pub(super) fn bounds<S: Simd>(self, s: S) -> [S::V; 3] {
        // `lt` is the only comparison that all instruction sets share: closed bounds become open
        // ones, a double further out. Beyond the largest double that is infinity.
        let [least, most, other] = self.range();
        [s.splat(least.next_down()), s.splat(most.next_up()), s.splat(other)]
    }

    /// Least and largest valid values, and one further valid value.
    fn range(self) -> [f64; 3] {
        match self {
            Self::Likelihoods => [0.0, f64::MAX, 0.0],
            Self::Logs => [-LARGEST_LOG, LARGEST_LOG, f64::NEG_INFINITY],
        }
    }
}

kernels! {
    /// Largest value, and true if all are valid.
    fn checked_largest = checked<'a>(x: &'a [f64], valid: Valid) -> (f64, bool);
}

#[inline(always)]
fn checked<S: Simd>(s: S, x: &[f64], valid: Valid) -> (f64, bool) {
    let (bounds, [.., other]) = (valid.bounds(s), valid.range());
    let (blocks, rest) = x.as_chunks::<LANES>();
    // Padding that is valid, and never the largest: 0 or −∞.
    let mut last = [other; LANES];
    last[..rest.len()].copy_from_slice(rest);
    let mut largest = bounds[2];
    // Every lane starts as true: `largest` holds `other`, which is not NaN and so equals itself.
    let mut valid = s.eq(largest, largest);
    for block in blocks.iter().chain([&last]) {
        let x = s.load(block);
        // A NaN leaves the largest as it is, and is not within the bounds.
        largest = s.max(x, largest);
        valid = s.and(valid, within(s, x, bounds));
    }
    let largest = s.to_array(largest);
    (largest.into_iter().fold(other, |a, b| if b > a { b } else { a }), s.all(valid))
}

/// Between the first two bounds, exclusive, or equal to the third; never NaN.
#[inline(always)]
pub(super) fn within<S: Simd>(s: S, x: S::V, [below, above, other]: [S::V; 3]) -> S::M {
    s.or(s.and(s.lt(below, x), s.lt(x, above)), s.eq(x, other))
}

/// Returns the largest value (0 or −∞ if there are none), or the index of the first invalid one.
pub fn largest(x: &[f64], valid: Valid) -> Result<f64, usize> {
    let (largest, all) = checked_largest(x, valid);
    if all {
        return Ok(largest);
    }
    // An error costs a second pass; valid values, nearly all, cost one.
    Err(x.iter().position(|&x| !valid.is(x)).unwrap_or(0))
}
