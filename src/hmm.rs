//! A hidden Markov model: prior, transition and likelihood.

use crate::belief::Belief;
use crate::error::{HmmError, TransitionError};
use crate::likelihood::Likelihood;
use crate::reorder::ReorderStates;
use crate::transition::{self, Stationary, Transition, TransitionEntries, the_control};

/// Largest Σ |A π − π| of a stationary prior: ten times as much as columns may miss one by.
const STATIONARY_TOLERANCE: f64 = 1e-8;

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
    /// The distribution of X_1, as in [`AtFirstObservation`](Self::AtFirstObservation), which is
    /// that of any other step: A π = π. For a chain that had been running long before it was
    /// observed; the convention of Zucchini, MacDonald and Langrock (2016), statsmodels and, on
    /// request, R's HiddenMarkov. Made by [`stationary`](Self::stationary).
    ///
    /// The prior has no parameters of its own: [learning](Hmm::learn) takes π from A, and account
    /// of this in A. For an operator with a control there is no such distribution.
    Stationary(Belief),
}

impl Prior {
    /// Creates the stationary prior of an operator that is the same at all steps, by elimination
    /// of states (Grassmann, Taksar and Heyman 1985): without a subtraction, so that each
    /// probability has small relative error, however slowly the chain mixes. States outside the
    /// only closed class have probability 0. O(n³) at most, and much less for maps of places.
    ///
    /// ```
    /// use wayfix::{DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let weather = DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]])?;
    /// let prior = Prior::stationary(&weather)?;
    /// assert!((prior.belief().as_slice()[0] - 0.75).abs() < 1e-15);
    /// let sensor = TableLikelihood::from_rows(&[[0.8, 0.2], [0.1, 0.9]])?;
    /// let hmm = Hmm::new(prior, weather, sensor)?;
    /// let always: f64 = 0.75 * 0.8 + 0.25 * 0.1;
    /// assert!((hmm.log_likelihood(&[0])? - always.ln()).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] if the operator has a control, does not
    /// [declare to have none](Transition::no_control), or has evidence on moves
    /// ([`Stationary`](TransitionError::Stationary)); if the chain has several closed classes
    /// ([`ClosedClasses`](TransitionError::ClosedClasses)); if the elimination takes more than
    /// 2^26 entries ([`Elimination`](TransitionError::Elimination)), as for a large graph without
    /// small cuts; and if a state is left with a probability out of the range of doubles.
    pub fn stationary<A: TransitionEntries>(transition: &A) -> Result<Self, TransitionError> {
        Ok(Self::Stationary(Stationary::of(transition)?.distribution()))
    }

    /// Returns the distribution.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        match self {
            Self::BeforeFirstTransition(belief)
            | Self::AtFirstObservation(belief)
            | Self::Stationary(belief) => belief,
        }
    }

    /// The same convention with another distribution.
    #[doc(hidden)]
    pub fn with_belief(&self, belief: Belief) -> Self {
        match self {
            Self::BeforeFirstTransition(_) => Self::BeforeFirstTransition(belief),
            Self::AtFirstObservation(_) => Self::AtFirstObservation(belief),
            Self::Stationary(_) => Self::Stationary(belief),
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
    /// [`HmmError`] if the parts differ in their number of states, if the operator is not
    /// stochastic, or if a [stationary](Prior::Stationary) prior is not that of the operator: the sum
    /// of the changes by a transition is above 1e-8, or the operator has a control.
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
        if let Prior::Stationary(belief) = &prior {
            check_stationary(belief, &transition)?;
        }
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

    #[doc(hidden)]
    pub fn rounding_tails(self, rounds_tails: bool) -> Self {
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
        Ok(Self {
            prior: self.prior.with_belief(belief),
            transition: self.transition.reordered(order),
            likelihood: self.likelihood.reordered(order),
            rounds_tails: self.rounds_tails,
        })
    }
}

/// Checks that a transition does not change a belief.
fn check_stationary<A: Transition>(belief: &Belief, transition: &A) -> Result<(), HmmError> {
    let control = the_control(transition).map_err(HmmError::Stationary)?;
    let mut after = vec![0.0; belief.states()];
    transition.apply(control, belief.as_slice(), &mut after);
    let changes =
        belief.as_slice().iter().zip(&after).map(|(before, after)| (after - before).abs());
    let sum: f64 = changes.clone().sum();
    if sum.is_nan() || sum > STATIONARY_TOLERANCE {
        // From the back, since the last of equal ones is taken.
        let largest = changes.enumerate().rev().max_by(|a, b| a.1.total_cmp(&b.1));
        let (state, _) = largest.unwrap_or_default();
        let before = belief.as_slice()[state];
        return Err(HmmError::NotStationary { state, before, after: after[state] });
    }
    Ok(())
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition, B: Likelihood] Hmm<A, B>: [A, B], |hmm| {
        prior: Prior = hmm.prior(),
        transition: A = hmm.transition(),
        likelihood: B = hmm.likelihood(),
        rounds_tails: bool = hmm.rounds_tails(),
    } => self::Hmm::new(prior, transition, likelihood).map(|hmm| hmm.rounding_tails(rounds_tails));
}
