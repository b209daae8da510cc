//! The largest of a sensor's values, which are checked on the way.

use super::lanes::{Eight, Kernel, LANES, Lanes, run};
pub(crate) use crate::range::LARGEST_LOG;

/// Which values are valid.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Valid {
    /// Finite, and at least 0.
    Likelihoods,
    /// At most 1e300 in size, or −∞.
    Logs,
}

impl Valid {
    pub(crate) fn is(self, x: f64) -> bool {
        match self {
            Self::Likelihoods => (0.0..=f64::MAX).contains(&x),
            Self::Logs => x.abs() <= LARGEST_LOG || x == f64::NEG_INFINITY,
        }
    }

    /// The word for one of them.
    pub(crate) fn kind(self) -> &'static str {
        match self {
            Self::Likelihoods => "likelihood",
            Self::Logs => "log-likelihood",
        }
    }

    /// The same as [`is`](Self::is), for an error.
    pub(crate) fn expected(self) -> &'static str {
        match self {
            Self::Likelihoods => "a finite value of at least 0",
            Self::Logs => "a value from -1e300 to 1e300, or negative infinity",
        }
    }

    /// The values from the first to the second, both included, and the third.
    fn range(self) -> [f64; 3] {
        match self {
            Self::Likelihoods => [0.0, f64::MAX, 0.0],
            Self::Logs => [-LARGEST_LOG, LARGEST_LOG, f64::NEG_INFINITY],
        }
    }
}

/// The largest of values, and whether all are valid.
pub(super) struct Largest<'a> {
    pub(super) x: &'a [f64],
    pub(super) valid: Valid,
}

impl Kernel for Largest<'_> {
    type Output = (f64, bool);

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> (f64, bool) {
        let [least, most, other] = self.valid.range();
        let bounds = [least.next_down(), most.next_up(), other].map(|x| lanes.splat(x));
        let (chunks, rest) = self.x.as_chunks::<LANES>();
        let mut largest = bounds[2];
        let mut valid = lanes.equal(largest, largest);
        for chunk in chunks {
            let x = lanes.load(chunk);
            largest = lanes.max(x, largest);
            valid = lanes.and(valid, within(lanes, x, bounds));
        }
        let mut last = [other; LANES];
        last[..rest.len()].copy_from_slice(rest);
        let last = lanes.load(&last);
        largest = lanes.max(last, largest);
        valid = lanes.and(valid, within(lanes, last, bounds));
        let of_all: Eight = lanes.to_array(largest);
        (of_all.into_iter().fold(other, |a, b| if b > a { b } else { a }), lanes.all(valid))
    }
}

/// Between the first two, which are not included, or the third; never NaN.
#[inline(always)]
fn within<L: Lanes>(lanes: L, x: L::V, [below, above, other]: [L::V; 3]) -> L::M {
    let between = lanes.and(lanes.less(below, x), lanes.less(x, above));
    lanes.or(between, lanes.equal(x, other))
}

/// The largest of valid values (0 or −∞ if there are none), or the index of the
/// first that is not.
pub(crate) fn largest(x: &[f64], valid: Valid) -> Result<f64, usize> {
    let (largest, all) = run(Largest { x, valid });
    if all {
        return Ok(largest);
    }
    // Only now is it worth while to know which.
    Err(x.iter().position(|&x| !valid.is(x)).unwrap_or(0))
}
