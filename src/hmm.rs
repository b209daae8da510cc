//! A hidden Markov model: prior, transition and likelihood.

use crate::belief::Belief;
use crate::error::HmmError;
use crate::likelihood::Likelihood;
use crate::reorder::ReorderStates;
use crate::transition::{self, Transition};

/// Belief before the first observation, and **when** it holds.
///
/// The field has two conventions. They give different results, in Viterbi too, so the prior names
/// the one that is meant.
///
/// ```
/// use wayfix::{Belief, Prior};
///
/// // The vehicle is at place 4 of 105 and has not moved yet.
/// let prior = Prior::BeforeFirstTransition(Belief::certain(105, 4)?);
/// assert_eq!(prior.belief().mode(), 4);
/// # Ok::<(), wayfix::BeliefError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Prior {
    /// The distribution of X_0, one transition before the first observation:
    /// α_0 = π_0, α_1 = B(y_1) A α_0. The paper's convention (eq. 10).
    BeforeFirstTransition(Belief),
    /// The distribution of X_1, the state of the first observation: α_1 = B(y_1) π. The
    /// convention of Rabiner (1989), hmmlearn and dynamax.
    AtFirstObservation(Belief),
}

impl Prior {
    /// Returns the distribution.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        match self {
            Self::BeforeFirstTransition(belief) | Self::AtFirstObservation(belief) => belief,
        }
    }

    /// True if a transition leads to step k, counted from 1.
    pub(crate) fn moves_at(&self, step: usize) -> bool {
        step > 1 || matches!(self, Self::BeforeFirstTransition(_))
    }
}

/// A hidden Markov model: a [`Prior`], a [`Transition`] operator A and a
/// [`Likelihood`] operator B.
///
/// Its methods are listed on the [front page](crate). Methods for a whole
/// [`Sequence`](crate::Sequence) take a slice of observations, or, if the operator has a control,
/// a [`Controlled`](crate::Controlled) sequence: control k drives the transition from k − 1 to k,
/// *before* observation k.
///
/// ```
/// use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// // States: rain or no rain; observations: umbrella or none (Russell and Norvig).
/// let hmm = Hmm::new(
///     Prior::BeforeFirstTransition(Belief::uniform(2)?),
///     SparseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
///     TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?,
/// )?;
/// let (umbrella, none) = (0, 1);
/// let smoothing = hmm.smooth(&[umbrella, umbrella, none])?;
/// assert_eq!(smoothing.posteriors().modes(), [0, 0, 1]);
/// assert_eq!(hmm.viterbi(&[umbrella, umbrella, none])?.states(), [0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Hmm<A, B> {
    prior: Prior,
    transition: A,
    likelihood: B,
    rounds_tails: bool,
}

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Creates a model from three parts with the same number of states. O(n + E).
    ///
    /// For a transition operator that declares to have [no control](Transition::no_control), this
    /// checks the sums of the columns, and that the two products are those of one matrix and its
    /// transpose. Any other is checked at each step, by the sum of its prediction.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the parts differ in their number of states, or if the operator is not
    /// stochastic.
    pub fn new(prior: Prior, transition: A, likelihood: B) -> Result<Self, HmmError> {
        let expected = prior.belief().states();
        for (part, found) in [
            ("transition operator", transition.states()),
            ("likelihood operator", likelihood.states()),
        ] {
            if found != expected {
                return Err(HmmError::StateCount { part, found, first: "prior", expected });
            }
        }
        transition::validate(&transition)?;
        Ok(Self { prior, transition, likelihood, rounds_tails: false })
    }

    /// Allows filter and smoother to round to 0 what is below 2.2e-308 (the smallest normal
    /// double) of the whole.
    ///
    /// For models whose tails carry no meaning, such as those of a sensor with Gaussian noise: on
    /// a map they leave nearly every belief with values beyond the range of doubles, and a step
    /// in logarithms, which keeps these, takes some ten times as long. The price is that a state
    /// of so low a probability cannot recover, even if all later observations support it.
    ///
    /// ```
    /// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    ///
    /// let stay = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
    /// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// let exact = Hmm::new(prior, stay, LikelihoodVector::log(2))?;
    /// let seen = [[0.0, -800.0], [-1000.0, 0.0]];
    /// assert_eq!(exact.smooth(&seen)?.posteriors().modes(), [1, 1]);
    ///
    /// let rounded = exact.with_rounded_tails();
    /// assert_eq!(rounded.smooth(&seen)?.posteriors().modes(), [0, 0]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// Models [learned](Self::learn) from it and models read from a file keep the setting.
    #[must_use]
    pub fn with_rounded_tails(self) -> Self {
        self.rounding_tails(true)
    }

    pub(crate) fn rounding_tails(self, rounds_tails: bool) -> Self {
        Self { rounds_tails, ..self }
    }

    /// True if the model has [rounded tails](Self::with_rounded_tails).
    #[must_use]
    pub fn rounds_tails(&self) -> bool {
        self.rounds_tails
    }

    /// Number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        self.prior.belief().states()
    }

    /// Belief before the first observation.
    #[must_use]
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Transition operator A.
    #[must_use]
    pub fn transition(&self) -> &A {
        &self.transition
    }

    /// Likelihood operator B.
    #[must_use]
    pub fn likelihood(&self) -> &B {
        &self.likelihood
    }

    /// Moves prior, transition operator and likelihood operator out. A model built from them
    /// keeps its tails unless told to [round](Self::with_rounded_tails) them again.
    #[must_use]
    pub fn into_parts(self) -> (Prior, A, B) {
        (self.prior, self.transition, self.likelihood)
    }

    /// Returns the model with its former state `order[i]` as state i. O(n + E).
    ///
    /// # Errors
    ///
    /// [`HmmError::Order`] unless `order` holds each state once.
    pub fn reordered(&self, order: &[usize]) -> Result<Self, HmmError>
    where
        A: ReorderStates,
        B: ReorderStates,
    {
        let states = self.states();
        let mut seen = vec![false; states];
        for &state in order {
            match seen.get_mut(state) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(HmmError::Order { state, states }),
            }
        }
        if let Some(state) = seen.iter().position(|seen| !seen) {
            return Err(HmmError::Order { state, states });
        }
        let probabilities = self.prior.belief().as_slice();
        let belief = Belief::known(order.iter().map(|&state| probabilities[state]).collect());
        let prior = match self.prior {
            Prior::BeforeFirstTransition(_) => Prior::BeforeFirstTransition(belief),
            Prior::AtFirstObservation(_) => Prior::AtFirstObservation(belief),
        };
        Ok(Self {
            prior,
            transition: self.transition.reordered(order),
            likelihood: self.likelihood.reordered(order),
            rounds_tails: self.rounds_tails,
        })
    }
}
