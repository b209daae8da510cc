//! [`Hmm`], a hidden Markov model: prior, transition operator and likelihood operator.
//!
//! Invariant, checked by [`Hmm::new`]: the three parts have the same number of states; an operator
//! that is the same at all steps is stochastic; a stationary prior is that of the operator.
//! Inference relies on it, and checks the rest step by step.

use std::ops::Deref;

use crate::belief::Belief;
use crate::error::{HmmError, TransitionError};
use crate::likelihood::Likelihood;
use crate::reorder::ReorderStates;
use crate::transition::{self, Stationary, Transition, TransitionEntries, stationary_control};

/// Largest Σ |A π − π| of a stationary prior: ten times the tolerance of the sum of a column.
const STATIONARY_TOLERANCE: f64 = 1e-8;

/// Belief before the first observation, and **when** it holds.
///
/// The field has two conventions. They give different results, in Viterbi too, so the type names
/// the convention.
///
/// ```
/// use wayfix::{Belief, Prior};
///
/// // The vehicle is at place 4 of 105 and has not moved yet.
/// let prior = Prior::BeforeFirstTransition(Belief::certain(105, 4)?);
/// assert_eq!(prior.belief().mode(), 4);
/// # Ok::<(), wayfix::error::OutOfRange>(())
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
    /// The distribution of X_1, as in [`AtFirstObservation`](Self::AtFirstObservation), and of
    /// every later step: A π = π. For a chain that was running long before it was observed; the
    /// convention of Zucchini, MacDonald and Langrock (2016), statsmodels and, on request, R's
    /// HiddenMarkov. Created by [`stationary`](Self::stationary).
    ///
    /// The prior has no parameters of its own: [learning](Hmm::learn) derives π from A, and takes
    /// that into account when it estimates A. An operator with a control has no such distribution.
    Stationary(Belief),
}

impl Prior {
    /// Creates the stationary prior of an operator that is the same at all steps, by elimination
    /// of states (Grassmann, Taksar and Heyman 1985). It takes no subtraction, so that each
    /// probability has a small relative error, however slowly the chain mixes. States outside the
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
    /// [`TransitionError`] if the operator has a control or evidence on moves
    /// ([`Stationary`](TransitionError::Stationary)); if the chain has several closed classes
    /// ([`ClosedClasses`](TransitionError::ClosedClasses)); if the elimination takes more than
    /// 2^26 entries ([`Elimination`](TransitionError::Elimination)), as for a large graph without
    /// small cuts; or if the probability of leaving a state is below the range of doubles.
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

    /// Returns another distribution under the same convention.
    #[doc(hidden)]
    #[must_use]
    pub fn with_belief(&self, belief: Belief) -> Self {
        match self {
            Self::BeforeFirstTransition(_) => Self::BeforeFirstTransition(belief),
            Self::AtFirstObservation(_) => Self::AtFirstObservation(belief),
            Self::Stationary(_) => Self::Stationary(belief),
        }
    }

    /// True if a transition leads to this step, counted from 1.
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
    /// If the transition operator takes no control, this checks the sums of its columns, and that
    /// its two products are those of one matrix and its transpose. Any other operator is checked at
    /// each step, by the sum of its prediction.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the parts differ in their number of states, if the operator is not
    /// stochastic, or if a [stationary](Prior::Stationary) prior is not that of the operator: a
    /// transition changes it by more than 1e-8 in all, or the operator has a control.
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
        // Checked after the operator, whose errors are the cause if both fail.
        if let Prior::Stationary(belief) = &prior {
            check_stationary(belief, &transition)?;
        }
        Ok(Self { prior, transition, likelihood, rounds_tails: false })
    }

    /// Allows filter and smoother to round to 0 whatever is below 2.2e-308 (the smallest normal
    /// double) of the whole.
    ///
    /// For models whose tails carry no meaning, such as those of a sensor with Gaussian noise. On a
    /// map, such tails leave nearly every belief with values beyond the range of doubles, and a
    /// step in logarithms, which keeps them, takes about ten times as long. The price is that a
    /// state of such a low probability cannot recover, even if all later observations support it.
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
    /// Models [learned](Self::learn) from this one, and models read from a file, keep the setting.
    #[must_use]
    pub fn with_rounded_tails(self) -> Self {
        self.rounding_tails(true)
    }

    #[doc(hidden)]
    #[must_use]
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

    /// Moves prior, transition operator and likelihood operator out. A model built from them does
    /// not round its tails unless told to [again](Self::with_rounded_tails).
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
        // A permutation: each state at most once, and then each at least once.
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
        // Reordering changes no number, so the checks of `new` still hold.
        let probabilities = self.prior.belief().as_slice();
        let belief = Belief::from_valid(order.iter().map(|&state| probabilities[state]).collect());
        Ok(Self {
            prior: self.prior.with_belief(belief),
            transition: self.transition.reordered(order),
            likelihood: self.likelihood.reordered(order),
            rounds_tails: self.rounds_tails,
        })
    }
}

/// A pointer to a model, for making streams: `&Hmm`, `Arc<Hmm>`, `Box<Hmm>` or another.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a pointer to a model",
    label = "expected `&Hmm`, `Arc<Hmm>` or another pointer to an `Hmm`",
    note = "a stream borrows its model, `&hmm`, or shares it, `Arc::new(hmm)`"
)]
pub trait ModelPointer {
    /// Transition operator of the model.
    type Transition: Transition;
    /// Likelihood operator of the model.
    type Likelihood: Likelihood;

    /// The model.
    fn hmm(&self) -> &Hmm<Self::Transition, Self::Likelihood>;
}

#[diagnostic::do_not_recommend]
impl<M: Deref<Target = Hmm<A, B>>, A: Transition, B: Likelihood> ModelPointer for M {
    type Transition = A;
    type Likelihood = B;

    fn hmm(&self) -> &Hmm<A, B> {
        self
    }
}

/// Checks that a transition does not change a belief.
fn check_stationary<A: Transition>(belief: &Belief, transition: &A) -> Result<(), HmmError> {
    let control = stationary_control(transition).map_err(HmmError::Stationary)?;
    let mut after = vec![0.0; belief.states()];
    transition.apply(control, belief.as_slice(), &mut after);
    let changes =
        belief.as_slice().iter().zip(&after).map(|(before, after)| (after - before).abs());
    let sum: f64 = changes.clone().sum();
    if sum.is_nan() || sum > STATIONARY_TOLERANCE {
        // `max_by` returns the last of equal changes: from the back that is the lowest state.
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
