//! What can be wrong with sequences, and with what is learned from them.

use std::error::Error;
use std::fmt;

use super::{BeliefError, HmmError, LikelihoodError, TransitionError};

/// Why inference stopped at a step.
///
/// Steps are counted from 1: step k is about observation `y_k`, which is
/// `ys[k - 1]` of a batch.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum InferenceError {
    /// The model rules the observation out: its probability given all before
    /// it is 0. (In a model with [rounded tails](crate::Hmm::with_rounded_tails) that
    /// counts as 0, too, which was below 2.2e-308 of the whole.)
    Impossible {
        /// The step, from 1.
        step: usize,
    },
    /// The model rules out what was measured on the way to the step: its
    /// [likelihood](crate::Transition::evidence) is 0 for all moves that the belief
    /// before allows.
    ImpossibleMove {
        /// The step, from 1.
        step: usize,
    },
    /// The observation is impossible in all states that a pruned routine still
    /// follows, but perhaps not in one that it has dropped.
    Pruned {
        /// The step, from 1.
        step: usize,
    },
    /// The likelihood could not be had.
    Likelihood {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: LikelihoodError,
    },
    /// The control is not one that the transition operator knows.
    Control {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// The transition operator gave a value that is no probability: it does
    /// not keep its contract.
    Predicted {
        /// The step, from 1.
        step: usize,
        /// The state, from 0.
        state: usize,
        /// What it predicted.
        value: f64,
    },
    /// The log factor of [evidence on a move](crate::Transition::evidence) is not a
    /// number from −1e300 to 1e300.
    EvidenceFactor {
        /// The step, from 1.
        step: usize,
        /// The log factor.
        value: f64,
    },
    /// The control of a step to be simulated is
    /// [evidence on the move](crate::Transition::evidence): what is measured depends on
    /// the states, and cannot be given before they are drawn.
    SimulatedEvidence {
        /// The step, from 1.
        step: usize,
    },
    /// The predictions do not sum to one: the transition operator does not keep
    /// its contract, or its transpose is not that of it.
    PredictedSum {
        /// The step, from 1.
        step: usize,
        /// What they sum to.
        sum: f64,
    },
    /// The filter has taken as many steps as a snapshot can count: 2^53, or less
    /// where a `usize` has 32 bits.
    TooMany {
        /// Steps taken.
        steps: usize,
    },
    /// A batch has not as many controls as observations.
    ControlCount {
        /// Controls given.
        controls: usize,
        /// Observations given.
        observations: usize,
    },
    /// A snapshot or a belief is of another model.
    StateCount {
        /// "snapshot" or "belief".
        what: &'static str,
        /// Its states.
        found: usize,
        /// States of the model.
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

/// Which of many sequences failed, and why.
#[derive(Debug, Clone)]
pub struct SequenceError {
    /// Its index, from 0.
    pub sequence: usize,
    /// What was wrong, with the step.
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

/// Why a model could not be learned.
#[derive(Debug)]
#[non_exhaustive]
pub enum LearnError {
    /// There is no sequence to learn from: none was given, or each failed.
    Nothing {
        /// How many were given.
        sequences: usize,
        /// The first that failed.
        first: Option<SequenceError>,
    },
    /// A sequence (or labelled drive) is not valid.
    Sequence(SequenceError),
    /// A number of [`LearningOptions`](crate::inference::LearningOptions) is NaN, negative or infinite.
    Parameter {
        /// Which one.
        what: &'static str,
        /// What was found.
        value: f64,
    },
    /// A labelled drive has not a state for each observation.
    Length {
        /// The drive, from 0.
        drive: usize,
        /// Its states.
        states: usize,
        /// Its observations.
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
        /// How many states there are.
        states: usize,
    },
    /// A labelled drive starts where the prior rules it out.
    Start {
        /// The drive, from 0.
        drive: usize,
        /// Where it starts.
        state: usize,
    },
    /// A labelled drive makes a move that the transition operator forbids.
    Forbidden {
        /// The drive, from 0.
        drive: usize,
        /// The step that the move leads to.
        step: usize,
        /// The state that is left.
        from: usize,
        /// The state that is reached.
        to: usize,
    },
    /// A labelled drive has an observation that the sensor rules out there.
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
    /// The parts estimated do not fit together.
    Hmm(HmmError),
    /// The objective fell by more than rounding explains: a part does not
    /// maximise what it is given.
    Fell {
        /// Which one, from 1.
        iteration: usize,
        /// The objective before.
        before: f64,
        /// The objective after.
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
