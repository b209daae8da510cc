//! What can be wrong with sequences, and with what is learned from them.

use std::error::Error as StdError;

use thiserror::Error;

use super::{BeliefError, HmmError, LikelihoodError, TransitionError};

/// Why inference stopped at a step.
///
/// Steps are counted from 1: step k is about observation `y_k`, which is
/// `ys[k - 1]` of a batch.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum InferenceError {
    /// The model rules the observation out: its probability given all before
    /// it is 0. (After a sensor with [rounded tails](crate::RoundedTails) that
    /// counts as 0, too, which was below 2.2e-308 of the whole.)
    #[error("the observation of step {step} is impossible under the model")]
    Impossible {
        /// The step, from 1.
        step: usize,
    },
    /// The observation is impossible in all states that a pruned routine still
    /// follows, but perhaps not in one that it has dropped.
    #[error("the observation of step {step} is impossible in all states that were not pruned")]
    Pruned {
        /// The step, from 1.
        step: usize,
    },
    /// The likelihood could not be had.
    #[error("step {step} has no valid likelihood")]
    Likelihood {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: LikelihoodError,
    },
    /// The control is not one that the transition operator knows.
    #[error("step {step} has no valid control")]
    Control {
        /// The step, from 1.
        step: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// The transition operator gave a value that is no probability: it does
    /// not keep its contract.
    #[error(
        "at step {step} the transition operator predicts {value} for state {state}, expected a probability"
    )]
    Predicted {
        /// The step, from 1.
        step: usize,
        /// The state, from 0.
        state: usize,
        /// What it predicted.
        value: f64,
    },
    /// The predictions do not sum to one: the transition operator does not keep
    /// its contract, or its transpose is not that of it.
    #[error(
        "at step {step} the transition operator gives probabilities that sum to {sum}, expected 1; do its products and entries belong together?"
    )]
    PredictedSum {
        /// The step, from 1.
        step: usize,
        /// What they sum to.
        sum: f64,
    },
    /// The filter has taken as many steps as a snapshot can count: 2^53, or less
    /// where a `usize` has 32 bits.
    #[error("{steps} steps have been taken, the most that can be counted")]
    TooMany {
        /// Steps taken.
        steps: usize,
    },
    /// A batch has not as many controls as observations.
    #[error("{controls} controls for {observations} observations, expected one each")]
    ControlCount {
        /// Controls given.
        controls: usize,
        /// Observations given.
        observations: usize,
    },
    /// A snapshot or a belief is of another model.
    #[error("the {what} has {found} states, expected {expected} as the model")]
    StateCount {
        /// "snapshot" or "belief".
        what: &'static str,
        /// Its states.
        found: usize,
        /// States of the model.
        expected: usize,
    },
}

/// Which of many sequences failed, and why.
#[derive(Debug, Error)]
#[error("sequence {sequence} failed")]
pub struct SequenceError {
    /// Its index, from 0.
    pub sequence: usize,
    /// What was wrong, with the step.
    pub source: InferenceError,
}

/// Why a model could not be learned.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LearnError {
    /// There is no sequence to learn from: none was given, or each failed.
    #[error("there is no sequence to learn from, of {sequences} given")]
    Nothing {
        /// How many were given.
        sequences: usize,
        /// The first that failed.
        #[source]
        first: Option<SequenceError>,
    },
    /// A sequence (or labelled drive) is not valid.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A number of [`Learning`](crate::Learning) is NaN, negative or infinite.
    #[error("the {what} is {value}, expected a finite value of at least 0")]
    Parameter {
        /// Which one.
        what: &'static str,
        /// What was found.
        value: f64,
    },
    /// A labelled drive has not a state for each observation.
    #[error("drive {drive} has {states} states for {observations} observations, expected one each")]
    Length {
        /// The drive, from 0.
        drive: usize,
        /// Its states.
        states: usize,
        /// Its observations.
        observations: usize,
    },
    /// A labelled drive is in a state that does not exist.
    #[error("drive {drive} is in state {state} at step {step}, expected 0 to {}", states - 1)]
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
    #[error("drive {drive} starts in state {state}, which the prior rules out")]
    Start {
        /// The drive, from 0.
        drive: usize,
        /// Where it starts.
        state: usize,
    },
    /// A labelled drive makes a move that the transition operator forbids.
    #[error(
        "drive {drive} moves from state {from} to state {to} at step {step}, which the transition operator forbids"
    )]
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
    #[error(
        "drive {drive} is in state {state} at step {step}, where the sensor rules its observation out"
    )]
    Sighting {
        /// The drive, from 0.
        drive: usize,
        /// The step.
        step: usize,
        /// The state.
        state: usize,
    },
    /// The prior could not be estimated.
    #[error("the prior cannot be estimated")]
    Prior(#[from] BeliefError),
    /// The transition operator could not be estimated.
    #[error("the transition operator cannot be estimated")]
    Transition(#[from] TransitionError),
    /// The sensor could not be estimated.
    #[error("the sensor cannot be estimated")]
    Likelihood(#[source] Box<dyn StdError + Send + Sync>),
    /// The parts estimated do not fit together.
    #[error(transparent)]
    Hmm(#[from] HmmError),
    /// The objective fell by more than rounding explains: a part does not
    /// maximise what it is given.
    #[error("re-estimation {iteration} makes the objective fall from {before} to {after}")]
    Fell {
        /// Which one, from 1.
        iteration: usize,
        /// The objective before.
        before: f64,
        /// The objective after.
        after: f64,
    },
}
