//! Distributions of observations to come: p(y) = Σ_i p(X = i) b_i(y), the mixture under a belief
//! (section 8 of the formulas).

use std::borrow::Borrow;
use std::ops::Deref;

use rand::Rng;

use super::{EmissionError, Marginals, Tails};
use crate::family::check_component;
use wayfix::Belief;
use wayfix::Filter;
use wayfix::Hmm;
use wayfix::Transition;
use wayfix::internal::NoControl;
use wayfix::internal::index;
use wayfix::likelihood::SampleObservation;
use wayfix::{HmmError, LikelihoodError};
use wayfix_kernels::log_sum;

/// Distribution of one number of an observation under a belief: the mixture of its distributions in
/// the states.
///
/// Made by [`ahead`](Self::ahead) for observations to come, and by [`new`](Self::new) for any
/// belief.
///
/// ```
/// use wayfix_learn::{Gamma, Predictive};
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // Minutes between trams, by day and at night.
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
///     Gamma::family(&[[9.0], [9.0]], &[[1.0], [3.0]])?, // shapes, then scales
/// )?;
/// let mut filter = hmm.filter();
/// filter.step(&[8.0])?;
/// let next = Predictive::ahead(&filter, 1, 0)?;
/// let [usual, long] = [next.quantile(0.5)?, next.quantile(0.95)?];
/// assert!(usual < 10.0 && long > 15.0);
/// assert!((next.tails(long).below - 0.95).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Predictive<'a, B> {
    likelihood: &'a B,
    belief: Belief,
    component: usize,
}

impl<'a, B: Marginals> Predictive<'a, B> {
    /// Returns the distribution of a component of the observation `steps` ahead, given all so far:
    /// 1 for the next one, 0 for another one at the present step. The component is 0 where
    /// observations are single numbers. Costs `steps` products with A.
    ///
    /// # Errors
    ///
    /// [`HmmError`] as for [`Filter::forecast`], and with the step if the component does not
    /// exist.
    pub fn ahead<M, A>(
        filter: &'a Filter<M>,
        steps: usize,
        component: usize,
    ) -> Result<Self, HmmError>
    where
        M: Deref<Target = Hmm<A, B>>,
        A: Transition + 'a,
        A::Control: NoControl,
    {
        Self::at(filter, filter.forecast(steps)?, steps, component)
    }

    /// Returns the distribution of a component of the observation `controls.len()` steps ahead,
    /// with one control for each step, like [`ahead`](Self::ahead).
    ///
    /// # Errors
    ///
    /// [`HmmError`] as for [`Filter::forecast_with`], and with the step if the component does
    /// not exist.
    pub fn ahead_with<M, A>(
        filter: &'a Filter<M>,
        controls: &[A::Control],
        component: usize,
    ) -> Result<Self, HmmError>
    where
        M: Deref<Target = Hmm<A, B>>,
        A: Transition + 'a,
    {
        Self::at(filter, filter.forecast_with(controls)?, controls.len(), component)
    }

    fn at<M, A>(
        filter: &'a Filter<M>,
        belief: Belief,
        ahead: usize,
        component: usize,
    ) -> Result<Self, HmmError>
    where
        M: Deref<Target = Hmm<A, B>>,
        A: Transition + 'a,
    {
        let step = filter.steps().saturating_add(ahead);
        Self::new(filter.model().likelihood(), belief, component)
            .map_err(|error| HmmError::likelihood(step, error))
    }

    /// Creates the distribution of a component of an observation under a belief. The component is 0
    /// where an observation is a single number.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the belief has the wrong number of states, or the component does not
    /// exist.
    pub fn new(
        likelihood: &'a B,
        belief: Belief,
        component: usize,
    ) -> Result<Self, LikelihoodError> {
        let (found, expected) = (belief.states(), likelihood.states());
        if found != expected {
            return Err(LikelihoodError::WrongLength { found, expected });
        }
        check_component(likelihood, component)?;
        Ok(Self { likelihood, belief, component })
    }

    /// Distribution of the state at the time of the observation.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    /// States that are possible, with their probabilities.
    fn states(&self) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.belief.as_slice().iter().copied().enumerate().filter(|(_, p)| *p > 0.0)
    }

    /// Logarithm of the density of a number (of its probability, for counts and symbols): −∞ where
    /// it is 0, and for what cannot be observed, such as NaN. O(n).
    ///
    /// Where observations have a single component, the next observation has the log density that
    /// the filter adds for its step: ln p(y_1 … y_{k+1}) − ln p(y_1 … y_k).
    #[must_use]
    pub fn log_density(&self, y: f64) -> f64 {
        let log = |(state, p): (usize, f64)| {
            p.ln() + self.likelihood.log_density(state, self.component, y)
        };
        log_sum(self.states().map(log))
    }

    /// Probabilities below, at and above a number. NaN counts as above all numbers; angles count
    /// from −π to π. Costs the tails in each possible state.
    #[must_use]
    pub fn tails(&self, y: f64) -> Tails {
        let y = if y.is_nan() { f64::INFINITY } else { y };
        let mut mixed = Tails::default();
        for (state, p) in self.states() {
            mixed.add(p, self.likelihood.tails(state, self.component, y));
        }
        mixed
    }

    /// Returns the smallest double y with P(Y ≤ y) ≥ p; p = 0.5 gives the median.
    ///
    /// For p above ½, the smallest with P(Y > y) ≤ 1 − p, which has more digits. It is exact to the
    /// last digit, by 64 evaluations of the [tails](Self::tails); the largest double if no number
    /// is large enough.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless p is above 0 and below 1.
    pub fn quantile(&self, p: f64) -> Result<f64, EmissionError> {
        let valid = p > 0.0 && p < 1.0;
        crate::error::check("probability", p, valid, "a value above 0 and below 1")?;
        let is_enough = |y: f64| {
            let tails = self.tails(y);
            if p <= 0.5 { tails.up_to() >= p } else { tails.above <= 1.0 - p }
        };
        // Bisection over the doubles themselves, in their order: each of at most 64 steps halves
        // their number. Invariant: no double below `low` is enough, and `high` is enough or the
        // largest double.
        let (mut low, mut high) = (rank_of(f64::MIN), rank_of(f64::MAX));
        while low < high {
            // The mean rounded down, without overflow.
            let middle = (low & high) + ((low ^ high) >> 1);
            if is_enough(double_at(middle)) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        Ok(double_at(high))
    }

    /// Draws a number, by drawing a state and an observation in it. O(n).
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the sensor draws an observation that it rejects, or one that is
    /// missing.
    pub fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> Result<f64, LikelihoodError>
    where
        B: SampleObservation,
    {
        let state = index(self.states(), 1.0, rng);
        let drawn = self.likelihood.sample(state, rng);
        let number = self.likelihood.number(drawn.borrow(), self.component)?;
        number.ok_or_else(|| {
            let (component, value, expected) =
                (self.component, f64::NAN, "a number that was drawn");
            EmissionError::Observation { component, value, expected }.into()
        })
    }
}

/// Rank of a double in the order of all doubles, from its bits; −0 is just below 0.
fn rank_of(y: f64) -> i64 {
    // Positive doubles are ordered as their bits. The bits of negative ones grow with their size:
    // flipping all but the sign bit reverses them.
    let bits = y.to_bits().cast_signed();
    bits ^ (((bits >> 63).cast_unsigned() >> 1).cast_signed())
}

/// The double of a rank, the inverse of [`rank_of`].
fn double_at(rank: i64) -> f64 {
    let bits = rank ^ (((rank >> 63).cast_unsigned() >> 1).cast_signed());
    f64::from_bits(bits.cast_unsigned())
}
