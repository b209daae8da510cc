//! Zeros beside a distribution that may have zeros of its own: zero inflation, where it is hidden which zeros
//! are extra is hidden, and hurdles, where a zero has a probability of its own and other values are
//! distributed as F given that they are not 0.
//!
//! Both M steps ask how many zeros F expects next to the other observations, and solve for that
//! number ([`fit`]) rather than take one EM step after the other. A hurdle's log-likelihood
//! separates into that of π, which is a Bernoulli one, and that of F given y ≠ 0, for which the
//! data are completed with the zeros that F would have shown. Under zero inflation there are at
//! most as many as were seen.

use std::error::Error;

use rand::{Rng, RngExt};
use wayfix::inference::{Displacement, FreeParameters};

use super::Independent;
use super::univariate::{Cumulative, Sums, Univariate};
use crate::error::{check, check_shape, shape};
use crate::{EmissionError, Tails};

/// A distribution F with zeros beside its own: [`ZeroInflated`] and [`Hurdle`] in one, since they
/// differ only in the probability that is left to F.
///
/// Use the two names: formats store them apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtraZeros<F, const HURDLE: bool> {
    probability: f64,
    inner: F,
    /// Logarithm of the probability of 0.
    log_zero: f64,
    /// Logarithm of the factor of F's density at other values, (1 − w) / `nonzero`.
    log_nonzero_factor: f64,
    /// The part of F that is shown: 1 − f(0) behind a hurdle, otherwise 1.
    nonzero: f64,
}

/// A distribution with extra zeros: a value is 0 with probability w, and otherwise distributed as
/// F.
///
/// With F = [`Poisson`](super::Poisson), [`NegativeBinomial`](super::NegativeBinomial) or
/// [`Binomial`](super::Binomial) these are zero-inflated counts, where a zero may have either
/// origin: p(0) = w + (1 − w) f(0) and p(y) = (1 − w) f(y). Continuous distributions have no zeros
/// of positive probability. There w is a point mass at 0: the steps of an animal have length 0
/// while it rests, and otherwise [`Gamma`](super::Gamma), [`Weibull`](super::Weibull) or
/// [`LogNormal`](super::LogNormal) lengths.
///
/// Learning sets w and F to the maximum, if F finds its own from its statistics: the number of
/// zeros that F explains is the root of an equation, which each step solves to the last digits;
/// where F would explain them all, w is 0. The [prior](Independent::with_prior) of c observations
/// adds their expected zeros and the expected statistics of the others.
///
/// ```
/// use wayfix_learn::{Poisson, ZeroInflated};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let calls = [[Poisson::new(2.0)?], [Poisson::new(12.0)?]];
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     ZeroInflated::family(&[[0.2], [0.2]], &calls)?, // the line is down one hour in five
/// )?;
/// let seen = [[9.0], [0.0], [11.0], [12.0], [0.0], [10.0], [8.0]];
/// assert_eq!(hmm.viterbi(&seen)?.states(), [1; 7]);
/// let learned = hmm.learn(&[seen], &LearningOptions::default())?;
/// let busy = learned.model().likelihood().component(1, 0).unwrap();
/// assert!((busy.inner().rate() - 10.0).abs() < 0.01); // hours without a call hardly count
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type ZeroInflated<F> = ExtraZeros<F, false>;

/// Hurdle counts: 0 with a probability π of its own, otherwise distributed as F given that it is
/// not 0 (Mullahy, 1986).
///
/// With F = [`Poisson`](super::Poisson), [`NegativeBinomial`](super::NegativeBinomial) or
/// [`Binomial`](super::Binomial), whose probability of 0 is f(0), p(0) = π and
/// p(y) = (1 − π) f(y) / (1 − f(0)). Unlike [`ZeroInflated`](super::ZeroInflated) counts, these may
/// have fewer zeros than F alone. For an F without zeros of its own, both are the same.
///
/// Learning sets π to the weighted share of zeros, and F to the maximum for the other counts, if F
/// finds the maximum from its own statistics: each step solves for the number of unseen zeros, n
/// f(0) / (1 − f(0)) beside n other counts, to the last digits. If all counts above 0 are 1, any
/// small mean will do, which is an [error](EmissionError::TooFew) unless there is a prior. A prior
/// of c [observations](Independent::with_prior) adds their expected zeros and the expected
/// statistics of the others.
///
/// ```
/// use wayfix_learn::{Hurdle, Poisson};
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let bought = [[Poisson::new(1.5)?], [Poisson::new(6.0)?]];
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Hurdle::family(&[[0.7], [0.3]], &bought)?, // who looks around, and who has a list
/// )?;
/// assert_eq!(hmm.viterbi(&[[0.0], [1.0], [0.0], [7.0], [5.0]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Hurdle<F> = ExtraZeros<F, true>;

impl<F, const HURDLE: bool> ExtraZeros<F, HURDLE> {
    /// Probability of an extra zero, w, or of a zero at all behind a hurdle, π.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }

    /// The distribution F of all values but the extra zeros. Behind a hurdle, its truncation at 0
    /// is that of the values other than 0.
    #[must_use]
    pub fn inner(&self) -> &F {
        &self.inner
    }

    /// Factor of F's probabilities of values other than 0.
    fn nonzero_factor(&self) -> f64 {
        (1.0 - self.probability) / self.nonzero
    }
}

impl<F: Univariate, const HURDLE: bool> ExtraZeros<F, HURDLE> {
    /// Creates the distribution with this probability of an extra zero (of 0, behind a hurdle), and
    /// F.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the probability is from 0 to 1 and, behind a hurdle, F
    /// is not always 0.
    pub fn new(probability: f64, inner: F) -> Result<Self, EmissionError> {
        let valid = (0.0..=1.0).contains(&probability);
        let w = check("probability of 0", probability, valid, "a value from 0 to 1")?;
        let (log, ln_others) = (log_zero(&inner), (-w).ln_1p());
        if HURDLE {
            let (what, expected) = ("probability of 0 of the distribution", "a value below 1");
            check(what, log.exp(), log < 0.0, expected)?;
            let log_nonzero_factor = ln_others - log_others(log);
            let (log_zero, nonzero) = (w.ln(), -log.exp_m1());
            return Ok(Self { probability: w, inner, log_zero, log_nonzero_factor, nonzero });
        }
        // ln p(0) is ln(1 − `others`), with the probability of all other values, where that is
        // below ½. Otherwise it is the logarithm of w + (1 − w) f(0), relative to the larger term.
        let others = (1.0 - w) * -log.exp_m1();
        let log_zero = if others < 0.5 {
            (-others).ln_1p()
        } else {
            let (extra, own) = (w.ln(), ln_others + log);
            let most = extra.max(own);
            if most == f64::NEG_INFINITY {
                most
            } else {
                most + (extra.min(own) - most).exp().ln_1p()
            }
        };
        let (log_nonzero_factor, nonzero) = (ln_others, 1.0);
        Ok(Self { probability: w, inner, log_zero, log_nonzero_factor, nonzero })
    }

    /// Creates a family from one row for each state, with the probability of each component, and
    /// one with the distributions.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a probability
    /// outside 0 to 1, or a distribution behind a hurdle that is always 0.
    pub fn family(
        probabilities: &[impl AsRef<[f64]>],
        inner: &[impl AsRef<[F]>],
    ) -> Result<Independent<Self>, EmissionError> {
        let shape = shape("list of probabilities of 0", probabilities)?;
        check_shape("list of distributions", inner, shape)?;
        Independent::build(shape, |state, c| {
            Self::new(probabilities[state].as_ref()[c], inner[state].as_ref()[c].clone())
        })
    }

    /// A value other than 0 of a distribution of counts that is nearly always 0, by inversion from
    /// 1 upwards.
    fn draw_rare<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let (wanted, mut sum, mut y) = (self.nonzero * rng.random::<f64>(), 0.0, 1.0);
        loop {
            let probability = F::point(y).map_or(0.0, |y| self.inner.log_density(&y).exp());
            sum += probability;
            // Rounding may leave the sum a little short of what is wanted.
            if wanted <= sum || probability < 1e-20 * sum {
                return y;
            }
            y += 1.0;
        }
    }
}

impl<F: Univariate, const HURDLE: bool> Univariate for ExtraZeros<F, HURDLE> {
    const VALUES: &'static str =
        if F::HAS_ZERO { F::VALUES } else { "0, or a value of the distribution beside it" };
    const HAS_ZERO: bool = true;
    const EXACT: bool = F::EXACT;
    /// None for 0.
    type Point = Option<F::Point>;
    /// Weight of zeros, and the statistics of other observations.
    type Statistics = (f64, F::Statistics);

    fn point(value: f64) -> Option<Self::Point> {
        if value == 0.0 { Some(None) } else { F::point(value).map(Some) }
    }

    fn log_density(&self, y: &Self::Point) -> f64 {
        y.as_ref().map_or(self.log_zero, |y| self.log_nonzero_factor + self.inner.log_density(y))
    }

    fn statistics(&self, y: &Self::Point) -> Self::Statistics {
        match y {
            None => (1.0, F::Statistics::default()),
            Some(y) => (0.0, self.inner.statistics(y)),
        }
    }

    fn expectations(&self, of: &Self) -> Self::Statistics {
        let zeros = if HURDLE { of.probability } else { of.log_zero.exp() };
        let mut sums = (zeros, F::Statistics::default());
        sums.1.add(of.nonzero_factor(), &nonzero_expectations(&self.inner, &of.inner));
        sums
    }

    fn expected_log_density(&self, (zeros, others): &Self::Statistics) -> f64 {
        let of_zeros = if *zeros == 0.0 { 0.0 } else { zeros * self.log_zero };
        let weight = others.weight();
        if weight == 0.0 {
            return of_zeros;
        }
        // The log density of F takes the statistics of one observation, hence the division by the
        // weight.
        let mut mean = F::Statistics::default();
        mean.add(weight.recip(), others);
        let of_one = self.log_nonzero_factor + self.inner.expected_log_density(&mean);
        of_zeros + weight * of_one
    }

    fn maximize(&self, sums: &Self::Statistics) -> Result<Self, EmissionError> {
        let (zeros, others) = sums;
        if HURDLE {
            // Starts from the number of zeros that the present F expects next to the other
            // observations. There may be any number of them.
            let unseen = others.weight() * (1.0 - self.nonzero) / self.nonzero;
            let (inner, _) = fit(&self.inner, others, unseen, f64::INFINITY)?;
            return Self::new(zeros / sums.weight(), inner);
        }
        // The start is one EM step: a zero is F's own with probability (1 − w) f(0) / p(0).
        let share = (self.log_nonzero_factor + log_zero(&self.inner) - self.log_zero).exp();
        let start = if share <= 1.0 { zeros * share } else { *zeros };
        let (inner, own) = fit(&self.inner, others, start, *zeros)?;
        Self::new((zeros - own) / sums.weight(), inner)
    }

    fn free_parameters(&self) -> usize {
        let is_free = 0.0 < self.probability && self.probability < 1.0;
        usize::from(is_free) + self.inner.free_parameters()
    }

    /// Behind a hurdle, draws from F until the value is not 0, or by inversion where nearly all
    /// values are 0.
    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        if rng.random::<f64>() < self.probability {
            return 0.0;
        }
        if self.nonzero <= 0.1 {
            return self.draw_rare(rng);
        }
        loop {
            let drawn = self.inner.draw(rng);
            if !HURDLE || drawn != 0.0 {
                return drawn;
            }
        }
    }
}

impl<F: Cumulative, const HURDLE: bool> Cumulative for ExtraZeros<F, HURDLE> {
    fn tails(&self, y: f64) -> Tails {
        let inner = if HURDLE { tails_without_zero(&self.inner, y) } else { self.inner.tails(y) };
        let mut all = Tails::default();
        all.add(self.nonzero_factor(), inner);
        *tail_containing_zero(&mut all, y) += self.probability;
        all
    }

    fn principal(value: f64) -> f64 {
        F::principal(value)
    }
}

/// The log-odds of a zero, then the parameters of the distribution.
impl<F: Univariate + FreeParameters, const HURDLE: bool> FreeParameters for ExtraZeros<F, HURDLE> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self::new(by.probability(self.probability), self.inner.displaced(by)?)?)
    }
}

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

/// The observation 0, if the distribution gives it a probability.
fn zero_point<F: Univariate>() -> Option<F::Point> {
    if F::HAS_ZERO { F::point(0.0) } else { None }
}

/// Statistics of a zero, if the distribution gives it a probability.
fn zero<F: Univariate>(inner: &F) -> Option<F::Statistics> {
    zero_point::<F>().map(|zero| inner.statistics(&zero))
}

/// Logarithm of the probability of 0.
fn log_zero<F: Univariate>(inner: &F) -> f64 {
    zero_point::<F>().map_or(f64::NEG_INFINITY, |zero| inner.log_density(&zero))
}

/// ln(1 − f(0)), from ln f(0).
fn log_others(log_zero: f64) -> f64 {
    // `exp_m1` near f(0) = 1, `ln_1p` near 0: either keeps all digits on its side.
    if log_zero > -0.5 { (-log_zero.exp_m1()).ln() } else { (-log_zero.exp()).ln_1p() }
}

/// Expectations of the statistics of observations of `of` other than 0, times their probability.
fn nonzero_expectations<F: Univariate>(inner: &F, of: &F) -> F::Statistics {
    let mut all = inner.expectations(of);
    if let Some(zero) = zero(inner) {
        all.add(-log_zero(of).exp(), &zero);
    }
    all
}

/// The tail of y that contains 0.
fn tail_containing_zero(tails: &mut Tails, y: f64) -> &mut f64 {
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
fn tails_without_zero<F: Cumulative>(inner: &F, y: f64) -> Tails {
    let mut tails = inner.tails(y);
    let zero = log_zero(inner).exp();
    if zero == 0.0 {
        return tails;
    }
    if 0.0 < y && y <= FEW {
        // Summed one by one: a difference would have no digits where 0 has nearly all the
        // probability.
        let (mut sum, mut count) = (0.0, 1.0);
        while count < y {
            sum += F::point(count).map_or(0.0, |count| inner.log_density(&count).exp());
            count += 1.0;
        }
        tails.below = sum;
    } else {
        let tail = tail_containing_zero(&mut tails, y);
        *tail = (*tail - zero).max(0.0); // rounding may leave it below 0
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
fn fit<F: Univariate>(
    inner: &F,
    others: &F::Statistics,
    start: f64,
    most: f64,
) -> Result<(F, f64), EmissionError> {
    let weight = others.weight();
    if weight < f64::MIN_POSITIVE {
        return Ok((inner.clone(), 0.0));
    }
    // A distribution without zeros of its own explains none.
    let Some(zero) = zero(inner) else {
        return Ok((inner.maximize(others)?, 0.0));
    };
    let at = |zeros: f64| {
        let mut sums = others.clone();
        sums.add(zeros, &zero);
        let inner = inner.maximize(&sums)?;
        // With the weight n of the other observations and f = f(0), n f / (1 − f) = n / (1/f − 1).
        let expected = weight / (-log_zero(&inner)).exp_m1();
        Ok::<_, EmissionError>(Fit { zeros, inner, expected })
    };
    // Invariant of both loops: the fixed point is between `rising_end` and `falling_end`, and the
    // likelihood rises from `rising_end` towards it.
    let mut rising_end = at(start.min(most))?;
    let rises = rising_end.expected >= rising_end.zeros;
    let mut falling_end = if rises {
        loop {
            // Beside this many zeros, the other observations are lost in rounding.
            if most == f64::INFINITY && rising_end.expected * 64.0 * f64::EPSILON > weight {
                let (state, component, what) = (None, None, "distribution of values above 0");
                let reason = "they may stand beside any number of zeros; give a prior";
                return Err(EmissionError::TooFew { state, component, what, weight, reason });
            }
            if rising_end.zeros >= most || rising_end.expected == rising_end.zeros {
                return Ok((rising_end.inner, rising_end.zeros));
            }
            let next = at(most.min(2.0 * rising_end.expected))?;
            if next.expected < next.zeros {
                break next;
            }
            rising_end = next;
        }
    } else {
        at(0.0)?
    };
    // Regula falsi with the Illinois modification: the value at an end that stays is halved, so
    // that the bracket shrinks from both sides. Each step moves by at least the tolerance.
    let (mut a, mut b) =
        (rising_end.expected - rising_end.zeros, falling_end.expected - falling_end.zeros);
    for _ in 0..200 {
        let width = falling_end.zeros - rising_end.zeros;
        let least = 2.0 * f64::EPSILON * (weight + rising_end.zeros + falling_end.zeros);
        if a == 0.0 || width.abs() <= least {
            break;
        }
        let step = (width.abs() * (a / (a - b))).clamp(0.5 * least, width.abs() - 0.5 * least);
        let next = at(rising_end.zeros + step.copysign(width))?;
        let value = next.expected - next.zeros;
        if (value >= 0.0) == rises {
            (rising_end, a, b) = (next, value, 0.5 * b);
        } else {
            (falling_end, b, a) = (next, value, 0.5 * a);
        }
    }
    Ok((rising_end.inner, rising_end.zeros))
}

// Written by hand, since the fields depend on families of `F` and on the family itself.
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
                    use serde::ser::SerializeStruct;
                    let inner = self.rows(|part| part.inner().clone());
                    let inner = Independent::from_rows(&inner).map_err(serde::ser::Error::custom)?;
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
