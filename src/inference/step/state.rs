//! State of a filter as plain data, and the scratch memory of its steps.
//!
//! A step reads the state, computes into scratch memory, and is committed by swapping buffers. An
//! error before the commit leaves the state as it was, and nothing is copied or allocated. Between
//! steps the belief keeps the invariant of its form ([`limits`](wayfix_kernels::limits)): every possible
//! state is above 0 with all its digits, or the belief has logarithms too. The recursion is that of
//! section 2 of the [formulas](crate::guide::formulas).

use std::mem;

use super::Step;
use super::in_logs::BeliefRef;
use crate::error::InferenceError;
use crate::likelihood::{Likelihood, Scratch};
use crate::transition::{Transition, buffers};
use wayfix_kernels::limits::LIFTED_STEPS;
use wayfix_kernels::{self as kernels, Aligned};

/// Largest number of steps of a filter or snapshot: an `f64` can count them.
pub const MOST_STEPS: usize = if usize::BITS > 53 { (1_u64 << 53) as usize } else { usize::MAX };

/// Returns the number of the step that follows `steps` steps.
pub(crate) fn next_step(steps: usize) -> Result<usize, InferenceError> {
    if steps < MOST_STEPS { Ok(steps + 1) } else { Err(InferenceError::TooMany { steps }) }
}

/// Compensated sum of many logarithms (Neumaier 1974), so that a million steps do not drift.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LogSum {
    pub(crate) sum: f64,
    pub(crate) lost: f64,
}

impl LogSum {
    #[inline]
    #[doc(hidden)]
    pub fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        // Neumaier: with the larger operand first, this difference is exactly the rounding error
        // of the sum (Dekker's fast two-sum).
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// Returns the sum with its compensation cleared if it is infinite: that is NaN and unused.
    pub(crate) fn known(self) -> Self {
        if self.sum.is_finite() { self } else { Self { sum: self.sum, lost: 0.0 } }
    }

    /// Returns true if sum and compensation together are finite. Either may be damaged.
    pub(crate) fn is_finite(self) -> bool {
        self.sum.is_finite() && (self.sum + self.lost).is_finite()
    }

    #[doc(hidden)]
    pub fn value(self) -> f64 {
        // An infinite sum has no meaningful compensation.
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}

/// State of a filter after k steps: plain data that can be kept, compared, sent elsewhere and
/// restored. A [`Filter`](crate::Filter) dereferences to its state.
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
/// let mut filter = hmm.filter();
/// filter.step(&[0.9, 0.2])?;
/// let snapshot = filter.snapshot();
/// filter.step(&[0.1, 0.8])?;
/// filter.restore(&snapshot)?;
/// assert_eq!(filter.snapshot(), snapshot);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, PartialEq)]
pub struct FilterSnapshot {
    pub(crate) steps: usize,
    pub(crate) steps_in_logs: usize,
    pub(crate) belief: Aligned,
    /// Logarithms of the belief if it has values outside the range of `f64`, else empty. The state
    /// of a running filter keeps capacity for n of them.
    pub(crate) logs: Vec<f64>,
    pub(crate) log_likelihood: LogSum,
}

impl FilterSnapshot {
    /// Creates the state before any step, with the memory that a running filter needs.
    pub(crate) fn start(belief: &[f64]) -> Self {
        let (mut aligned, logs) =
            (Aligned::new(belief.len(), 0.0), Vec::with_capacity(belief.len()));
        aligned.copy_from_slice(belief);
        let log_likelihood = LogSum::default();
        Self { steps: 0, steps_in_logs: 0, belief: aligned, logs, log_likelihood }
    }

    /// Overwrites the state, and keeps all memory for later steps.
    pub(crate) fn copy(&mut self, other: &Self) {
        (self.steps, self.steps_in_logs) = (other.steps, other.steps_in_logs);
        self.log_likelihood = other.log_likelihood;
        if self.belief.len() == other.belief.len() {
            self.belief.copy_from_slice(&other.belief);
        } else {
            self.belief = Aligned::from(other.belief.to_vec());
        }
        self.logs.clone_from(&other.logs);
    }

    /// Replaces the belief by one over the same number of states.
    pub(crate) fn relocate(&mut self, belief: &[f64]) {
        self.belief.copy_from_slice(belief);
        self.logs.clear();
    }

    /// Goes back to the prior.
    pub(crate) fn restart(&mut self, prior: &[f64]) {
        self.relocate(prior);
        (self.steps, self.steps_in_logs, self.log_likelihood) = (0, 0, LogSum::default());
    }

    pub(crate) fn held(&self) -> BeliefRef<'_> {
        let logs = Some(&self.logs[..]).filter(|logs| !logs.is_empty());
        BeliefRef { linear: &self.belief, logs }
    }

    /// Takes a step with an observation.
    pub(crate) fn advance<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        observation: &B::Observation,
        scratch: &mut StepScratch,
    ) -> Result<StepOutcome, InferenceError> {
        let outcome = step.advance(observation, self.held(), scratch, None)?;
        self.commit(step.number, &outcome, scratch);
        Ok(outcome)
    }

    /// Applies the outcome of a step. Nothing before this call changes the state.
    pub(crate) fn commit(
        &mut self,
        number: usize,
        outcome: &StepOutcome,
        scratch: &mut StepScratch,
    ) {
        let StepScratch { lifted, output, .. } = scratch;
        // The buffers swapped out hold old values, which is harmless: a step writes each output
        // before it reads it.
        match outcome.form {
            // A plain step normalises in place and lifts nothing: `lifted.values` still belong to
            // the previous belief.
            BeliefForm::Plain { tiny } => {
                mem::swap(&mut self.belief, &mut output.lifted);
                (lifted.valid, lifted.tiny) = (false, tiny);
            }
            BeliefForm::Lifted { tiny } => {
                mem::swap(&mut self.belief, &mut output.after);
                mem::swap(&mut lifted.values, &mut output.lifted);
                (lifted.valid, lifted.tiny) = (true, tiny);
            }
            BeliefForm::Other => {
                mem::swap(&mut self.belief, &mut output.after);
                lifted.follow(&self.belief);
            }
        }
        lifted.more = lifted.more.saturating_sub(1);
        // Logarithms are kept only as long as some state needs them.
        if outcome.in_logs {
            mem::swap(&mut self.logs, &mut output.logs);
            // The swap brought back an empty vector unless the last belief had logarithms too. Its
            // capacity is n, so that this does not allocate.
            output.logs.resize(self.logs.len(), 0.0);
        } else {
            self.logs.clear();
        }
        self.steps = number;
        self.steps_in_logs = self.steps_in_logs.saturating_add(usize::from(outcome.by_logs));
        self.log_likelihood.add(outcome.log);
    }
}

/// Scratch memory of steps, allocated once. If the belief is changed from outside, [`LiftedBelief`]
/// has to [follow](LiftedBelief::follow).
#[derive(Debug, Clone)]
pub(crate) struct StepScratch {
    pub(crate) lifted: LiftedBelief,
    pub(crate) output: StepOutput,
    pub(crate) work: Workspace,
}

impl StepScratch {
    pub(crate) fn new(belief: &[f64]) -> Self {
        let n = belief.len();
        // Fresh zeros instead of clones: the system provides zeroed pages lazily, on first write.
        let zeros = || Aligned::new(n, 0.0);
        // All memory is allocated now: the first step in logarithms may come late in a drive, and
        // must not allocate either.
        let tiny = kernels::any_tiny(belief);
        let lifted = LiftedBelief { values: zeros(), valid: false, tiny, more: 0 };
        // Products in logarithms use buffers of the thread.
        buffers::reserve_two(n);
        let (predicted, logs) = (vec![0.0; n], vec![0.0; n]);
        let output = StepOutput { predicted, after: zeros(), lifted: zeros(), logs };
        Self { lifted, output, work: Workspace::new(n) }
    }
}

/// Memory for the values of a sensor, and for scaled likelihoods or logarithms.
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace {
    pub(crate) scratch: Scratch,
    pub(crate) values: Vec<f64>,
}

impl Workspace {
    pub(crate) fn new(states: usize) -> Self {
        Self { scratch: Scratch::default(), values: vec![0.0; states] }
    }
}

/// Belief before a step, as the operand of the product: lifted by [`LIFT`](wayfix_kernels::limits::LIFT),
/// unless neither it nor the matrix has values small enough for that to matter.
#[derive(Debug, Clone)]
pub(crate) struct LiftedBelief {
    values: Aligned,
    /// True if `values` are those of the present belief.
    valid: bool,
    /// True if the belief has a [tiny](wayfix_kernels::limits::is_tiny) value.
    tiny: bool,
    /// Number of steps that are still to be lifted because of an earlier small result.
    more: u32,
}

impl LiftedBelief {
    /// Switches to another belief.
    pub(crate) fn follow(&mut self, belief: &[f64]) {
        (self.valid, self.tiny) = (false, kernels::any_tiny(belief));
    }

    /// Returns true if products need the lifted belief.
    pub(crate) fn is_needed(&self) -> bool {
        self.tiny || self.more > 0
    }

    /// Lifts the next steps, after a result that was too small.
    pub(crate) fn lift_for_some_steps(&mut self) {
        // Small results tend to recur, and a plain step that fails costs as much as one that
        // succeeds.
        self.more = LIFTED_STEPS;
    }

    /// Returns the lifted belief.
    pub(crate) fn values(&mut self, belief: &[f64]) -> &[f64] {
        // Exact even for values below 2^-1022: multiplying by a power of two changes only the
        // exponent.
        if !self.valid {
            kernels::lift(belief, &mut self.values);
            self.valid = true;
        }
        &self.values
    }
}

/// Form in which a step leaves its result.
#[derive(Debug, Clone, Copy)]
pub(crate) enum BeliefForm {
    /// The belief is in [`StepOutput::lifted`], not lifted.
    Plain { tiny: bool },
    /// The belief is in [`StepOutput::after`], and lifted in [`StepOutput::lifted`].
    Lifted { tiny: bool },
    /// The belief is in [`StepOutput::after`] alone.
    Other,
}

/// Output buffers of a step.
#[derive(Debug, Clone)]
pub(crate) struct StepOutput {
    /// Lifted prediction. Sums to [`LIFT`](wayfix_kernels::limits::LIFT) up to rounding and evidence on the
    /// move; not written by steps that don't need it.
    pub(crate) predicted: Vec<f64>,
    /// Belief after the observation.
    pub(crate) after: Aligned,
    /// Belief after the observation, in the form that [`BeliefForm`] tells.
    pub(crate) lifted: Aligned,
    /// Logarithms of the belief, if [`StepOutcome::in_logs`].
    pub(crate) logs: Vec<f64>,
}

/// Outcome of a step, apart from its [`StepOutput`].
pub(crate) struct StepOutcome {
    /// ln N, the log-likelihood of the observation and of evidence on the move.
    pub(crate) log: f64,
    /// N itself if the step used the likelihoods as the sensor gave them, else 0.
    pub(crate) normalizer: f64,
    /// True if the step was taken in logarithms.
    pub(crate) by_logs: bool,
    /// True if the belief has to be kept in logarithms too.
    pub(crate) in_logs: bool,
    /// Form and place of the belief.
    pub(crate) form: BeliefForm,
}

impl StepOutcome {
    /// Creates the outcome of a step in linear space.
    pub(crate) fn linear(log: f64, normalizer: f64, form: BeliefForm) -> Self {
        Self { log, normalizer, by_logs: false, in_logs: false, form }
    }
}
