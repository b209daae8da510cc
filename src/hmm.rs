//! A hidden Markov model: prior, transition and likelihood.

use crate::belief::Belief;
use crate::error::HmmError;
use crate::likelihood::Likelihood;
use crate::transition::{self, Transition};

/// What is believed before anything is observed, and **when** it holds.
///
/// The field has two conventions, and they give different results, in Viterbi
/// too, so it must be said which one is meant.
///
/// ```
/// use wayfix::{Belief, Prior};
///
/// // The vehicle stands at place 4 of 105 and has yet to move.
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
    /// The distribution of X_1, at which the first observation is made:
    /// α_1 = B(y_1) π. The convention of Rabiner (1989), and of hmmlearn and
    /// dynamax.
    AtFirstObservation(Belief),
}

impl Prior {
    /// The distribution itself.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        match self {
            Self::BeforeFirstTransition(belief) | Self::AtFirstObservation(belief) => belief,
        }
    }

    /// Whether a transition leads to step k, counted from 1.
    pub(crate) fn moves_at(&self, step: usize) -> bool {
        step > 1 || matches!(self, Self::BeforeFirstTransition(_))
    }
}

/// A hidden Markov model: a [`Prior`], a [`Transition`] operator A and a
/// [`Likelihood`] operator B.
///
/// Its verbs are listed on the [front page](crate). Those for a whole
/// [`Sequence`](crate::Sequence) take a slice of observations, or, for an
/// operator with a control, a [`Controlled`](crate::Controlled) one: control k
/// drives the transition from k − 1 to k, the one *before* observation k.
///
/// ```
/// use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// // Rain or no rain, and whether an umbrella is seen (Russell and Norvig).
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
    /// A model of three parts with the same number of states. O(n + E): of a
    /// transition operator without a control the columns are checked, and that
    /// its two products belong together; one with a control is checked as it is
    /// used.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the parts differ in size, or if the operator is not
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

    /// The same model, whose filter and smoother may round to 0 what is below 2.2e-308
    /// of the whole (the smallest normal double).
    ///
    /// For models with tails that are not to be believed, such as those of a sensor with
    /// a Gaussian: on a map they make nearly every belief hold values beyond doubles,
    /// and keeping these in logarithms takes some ten times as long. The price: a
    /// state so improbable does not come back, even if all later observations speak
    /// for it.
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
    /// Models [learned](Self::learn) from it and those read from a file keep the choice.
    #[must_use]
    pub fn with_rounded_tails(self) -> Self {
        self.rounding_tails(true)
    }

    pub(crate) fn rounding_tails(self, rounds_tails: bool) -> Self {
        Self { rounds_tails, ..self }
    }

    /// True for a model [with rounded tails](Self::with_rounded_tails).
    #[must_use]
    pub fn rounds_tails(&self) -> bool {
        self.rounds_tails
    }

    /// The number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        self.prior.belief().states()
    }

    /// What is believed before anything is observed.
    #[must_use]
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The transition operator A.
    #[must_use]
    pub fn transition(&self) -> &A {
        &self.transition
    }

    /// The likelihood operator B.
    #[must_use]
    pub fn likelihood(&self) -> &B {
        &self.likelihood
    }

    /// Prior, transition operator and likelihood operator, moved out. A model made of
    /// them again keeps its tails unless it is told to
    /// [round](Self::with_rounded_tails) them.
    #[must_use]
    pub fn into_parts(self) -> (Prior, A, B) {
        (self.prior, self.transition, self.likelihood)
    }
}
