//! [`SequenceError`] and [`LearnError`]: errors of batches of sequences, and of learning.

use std::error::Error;
use std::fmt;
use std::sync::Arc;

use super::{At, Failed, HmmError, Number, OutOfRange, TransitionError};

/// A failed sequence among several, with the cause.
#[derive(Debug, Clone)]
pub struct SequenceError {
    /// Index of the sequence, from 0.
    pub sequence: usize,
    /// Cause, with the step.
    pub source: HmmError,
}

impl fmt::Display for SequenceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sequence, source } = self;
        write!(f, "sequence {sequence} failed: {source}")
    }
}

impl Error for SequenceError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.source.source()
    }
}

/// A failure of learning.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// There is no observation to learn from: no sequence was given, or all are empty.
    #[error("there is no observation to learn from, in {sequences} sequences given")]
    Nothing {
        /// Number of sequences given.
        sequences: usize,
    },
    /// There is no observation to learn from, since all sequences that have one have failed. The
    /// number is that of the sequences given, the cause is the first failure.
    #[error(transparent)]
    AllFailed(At<SequenceError>),
    /// A sequence is invalid.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A number in [`LearningOptions`](crate::inference::LearningOptions) is NaN, negative or
    /// infinite; or, for standard errors, a level is not between 0 and 1, or a function returned
    /// numbers that are not finite, or not the same number of them each time.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// There are fewer sequences than groups (such as folds) to divide them into, or only one
    /// group.
    #[error(
        "{sequences} sequences cannot be divided into {groups} groups, expected at least 2 groups with at least one sequence each: cut long sequences into pieces"
    )]
    Groups {
        /// Number of groups asked for.
        groups: usize,
        /// Number of sequences given.
        sequences: usize,
    },
    /// A labelled sequence does not have one state per observation.
    #[error(
        "sequence {sequence} has {states} states for {observations} observations, expected one each"
    )]
    Length {
        /// The sequence, from 0.
        sequence: usize,
        /// Number of states.
        states: usize,
        /// Number of observations.
        observations: usize,
    },
    /// A labelled sequence is in a state that does not exist.
    #[error("sequence {sequence} is in state {state} at step {step}, expected 0 to {}", .states - 1)]
    State {
        /// The sequence, from 0.
        sequence: usize,
        /// The step, 0 for the initial state.
        step: usize,
        /// The state.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// A labelled sequence starts in a state with prior probability 0.
    #[error("sequence {sequence} starts in state {state}, which the prior rules out")]
    Start {
        /// The sequence, from 0.
        sequence: usize,
        /// State in which it starts.
        state: usize,
    },
    /// A labelled sequence makes a move that the transition operator forbids.
    #[error(
        "sequence {sequence} moves from state {from} to state {to} at step {step}, which the transition operator forbids"
    )]
    Forbidden {
        /// The sequence, from 0.
        sequence: usize,
        /// The step that the move leads to.
        step: usize,
        /// Source state.
        from: usize,
        /// Destination state.
        to: usize,
    },
    /// A labelled sequence has an observation that is impossible in its state.
    #[error(
        "sequence {sequence} is in state {state} at step {step}, where the sensor rules its observation out"
    )]
    Sighting {
        /// The sequence, from 0.
        sequence: usize,
        /// The step.
        step: usize,
        /// The state.
        state: usize,
    },
    /// The expectations belong to another model.
    #[error("the expectations are of {found} states, the model has {expected}")]
    Expectations {
        /// Number of states found.
        found: usize,
        /// Number that the model has.
        expected: usize,
    },
    /// The prior could not be estimated.
    #[error("the prior cannot be estimated: {0}")]
    Prior(OutOfRange),
    /// The transition operator could not be estimated.
    #[error("the transition operator cannot be estimated: {0}")]
    Transition(TransitionError),
    /// The sensor could not be estimated.
    #[error(transparent)]
    Likelihood(Failed<Arc<dyn Error + Send + Sync>>),
    /// The prior is stationary, and the operator does not compute the log-probability of moves.
    #[error(
        "with a stationary prior, learning needs `LearnTransition::log_probability` of the operator, which does not compute it: keep the prior, or the operator (`Fixed`)"
    )]
    Stationary,
    /// The estimated parts do not fit together.
    #[error(transparent)]
    Hmm(#[from] HmmError),
    /// The log-density of the priors is not finite at the learned parameters: a prior rules out the
    /// parameters that it led to, or its numbers are too large or too small.
    #[error(
        "the log-density of the priors is {value} after re-estimation {iteration}, expected a finite value: are the numbers of a prior too large or too small?",
        value = Number(*.value)
    )]
    LogPrior {
        /// Number of the iteration, from 1.
        iteration: usize,
        /// Value found.
        value: f64,
    },
    /// The sequences do not determine a free parameter of a model, given the others: the objective
    /// does not change with it, to the precision of the differences.
    #[error(
        "the sequences do not determine free parameter {number} of the {part} ({value}), alone or together with others",
        value = Number(*.value)
    )]
    NotDetermined {
        /// The part of the model.
        part: &'static str,
        /// Number of the parameter in it, from 0, in the order in which
        /// [`FreeParameters`](crate::inference::FreeParameters) takes them.
        number: usize,
        /// Value of the parameter.
        value: f64,
    },
    /// A model is not at a maximum of the objective.
    #[error(
        "the model is not at a maximum of the objective, as free parameter {number} of the {part} ({value}) shows: learn it from these sequences with the same options, to a smaller tolerance",
        value = Number(*.value)
    )]
    NotAtMaximum {
        /// The part of the model.
        part: &'static str,
        /// Number of the parameter in it, from 0, in the order in which
        /// [`FreeParameters`](crate::inference::FreeParameters) takes them.
        number: usize,
        /// Value of the parameter.
        value: f64,
    },
    /// A model with displaced parameters is not valid.
    #[error(transparent)]
    Displaced(Failed<Arc<dyn Error + Send + Sync>>),
    /// The objective decreased by more than rounding explains: a part's re-estimation does not
    /// maximise it.
    #[error(
        "re-estimation {iteration} makes the objective fall from {before} to {after}: a part does not maximise it (is a floor or bound missing in its prior?)",
        before = Number(*.before),
        after = Number(*.after)
    )]
    Fell {
        /// Number of the iteration, from 1.
        iteration: usize,
        /// Objective before the iteration.
        before: f64,
        /// Objective after the iteration.
        after: f64,
    },
}

impl LearnError {
    /// Error of sequences none of which can be learned from; `first` is the first failure, if any.
    #[doc(hidden)]
    #[must_use]
    pub fn nothing(sequences: usize, first: Option<SequenceError>) -> Self {
        let words = &["there is no observation to learn from, in ", " sequences given"];
        match first {
            None => Self::Nothing { sequences },
            Some(first) => Self::AllFailed(At::new(words, sequences, first)),
        }
    }

    /// Error of a part that is not valid after its parameters are displaced.
    #[doc(hidden)]
    pub fn displaced(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let what = "a part of the model cannot be displaced";
        Self::Displaced(Failed { what, cause: Arc::from(error.into()) })
    }

    /// Error of a sensor that could not be estimated.
    #[doc(hidden)]
    pub fn likelihood(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let what = "the sensor cannot be estimated";
        Self::Likelihood(Failed { what, cause: Arc::from(error.into()) })
    }
}

impl From<TransitionError> for LearnError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}
