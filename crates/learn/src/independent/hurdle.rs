//! Hurdle counts: a zero has a probability of its own, and other counts a distribution truncated at
//! 0.
//!
//! The log-likelihood separates: that of π, which is a Bernoulli one, and that of F given y > 0.
//! For the second, learning completes the data with the zeros that F would have shown (see
//! `zeros::fit`).

use rand::{Rng, RngExt};

use super::family::Independent;
use super::univariate::{Cumulative, Sums, Univariate};
use super::zeros;
use crate::check::check;
use crate::{EmissionError, Tails};

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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hurdle<F> {
    probability: f64,
    inner: F,
    /// Logarithms of π, and of (1 − π) / (1 − f(0)).
    zero: f64,
    other: f64,
    /// Probability 1 − f(0) of the distribution.
    above: f64,
}

impl<F> Hurdle<F> {
    /// Probability of 0, π.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.probability
    }

    /// The distribution F, whose truncation at 0 is that of counts other than 0.
    #[must_use]
    pub fn inner(&self) -> &F {
        &self.inner
    }
}

impl<F: Univariate> Hurdle<F> {
    /// Creates the distribution with this probability of 0, and this distribution above it.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the probability is from 0 to 1, and the distribution is
    /// not always 0.
    pub fn new(probability: f64, inner: F) -> Result<Self, EmissionError> {
        let valid = (0.0..=1.0).contains(&probability);
        let p = check("probability of 0", probability, valid, "a value from 0 to 1")?;
        let log = zeros::log_zero(&inner);
        check("probability of 0 of the distribution", log.exp(), log < 0.0, "a value below 1")?;
        let other = (-p).ln_1p() - zeros::log_others(log);
        Ok(Self { probability: p, inner, zero: p.ln(), other, above: -log.exp_m1() })
    }

    /// Creates a family from one row for each state, with the probability π of each component, and
    /// one with the distributions.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, a
    /// probability that is not from 0 to 1, or a distribution that is always 0.
    pub fn family(
        probabilities: &[impl AsRef<[f64]>],
        inner: &[impl AsRef<[F]>],
    ) -> Result<Independent<Self>, EmissionError> {
        zeros::family(probabilities, inner, Self::new)
    }
}

impl<F: Univariate> Univariate for Hurdle<F> {
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
        let mut sums = (of.probability, F::Statistics::default());
        let share = (1.0 - of.probability) / of.above;
        sums.1.add(share, &zeros::expectations(&self.inner, &of.inner));
        sums
    }

    fn expected_log_density(&self, sums: &Self::Statistics) -> f64 {
        zeros::expected_log_density(&self.inner, [self.zero, self.other], sums)
    }

    fn maximize(&self, sums: &Self::Statistics) -> Result<Self, EmissionError> {
        // Starts from the zeros that the present F expects beside the others. There may be any
        // number.
        let (zero, others) = sums;
        let unseen = others.weight() * (1.0 - self.above) / self.above;
        let (inner, _) = zeros::fit(&self.inner, others, unseen, f64::INFINITY)?;
        Self::new(zero / sums.weight(), inner)
    }

    fn free_parameters(&self) -> usize {
        zeros::free_parameters(self.probability, &self.inner)
    }

    /// Draws from F until the value is not 0, or by inversion from 1 upwards where nearly all
    /// values are 0.
    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        if rng.random::<f64>() < self.probability {
            return 0.0;
        }
        if self.above > 0.1 {
            loop {
                let drawn = self.inner.draw(rng);
                if drawn != 0.0 {
                    return drawn;
                }
            }
        }
        let (wanted, mut sum, mut y) = (self.above * rng.random::<f64>(), 0.0, 1.0);
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

impl<F: Cumulative> Cumulative for Hurdle<F> {
    fn tails(&self, y: f64) -> Tails {
        // (1 − π) / (1 − f(0)) times F without its zeros, and π at 0.
        let mut all = Tails::default();
        all.add((1.0 - self.probability) / self.above, zeros::without(&self.inner, y));
        *zeros::side(&mut all, y) += self.probability;
        all
    }

    fn principal(value: f64) -> f64 {
        F::principal(value)
    }
}
