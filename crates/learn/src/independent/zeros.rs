//! Zeros beside other observations: shared by [`ZeroInflated`](super::ZeroInflated) and
//! [`Hurdle`](super::Hurdle), whose M steps both ask how many zeros a distribution expects.

use super::family::Independent;
use super::univariate::{Cumulative, Sums, Univariate};
use crate::check::{check_shape, shape};
use crate::{EmissionError, Tails};

/// Weight of zeros, and the statistics of other observations.
impl<S: Sums> Sums for (f64, S) {
    fn weight(&self) -> f64 {
        self.0 + self.1.weight()
    }

    fn add(&mut self, factor: f64, other: &Self) {
        self.0 += factor * other.0;
        self.1.add(factor, &other.1);
    }
}

/// Statistics of an observation, where `None` stands for a zero.
pub(super) fn statistics<F: Univariate>(inner: &F, y: Option<&F::Point>) -> (f64, F::Statistics) {
    match y {
        None => (1.0, F::Statistics::default()),
        Some(y) => (0.0, inner.statistics(y)),
    }
}

/// The observation 0, if the distribution gives it a probability.
fn zero_point<F: Univariate>() -> Option<F::Point> {
    if F::HAS_ZERO { F::point(0.0) } else { None }
}

/// Statistics of a zero, if the distribution gives it a probability.
fn zero<F: Univariate>(inner: &F) -> Option<F::Statistics> {
    zero_point::<F>().map(|zero| inner.statistics(&zero))
}

/// Logarithm of the probability of 0.
pub(super) fn log_zero<F: Univariate>(inner: &F) -> f64 {
    zero_point::<F>().map_or(f64::NEG_INFINITY, |zero| inner.log_density(&zero))
}

/// ln(1 − f(0)), from ln f(0).
pub(super) fn log_others(log_zero: f64) -> f64 {
    // `exp_m1` near f(0) = 1, `ln_1p` near 0: either keeps all digits on its side.
    if log_zero > -0.5 { (-log_zero.exp_m1()).ln() } else { (-log_zero.exp()).ln_1p() }
}

/// Expectations of the statistics of observations of `of` other than 0, times their probability.
pub(super) fn expectations<F: Univariate>(inner: &F, of: &F) -> F::Statistics {
    let mut all = inner.expectations(of);
    if let Some(zero) = zero(inner) {
        all.add(-log_zero(of).exp(), &zero);
    }
    all
}

/// Expected log density, where a zero has the log probability `zero` and other values have their
/// log density plus `other`.
pub(super) fn expected_log_density<F: Univariate>(
    inner: &F,
    [zero, other]: [f64; 2],
    (zeros, others): &(f64, F::Statistics),
) -> f64 {
    let of_zeros = if *zeros == 0.0 { 0.0 } else { zeros * zero };
    let weight = others.weight();
    if weight == 0.0 {
        return of_zeros;
    }
    // `expected_log_density` is for the statistics of one observation: divide by the weight.
    let mut mean = F::Statistics::default();
    mean.add(weight.recip(), others);
    of_zeros + weight * (other + inner.expected_log_density(&mean))
}

/// Number of free parameters of a probability of 0 and a distribution beside it.
pub(super) fn free_parameters<F: Univariate>(probability: f64, inner: &F) -> usize {
    usize::from(0.0 < probability && probability < 1.0) + inner.free_parameters()
}

/// Creates a family from rows of probabilities and rows of distributions.
pub(super) fn family<F: Clone, G>(
    probabilities: &[impl AsRef<[f64]>],
    inner: &[impl AsRef<[F]>],
    new: impl Fn(f64, F) -> Result<G, EmissionError>,
) -> Result<Independent<G>, EmissionError> {
    let shape = shape("list of probabilities of 0", probabilities)?;
    check_shape("list of distributions", inner, shape)?;
    Independent::build(shape, |state, c| {
        new(probabilities[state].as_ref()[c], inner[state].as_ref()[c].clone())
    })
}

/// The tail of y that contains 0.
pub(super) fn side(tails: &mut Tails, y: f64) -> &mut f64 {
    match y {
        _ if y > 0.0 => &mut tails.below,
        _ if y < 0.0 => &mut tails.above,
        _ => &mut tails.at,
    }
}

/// Largest count up to which probabilities are added one by one.
const FEW: f64 = 64.0;

/// Tails of a value without the probability of 0. A distribution that gives 0 a probability must be
/// one of counts.
pub(super) fn without<F: Cumulative>(inner: &F, y: f64) -> Tails {
    let mut tails = inner.tails(y);
    let zero = log_zero(inner).exp();
    if zero == 0.0 {
        return tails;
    }
    if 0.0 < y && y <= FEW {
        // A difference would have no digits where 0 has nearly all the probability.
        let (mut sum, mut count) = (0.0, 1.0);
        while count < y {
            sum += F::point(count).map_or(0.0, |count| inner.log_density(&count).exp());
            count += 1.0;
        }
        tails.below = sum;
    } else {
        let side = side(&mut tails, y);
        *side = (*side - zero).max(0.0); // rounding may leave it below 0
    }
    tails
}

/// A number of zeros, the distribution that fits these and the other observations best, and the
/// number of zeros that it expects beside the others.
struct Fit<F> {
    zeros: f64,
    inner: F,
    expected: f64,
}

/// Returns the distribution that fits the other observations best given that they are not 0, with
/// the number of zeros that it expects beside them; if that is more than `most`, the best fit with
/// `most` zeros.
///
/// Fitted with z zeros beside n others, the distribution has a probability f(z) of 0, which rises
/// with z, and expects n f / (1 − f) zeros. An EM step goes from z to that number. The likelihood
/// rises on the way to the first fixed point, which is bracketed and solved for instead.
pub(super) fn fit<F: Univariate>(
    inner: &F,
    others: &F::Statistics,
    start: f64,
    most: f64,
) -> Result<(F, f64), EmissionError> {
    let weight = others.weight();
    if weight < f64::MIN_POSITIVE {
        return Ok((inner.clone(), 0.0));
    }
    // Without zeros of its own, the distribution explains none.
    let Some(zero) = zero(inner) else {
        return Ok((inner.maximize(others)?, 0.0));
    };
    let at = |zeros: f64| {
        let mut sums = others.clone();
        sums.add(zeros, &zero);
        let inner = inner.maximize(&sums)?;
        // n f / (1 − f) = n / (1/f − 1).
        let expected = weight / (-log_zero(&inner)).exp_m1();
        Ok::<_, EmissionError>(Fit { zeros, inner, expected })
    };
    // Invariant of both loops: the fixed point is between `near` and `far`, and the likelihood
    // rises from `near` towards it.
    let mut near = at(start.min(most))?;
    let rises = near.expected >= near.zeros;
    let mut far = if rises {
        loop {
            // Beside so many zeros, the other observations are lost in rounding.
            if most == f64::INFINITY && near.expected * 64.0 * f64::EPSILON > weight {
                let (state, component, what) = (None, None, "distribution of values above 0");
                let reason = "they may stand beside any number of zeros; give a prior";
                return Err(EmissionError::TooFew { state, component, what, weight, reason });
            }
            if near.zeros >= most || near.expected == near.zeros {
                return Ok((near.inner, near.zeros));
            }
            let next = at(most.min(2.0 * near.expected))?;
            if next.expected < next.zeros {
                break next;
            }
            near = next;
        }
    } else {
        at(0.0)?
    };
    // Regula falsi with the Illinois modification: the value at an end that stays is halved, so
    // that the bracket shrinks from both sides. Each step moves by at least the tolerance.
    let (mut a, mut b) = (near.expected - near.zeros, far.expected - far.zeros);
    for _ in 0..200 {
        let width = far.zeros - near.zeros;
        let least = 2.0 * f64::EPSILON * (weight + near.zeros + far.zeros);
        if a == 0.0 || width.abs() <= least {
            break;
        }
        let step = (width.abs() * (a / (a - b))).clamp(0.5 * least, width.abs() - 0.5 * least);
        let next = at(near.zeros + step.copysign(width))?;
        let value = next.expected - next.zeros;
        if (value >= 0.0) == rises {
            (near, a, b) = (next, value, 0.5 * b);
        } else {
            (far, b, a) = (next, value, 0.5 * a);
        }
    }
    Ok((near.inner, near.zeros))
}

// By hand, since the fields depend on families of `F` and on the family itself.
#[cfg(feature = "serde")]
macro_rules! beside_zeros {
    ($($name:ident)*) => {$(
        const _: () = {
            // Has the name of the type, since formats and messages show it.
            #[derive(serde::Deserialize)]
            #[serde(deny_unknown_fields)]
            struct $name<I, P> {
                version: wayfix::internal::Version,
                probabilities: Vec<Vec<f64>>,
                inner: I,
                missing: bool,
                prior: Option<(P, f64)>,
            }

            impl<F: Univariate> serde::Serialize for Independent<crate::$name<F>>
            where
                Independent<F>: serde::Serialize,
            {
                fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    let inner = self.rows(|part| part.inner().clone());
                    let inner = Independent::from_rows(&inner).map_err(serde::ser::Error::custom)?;
                    use serde::ser::SerializeStruct;
                    let mut out = serializer.serialize_struct(stringify!($name), 5)?;
                    out.serialize_field("version", &wayfix::internal::Version)?;
                    let probabilities = self.parameters(crate::$name::probability);
                    out.serialize_field("probabilities", &probabilities)?;
                    out.serialize_field("inner", &inner)?;
                    out.serialize_field("missing", &self.takes_missing())?;
                    out.serialize_field("prior", &self.prior())?;
                    out.end()
                }
            }

            impl<'de, F: Univariate> serde::Deserialize<'de> for Independent<crate::$name<F>>
            where
                Independent<F>: serde::Deserialize<'de>,
            {
                fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                    let $name::<Independent<F>, Self> { version: wayfix::internal::Version, probabilities, inner, missing, prior } =
                        serde::Deserialize::deserialize(from)?;
                    if inner.takes_missing() || inner.prior().is_some() {
                        return Err(serde::de::Error::custom("the inner family has settings of its own"));
                    }
                    crate::$name::family(&probabilities, &inner.rows(F::clone))
                        .and_then(|new| crate::independent::with_settings(new, missing, prior))
                        .map_err(wayfix::internal::refused)
                }
            }
        };
    )*};
}

#[cfg(feature = "serde")]
beside_zeros! { ZeroInflated Hurdle }
