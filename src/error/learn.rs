//! Errors of many sequences and of learning.

use std::error::Error;
use std::fmt;

use super::{BeliefError, HmmError, InferenceError, TableError, TransitionError};

/// A failed sequence among several, with the cause.
#[derive(Debug, Clone)]
pub struct SequenceError {
    /// Index of the sequence, from 0.
    pub sequence: usize,
    /// Cause, with the step.
    pub source: InferenceError,
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
#[derive(Debug)]
#[non_exhaustive]
pub enum LearnError {
    /// There is no observation to learn from: no sequence was given, all are empty, or
    /// those that are not have all failed.
    Nothing {
        /// Number of sequences given.
        sequences: usize,
        /// The first failure, if any.
        first: Option<SequenceError>,
    },
    /// A sequence (or labelled drive) is invalid.
    Sequence(SequenceError),
    /// A number in [`LearningOptions`](crate::inference::LearningOptions) is NaN, negative or
    /// infinite.
    Parameter {
        /// Name of the number.
        what: &'static str,
        /// Value found.
        value: f64,
    },
    /// There are fewer sequences than groups (folds, say) to divide them into, or one group.
    Groups {
        /// Number of groups asked for.
        groups: usize,
        /// Number of sequences given.
        sequences: usize,
    },
    /// A labelled drive does not have one state per observation.
    Length {
        /// The drive, from 0.
        drive: usize,
        /// Number of states.
        states: usize,
        /// Number of observations.
        observations: usize,
    },
    /// A labelled drive is in a state that does not exist.
    State {
        /// The drive, from 0.
        drive: usize,
        /// The step, 0 for the initial state.
        step: usize,
        /// The state.
        state: usize,
        /// Number of states.
        states: usize,
    },
    /// A labelled drive starts in a state with prior probability 0.
    Start {
        /// The drive, from 0.
        drive: usize,
        /// State in which it starts.
        state: usize,
    },
    /// A labelled drive makes a move that the transition operator forbids.
    Forbidden {
        /// The drive, from 0.
        drive: usize,
        /// The step that the move leads to.
        step: usize,
        /// Source state.
        from: usize,
        /// Destination state.
        to: usize,
    },
    /// A labelled drive has an observation that is impossible in its state.
    Sighting {
        /// The drive, from 0.
        drive: usize,
        /// The step.
        step: usize,
        /// The state.
        state: usize,
    },
    /// Expectations are those of another model.
    Expectations {
        /// Name of the things that are counted.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number that the model has.
        expected: usize,
    },
    /// The prior could not be estimated.
    Prior(BeliefError),
    /// The transition operator could not be estimated.
    Transition(TransitionError),
    /// The sensor could not be estimated.
    Likelihood(Box<dyn Error + Send + Sync>),
    /// The estimated parts do not fit together.
    Hmm(HmmError),
    /// The log-density of the priors is not finite at parameters that were learned: a prior rules
    /// out what it led to, or its numbers are too large or too small.
    LogPrior {
        /// Number of the iteration, from 1.
        iteration: usize,
        /// Value found.
        value: f64,
    },
    /// The objective decreased by more than rounding explains: a part's re-estimation does not
    /// maximise it.
    Fell {
        /// Number of the iteration, from 1.
        iteration: usize,
        /// Objective before the iteration.
        before: f64,
        /// Objective after the iteration.
        after: f64,
    },
}

impl fmt::Display for LearnError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing { sequences, first } => {
                write!(f, "there is no observation to learn from, in {sequences} sequences given")?;
                first.iter().try_for_each(|first| write!(f, ": {first}"))
            }
            Self::Sequence(error) => fmt::Display::fmt(error, f),
            Self::Parameter { what, value } => {
                write!(f, "the {what} is {value}, expected a finite value of at least 0")
            }
            Self::Groups { groups, sequences } => write!(
                f,
                "{sequences} sequences cannot be divided into {groups} groups, expected 2 groups or more, of at least a sequence each: cut long sequences into pieces"
            ),
            Self::Length { drive, states, observations } => write!(
                f,
                "drive {drive} has {states} states for {observations} observations, expected one each"
            ),
            Self::State { drive, step, state, states } => write!(
                f,
                "drive {drive} is in state {state} at step {step}, expected 0 to {}",
                states - 1
            ),
            Self::Start { drive, state } => {
                write!(f, "drive {drive} starts in state {state}, which the prior rules out")
            }
            Self::Forbidden { drive, step, from, to } => write!(
                f,
                "drive {drive} moves from state {from} to state {to} at step {step}, which the transition operator forbids"
            ),
            Self::Sighting { drive, step, state } => write!(
                f,
                "drive {drive} is in state {state} at step {step}, where the sensor rules its observation out"
            ),
            Self::Expectations { what, found, expected } => {
                write!(f, "the expectations are of {found} {what}, the model has {expected}")
            }
            Self::Prior(source) => write!(f, "the prior cannot be estimated: {source}"),
            Self::Transition(source) => {
                write!(f, "the transition operator cannot be estimated: {source}")
            }
            Self::Likelihood(source) => write!(f, "the sensor cannot be estimated: {source}"),
            Self::Hmm(error) => fmt::Display::fmt(error, f),
            Self::LogPrior { iteration, value } => write!(
                f,
                "the log-density of the priors is {value} after re-estimation {iteration}, expected a finite value: are the numbers of a prior too large or too small?"
            ),
            Self::Fell { iteration, before, after } => write!(
                f,
                "re-estimation {iteration} makes the objective fall from {before} to {after}: a part does not maximise it (is a floor or bound missing in its prior?)"
            ),
        }
    }
}

impl Error for LearnError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Nothing { first: Some(first), .. } => first.source(),
            Self::Sequence(source) => source.source(),
            Self::Prior(source) => source.source(),
            Self::Transition(source) => source.source(),
            Self::Likelihood(source) => source.source(),
            Self::Hmm(source) => source.source(),
            _ => None,
        }
    }
}

impl From<SequenceError> for LearnError {
    fn from(source: SequenceError) -> Self {
        Self::Sequence(source)
    }
}

impl From<BeliefError> for LearnError {
    fn from(source: BeliefError) -> Self {
        Self::Prior(source)
    }
}

impl From<TransitionError> for LearnError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}

impl From<TableError> for LearnError {
    fn from(source: TableError) -> Self {
        Self::Likelihood(Box::new(source))
    }
}

impl From<HmmError> for LearnError {
    fn from(source: HmmError) -> Self {
        Self::Hmm(source)
    }
}
