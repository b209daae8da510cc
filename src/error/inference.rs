//! Errors of inference on sequences, and of learning from them.

use std::error::Error;
use std::fmt;

use super::{BeliefError, HmmError, LikelihoodError, TransitionError};

/// A failure of inference at a step.
///
/// Steps are counted from 1: step k is about observation `y_k`, which is
/// `ys[k - 1]` of a batch.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum InferenceError {
    /// The observation has probability 0 given all earlier ones. In a model with
    /// [rounded tails](crate::Hmm::with_rounded_tails) this includes probabilities that were
    /// rounded to 0, being below 2.2e-308 of the whole.
    Impossible {
        /// The step, from 1.
        step: usize,
    },
    /// The [likelihood](crate::Transition::evidence) of what was measured on the way to the step
    /// is 0 for all moves from the states that the belief allows.
    ImpossibleMove {
        /// The step, from 1.
        step: usize,
    },
    /// The observation is impossible in all states that a pruned algorithm still tracks, though
    /// perhaps not in a state that was pruned.
    Pruned {
        /// The step, from 1.
        step: usize,
    },
    /// The likelihood could not be computed, or is invalid.
    Likelihood {
        /// The step, from 1.
        step: usize,
        /// Cause.
        source: LikelihoodError,
    },
    /// The transition operator does not accept the control.
    Control {
        /// The step, from 1.
        step: usize,
        /// Cause.
        source: TransitionError,
    },
    /// The transition operator returned a value that is not a probability, so it violates its
    /// contract.
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
    EvidenceFactor {
        /// The step, from 1.
        step: usize,
        /// The log factor.
        value: f64,
    },
    /// The control of a step to be simulated is [evidence on the
    /// move](crate::Transition::evidence): a measurement depends on the states, and cannot be
    /// given before they are drawn.
    SimulatedEvidence {
        /// The step, from 1.
        step: usize,
    },
    /// The predicted probabilities do not sum to one: the transition operator violates its
    /// contract, or its products and entries are not those of one matrix.
    PredictedSum {
        /// The step, from 1.
        step: usize,
        /// Sum found.
        sum: f64,
    },
    /// The filter has taken as many steps as a snapshot can count: 2^53, or fewer where a `usize`
    /// has 32 bits.
    TooMany {
        /// Number of steps taken.
        steps: usize,
    },
    /// A batch has a different number of controls than of observations.
    ControlCount {
        /// Number of controls.
        controls: usize,
        /// Number of observations.
        observations: usize,
    },
    /// A snapshot or a belief has another number of states than the model.
    StateCount {
        /// "snapshot" or "belief".
        what: &'static str,
        /// Number of states found.
        found: usize,
        /// Number of states of the model.
        expected: usize,
    },
}

impl fmt::Display for InferenceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Impossible { step } => {
                write!(f, "the observation of step {step} is impossible under the model")
            }
            Self::ImpossibleMove { step } => {
                write!(
                    f,
                    "what was measured on the way to step {step} is impossible under the model"
                )
            }
            Self::EvidenceFactor { step, value } => write!(
                f,
                "at step {step} the transition operator gives the log factor {value} for the evidence on the move, expected a value from -1e300 to 1e300"
            ),
            Self::SimulatedEvidence { step } => write!(
                f,
                "the control of step {step} is evidence on the move, which a simulation cannot be given"
            ),
            Self::Pruned { step } => write!(
                f,
                "the observation of step {step} is impossible in all states that were not pruned"
            ),
            Self::Likelihood { step, source } => {
                write!(f, "step {step} has no valid likelihood: {source}")
            }
            Self::Control { step, source } => {
                write!(f, "step {step} has no valid control: {source}")
            }
            Self::Predicted { step, state, value } => write!(
                f,
                "at step {step} the transition operator predicts {value} for state {state}, expected a probability"
            ),
            Self::PredictedSum { step, sum } => write!(
                f,
                "at step {step} the transition operator gives probabilities that sum to {sum}, expected 1; do its products and entries belong together?"
            ),
            Self::TooMany { steps } => {
                write!(f, "{steps} steps have been taken, the most that can be counted")
            }
            Self::ControlCount { controls, observations } => {
                write!(f, "{controls} controls for {observations} observations, expected one each")
            }
            Self::StateCount { what, found, expected } => {
                write!(f, "the {what} has {found} states, expected {expected} as the model")
            }
        }
    }
}

impl Error for InferenceError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Likelihood { source, .. } => source.source(),
            Self::Control { source, .. } => source.source(),
            _ => None,
        }
    }
}

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
    /// There is no sequence to learn from: none was given, or all of them failed.
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
    /// The prior could not be estimated.
    Prior(BeliefError),
    /// The transition operator could not be estimated.
    Transition(TransitionError),
    /// The sensor could not be estimated.
    Likelihood(Box<dyn Error + Send + Sync>),
    /// The estimated parts do not fit together.
    Hmm(HmmError),
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
                write!(f, "there is no sequence to learn from, of {sequences} given")?;
                first.iter().try_for_each(|first| write!(f, ": {first}"))
            }
            Self::Sequence(error) => fmt::Display::fmt(error, f),
            Self::Parameter { what, value } => {
                write!(f, "the {what} is {value}, expected a finite value of at least 0")
            }
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
            Self::Prior(source) => write!(f, "the prior cannot be estimated: {source}"),
            Self::Transition(source) => {
                write!(f, "the transition operator cannot be estimated: {source}")
            }
            Self::Likelihood(source) => write!(f, "the sensor cannot be estimated: {source}"),
            Self::Hmm(error) => fmt::Display::fmt(error, f),
            Self::Fell { iteration, before, after } => write!(
                f,
                "re-estimation {iteration} makes the objective fall from {before} to {after}"
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

impl From<HmmError> for LearnError {
    fn from(source: HmmError) -> Self {
        Self::Hmm(source)
    }
}
