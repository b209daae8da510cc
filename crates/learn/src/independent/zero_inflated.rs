//! Zero inflation: extra zeros beside any distribution, which may have zeros of its own.
//!
//! Which zeros are extra is hidden. Learning solves for their number within the M step
//! (`zeros::fit`) rather than by one EM step after the other.

use rand::{Rng, RngExt};

use super::family::Independent;
use super::univariate::{Cumulative, Sums, Univariate};
use super::zeros;
use crate::check::check;
use crate::{EmissionError, Tails};

/// A distribution with extra zeros: a value is 0 with probability w, and otherwise distributed as
/// F.
///
/// With F = [`Poisson`](super::Poisson), [`NegativeBinomial`](super::NegativeBinomial) or
/// [`Binomial`](super::Binomial) these are zero-inflated counts, in which a zero may be of either
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroInflated<F> {
    probability: f64,
    inner: F,
    /// Logarithms of the probability of 0, and of 1 − w.
    zero: f64,
    other: f64,
}

impl<F> ZeroInflated<F> {
    /// Probability w of an extra zero.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }

    /// The distribution F of all values but the extra zeros.
    #[must_use]
    pub fn inner(&self) -> &F {
        &self.inner
    }
}

impl<F: Univariate> ZeroInflated<F> {
    /// Creates the distribution with this probability of an extra zero, and F.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the probability is from 0 to 1.
    pub fn new(probability: f64, inner: F) -> Result<Self, EmissionError> {
        let valid = (0.0..=1.0).contains(&probability);
        let w = check("probability of 0", probability, valid, "a value from 0 to 1")?;
        let (log, other) = (zeros::log_zero(&inner), (-w).ln_1p());
        // ln p(0): as 1 less the probability of the others where that is below ½, otherwise the
        // logarithm of w + (1 − w) f(0), relative to the larger term.
        let others = (1.0 - w) * -log.exp_m1();
        let zero = if others < 0.5 {
            (-others).ln_1p()
        } else {
            let (extra, own) = (w.ln(), other + log);
            let most = extra.max(own);
            if most == f64::NEG_INFINITY {
                most
            } else {
                most + (extra.min(own) - most).exp().ln_1p()
            }
        };
        Ok(Self { probability: w, inner, zero, other })
    }

    /// Creates a family from one row for each state, with the probability w of each component, and
    /// one with the distributions.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// probability that is not from 0 to 1.
    pub fn family(
        probabilities: &[impl AsRef<[f64]>],
        inner: &[impl AsRef<[F]>],
    ) -> Result<Independent<Self>, EmissionError> {
        zeros::family(probabilities, inner, Self::new)
    }
}

impl<F: Univariate> Univariate for ZeroInflated<F> {
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
        y.as_ref().map_or(self.zero, |y| self.other + self.inner.log_density(y))
    }

    fn statistics(&self, y: &Self::Point) -> Self::Statistics {
        zeros::statistics(&self.inner, y.as_ref())
    }

    fn expectations(&self, of: &Self) -> Self::Statistics {
        let mut sums = (of.zero.exp(), F::Statistics::default());
        sums.1.add(1.0 - of.probability, &zeros::expectations(&self.inner, &of.inner));
        sums
    }

    fn expected_log_density(&self, sums: &Self::Statistics) -> f64 {
        zeros::expected_log_density(&self.inner, [self.zero, self.other], sums)
    }

    fn maximize(&self, sums: &Self::Statistics) -> Result<Self, EmissionError> {
        // The start is one EM step: a zero is F's own with probability (1 − w) f(0) / p(0).
        let (zero, others) = sums;
        let share = (self.other + zeros::log_zero(&self.inner) - self.zero).exp();
        let start = if share <= 1.0 { zero * share } else { *zero };
        let (inner, own) = zeros::fit(&self.inner, others, start, *zero)?;
        Self::new((zero - own) / sums.weight(), inner)
    }

    fn free_parameters(&self) -> usize {
        zeros::free_parameters(self.probability, &self.inner)
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        if rng.random::<f64>() < self.probability { 0.0 } else { self.inner.draw(rng) }
    }
}

impl<F: Cumulative> Cumulative for ZeroInflated<F> {
    fn tails(&self, y: f64) -> Tails {
        let mut all = Tails::default();
        all.add(1.0 - self.probability, self.inner.tails(y));
        *zeros::side(&mut all, y) += self.probability;
        all
    }

    fn principal(value: f64) -> f64 {
        F::principal(value)
    }
}
