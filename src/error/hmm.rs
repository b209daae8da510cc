//! Errors of models, and of inference with them.

use std::borrow::Cow;

use super::{At, LikelihoodError, Number, TransitionError};

/// Parts that do not form a hidden Markov model, or a failure of inference with one.
///
/// Steps are counted from 1: step k is about observation `y_k`, which is `ys[k - 1]` of a batch.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum HmmError {
    /// The parts, or a snapshot or belief and its model, differ in their number of states.
    #[error("the {part} has {found} states, expected {expected} to match the {first}")]
    StateCount {
        /// Name of the part that differs from the first.
        part: &'static str,
        /// Number of states of the part.
        found: usize,
        /// Name of the first part.
        first: &'static str,
        /// Number of states of the first part.
        expected: usize,
    },
    /// An order of the states does not hold each state exactly once.
    #[error("the order must hold each of the {states} states once: check state {state}")]
    Order {
        /// A state that is missing, occurs twice, or does not exist.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// The transition operator has no unique stationary distribution that the prior could be.
    #[error("the prior cannot be stationary: {0}")]
    Stationary(TransitionError),
    /// A prior declared stationary changes in a transition.
    #[error(
        "the prior is not stationary: state {state} has probability {before}, and {after} after a transition",
        before = Number(*.before),
        after = Number(*.after)
    )]
    NotStationary {
        /// The state that changes most.
        state: usize,
        /// Its prior probability.
        before: f64,
        /// Its probability after a transition.
        after: f64,
    },
    /// The transition operator is not valid.
    #[error("the transition operator is not valid: {0}")]
    Transition(TransitionError),
    /// The observation has probability 0 given all earlier ones. In a model with
    /// [rounded tails](crate::Hmm::with_rounded_tails) this includes probabilities that were
    /// rounded to 0 because they were below 2.2e-308 of the whole.
    #[error("the observation of step {step} is impossible under the model")]
    Impossible {
        /// The step, from 1.
        step: usize,
    },
    /// The [likelihood](crate::Transition::evidence) of what was measured on the way to the step
    /// is 0 for all moves from the states that the belief allows. If the observation of the step is
    /// impossible or invalid as well, routines that look at it first report that instead.
    #[error("what was measured on the way to step {step} is impossible under the model")]
    ImpossibleMove {
        /// The step, from 1.
        step: usize,
    },
    /// The observation is impossible in all states that a pruned algorithm still tracks, though
    /// perhaps not in a state that was pruned.
    #[error("the observation of step {step} is impossible in all states that were not pruned")]
    Pruned {
        /// The step, from 1.
        step: usize,
    },
    /// The likelihood could not be computed, or is invalid.
    #[error(transparent)]
    Likelihood(At<LikelihoodError>),
    /// The transition operator does not accept the control.
    #[error(transparent)]
    Control(At<TransitionError>),
    /// The transition operator returned a value that is not a probability, so it violates its
    /// contract.
    #[error(
        "at step {step} the transition operator predicts {value} for state {state}, expected a probability",
        value = Number(*.value)
    )]
    Predicted {
        /// The step, from 1.
        step: usize,
        /// The state, from 0.
        state: usize,
        /// Value predicted.
        value: f64,
    },
    /// The log factor of [evidence on a move](crate::Transition::evidence) is NaN, or above 1e300
    /// in magnitude.
    #[error(
        "at step {step} the transition operator gives the log factor {value} for the evidence on the move, expected a value from -1e300 to 1e300",
        value = Number(*.value)
    )]
    EvidenceFactor {
        /// The step, from 1.
        step: usize,
        /// The log factor.
        value: f64,
    },
    /// The control of a step to be simulated is [evidence on the
    /// move](crate::Transition::evidence): a measurement depends on the states, so it can't be
    /// given before they are drawn.
    #[error(
        "the control of step {step} is evidence on the move, which a simulation cannot be given"
    )]
    SimulatedEvidence {
        /// The step, from 1.
        step: usize,
    },
    /// The predicted probabilities do not sum to one: the transition operator violates its
    /// contract, or its products and entries are not those of one matrix.
    #[error(
        "at step {step} the transition operator gives probabilities that sum to {sum}, expected 1; do its products and entries belong together?",
        sum = Number(*.sum)
    )]
    PredictedSum {
        /// The step, from 1.
        step: usize,
        /// Sum found.
        sum: f64,
    },
    /// The filter has taken as many steps as a snapshot can count: 2^53, or fewer where a `usize`
    /// has 32 bits.
    #[error("{steps} steps have been taken, the most that can be counted")]
    TooMany {
        /// Number of steps taken.
        steps: usize,
    },
    /// A batch has a different number of controls than of observations.
    #[error("{controls} controls for {observations} observations, expected one each")]
    ControlCount {
        /// Number of controls.
        controls: usize,
        /// Number of observations.
        observations: usize,
    },
    /// The bytes, or the numbers in them, are not a valid snapshot.
    #[error("not a valid snapshot: {problem}")]
    Snapshot {
        /// Description of the problem, with the expected value.
        problem: Cow<'static, str>,
    },
    /// A log-likelihood, or the log weight of a move, of a [`Trellis`](crate::inference::Trellis)
    /// is NaN, or finite and beyond ±1e300, or +∞.
    #[error(
        "step {step} of the trellis has the logarithm {value}, expected a value from -1e300 to 1e300, or -inf",
        value = Number(*.value)
    )]
    TrellisValue {
        /// The step, from 1.
        step: usize,
        /// Value found.
        value: f64,
    },
    /// A move of a [`Trellis`](crate::inference::Trellis) comes from a state that does not exist.
    #[error(
        "step {step} of the trellis has a move from state {from}, expected one of the {states} of the step before"
    )]
    TrellisState {
        /// The step to which the move leads, from 1.
        step: usize,
        /// The state, from 0.
        from: usize,
        /// Number of states of the previous step.
        states: usize,
    },
    /// A state was added to a [`Trellis`](crate::inference::Trellis) before its first step.
    #[error("the trellis has no step yet, expected one before the first state")]
    TrellisStep,
}

impl HmmError {
    /// Returns the step that the error is about, from 1, if there is one.
    ///
    /// ```
    /// use wayfix::HmmError;
    ///
    /// assert_eq!(HmmError::Impossible { step: 3 }.step(), Some(3));
    /// assert_eq!(HmmError::TooMany { steps: 3 }.step(), None);
    /// ```
    #[must_use]
    pub fn step(&self) -> Option<usize> {
        // No wildcard, so a new variant has to say whether it has a step.
        match self {
            Self::Impossible { step }
            | Self::ImpossibleMove { step }
            | Self::Pruned { step }
            | Self::Predicted { step, .. }
            | Self::EvidenceFactor { step, .. }
            | Self::SimulatedEvidence { step }
            | Self::PredictedSum { step, .. }
            | Self::TrellisValue { step, .. }
            | Self::TrellisState { step, .. } => Some(*step),
            Self::Likelihood(at) => Some(at.number),
            Self::Control(at) => Some(at.number),
            Self::TooMany { .. }
            | Self::ControlCount { .. }
            | Self::StateCount { .. }
            | Self::Order { .. }
            | Self::Stationary(_)
            | Self::NotStationary { .. }
            | Self::Transition(_)
            | Self::Snapshot { .. }
            | Self::TrellisStep => None,
        }
    }

    /// Error of a step whose likelihood could not be computed, or is invalid.
    #[doc(hidden)]
    #[must_use]
    pub fn likelihood(step: usize, cause: LikelihoodError) -> Self {
        Self::Likelihood(At::new(&["step ", " has no valid likelihood"], step, cause))
    }

    /// Error of a step whose control the transition operator does not accept.
    #[doc(hidden)]
    #[must_use]
    pub fn control(step: usize, cause: TransitionError) -> Self {
        Self::Control(At::new(&["step ", " has no valid control"], step, cause))
    }
}

impl From<TransitionError> for HmmError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}
