//! Likelihoods of single states, with bounds on those outside the range of `f64`: b⁻ and b⁺ of
//! section 13 of the [formulas](crate::guide::formulas), "Rounding".

use crate::likelihood::Diagonal;

/// Power of two by which the likelihoods of states that the belief leads to may fall short of the
/// largest of all, so that the range of `f64` holds both.
const SPREAD: f64 = 500.0;
/// Range of factors that are not divided out.
const UNSCALED: std::ops::RangeInclusive<f64> = 1.0 / 65536.0..=65536.0;

/// Likelihood divided by a factor common to all states, with lower and upper bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weight {
    pub(crate) value: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

/// Common divisor of the likelihoods of a step: near the largest of them or, if those of the states
/// that the belief leads to are far below that, within 2^500 of the largest of these.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    is_log: bool,
    /// Common factor, or its logarithm.
    factor: f64,
    /// Upper bound on the weight of any state that the sensor was not asked about.
    pub(crate) others: f64,
    pub(crate) log_factor: f64,
}

impl Weights {
    /// Creates the weights from the likelihoods of some states, the bound on those of all others,
    /// the largest of all, and the largest among the states that the belief leads to (`likely`),
    /// all in one form.
    pub(crate) fn new(local: &Diagonal<'_>, others: f64, largest: f64, likely: f64) -> Self {
        let is_log = local.is_log();
        let (factor, log) = if is_log {
            let spread = SPREAD * std::f64::consts::LN_2;
            let factor = if likely.is_finite() { largest.min(likely + spread) } else { largest };
            let factor = if factor.is_finite() { factor } else { 0.0 };
            (factor, factor)
        } else {
            let most = if likely > 0.0 { likely * SPREAD.exp2() } else { f64::INFINITY };
            let factor = largest.min(most);
            // If the factor is near one, likelihoods are not divided, which would round them.
            let unscaled = UNSCALED.contains(&factor) || factor == 0.0;
            let factor = if unscaled { 1.0 } else { factor };
            (factor, factor.ln())
        };
        let log_factor = local.log_factor() + log;
        let weights = Self { is_log, factor, others: 0.0, log_factor };
        let others = weights.of(others).most * (1.0 + 4.0 * f64::EPSILON);
        Self { others, ..weights }
    }

    /// Returns the weight of a state whose likelihood, or its logarithm, is `b`.
    #[inline]
    pub(crate) fn of(&self, b: f64) -> Weight {
        let (value, off) = if self.is_log {
            let log = b - self.factor;
            // The difference rounds relative to |log|, which becomes a relative error of the
            // exponential; exp adds its own.
            (log.exp(), (log.abs() + 4.0) * f64::EPSILON)
        } else {
            (if self.factor == 1.0 { b } else { b / self.factor }, 0.0)
        };
        // Only a likelihood of 0 excludes a state. A quotient that underflows or overflows is
        // known only to lie below 2^-1021, or above the largest double.
        if b == if self.is_log { f64::NEG_INFINITY } else { 0.0 } {
            Weight { value: 0.0, least: 0.0, most: 0.0 }
        } else if value < f64::MIN_POSITIVE {
            Weight { value: 0.0, least: 0.0, most: 2.0 * f64::MIN_POSITIVE }
        } else if value > f64::MAX {
            Weight { value: 0.0, least: 0.0, most: f64::INFINITY }
        } else {
            Weight { value, least: value * (1.0 - off), most: value * (1.0 + off) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_double_does_not_hold_lies_between_bounds() {
        let tiny = Weight { value: 0.0, least: 0.0, most: 2.0 * f64::MIN_POSITIVE };
        let nothing = Weight { value: 0.0, least: 0.0, most: 0.0 };
        let new = |local: Diagonal<'_>, others, largest, likely| {
            Weights::new(&local, others, largest, likely)
        };
        let logs = new(Diagonal::log(&[]), -800.0, 0.0, 0.0);
        assert_eq!((logs.of(-800.0), logs.of(f64::NEG_INFINITY)), (tiny, nothing));
        assert!(logs.others >= f64::MIN_POSITIVE);
        let one = logs.of(0.0);
        assert!(one.value == 1.0 && one.least < 1.0 && one.most > 1.0 && one.most < 1.0 + 1e-15);
        let linear = new(Diagonal::linear(&[]), 1e-300, 1e300, 1e300);
        assert_eq!((linear.of(1e-300), linear.of(0.0)), (tiny, nothing));
        // The belief leads only to likelihoods far below the largest.
        let far = new(Diagonal::log(&[]), -3.0, 0.0, -1000.0);
        assert!(far.of(-1000.0).value > 1e-151 && far.others > 1e280);
        assert_eq!(new(Diagonal::log(&[]), 0.0, 0.0, -1e5).others, f64::INFINITY);
        let far = new(Diagonal::linear(&[]), 1e-3, 1e-3, 1e-300);
        assert!(far.of(1e-300).value > 1e-151);
    }
}
