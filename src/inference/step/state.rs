//! State of a filter as plain data, and the scratch memory of its steps.
//!
//! A step reads the state, computes into scratch memory, and is committed by swapping buffers. An
//! error before the commit leaves the state as it was, and nothing is copied or allocated. Between
//! steps the belief keeps the invariant of its form ([`limits`](wayfix_kernels::limits)): every
//! possible state is above 0 with all its digits, or the belief has logarithms too, because it has
//! values that linear space cannot hold.

use std::f64::consts::LN_2;
use std::mem;

use crate::belief::{Belief, BeliefView};
use crate::error::HmmError;
use crate::likelihood::Scratch;
use crate::transition::{TransitionEntries, buffers};
use wayfix_kernels as kernels;
use wayfix_kernels::limits::{LIFT, LIFTED_STEPS};
use wayfix_kernels::{Aligned, limits};

/// Largest number of steps of a filter or snapshot: an `f64` can count them.
pub const MOST_STEPS: usize = if usize::BITS > 53 { (1_u64 << 53) as usize } else { usize::MAX };

/// Returns the number of the step that follows `steps` steps.
pub(crate) fn next_step(steps: usize) -> Result<usize, HmmError> {
    if steps < MOST_STEPS { Ok(steps + 1) } else { Err(HmmError::TooMany { steps }) }
}

/// Compensated sum of many logarithms (Neumaier 1974), so that a million steps do not drift.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LogSum {
    pub(crate) sum: f64,
    pub(crate) compensation: f64,
}

impl LogSum {
    #[inline]
    #[doc(hidden)]
    pub fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        // Neumaier: with the larger operand first, this difference is exactly the rounding error
        // of the sum (Dekker's fast two-sum).
        self.compensation += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// Returns the sum with its compensation cleared if it is infinite: that is NaN and unused.
    pub(crate) fn known(self) -> Self {
        if self.sum.is_finite() { self } else { Self { sum: self.sum, compensation: 0.0 } }
    }

    /// Returns true if sum and compensation together are finite. Either may be damaged.
    pub(crate) fn is_finite(self) -> bool {
        self.sum.is_finite() && (self.sum + self.compensation).is_finite()
    }

    #[doc(hidden)]
    #[must_use]
    pub fn value(self) -> f64 {
        // An infinite sum has no meaningful compensation.
        if self.sum.is_finite() { self.sum + self.compensation } else { self.sum }
    }
}

/// State of a filter after k steps: plain data that can be kept, compared, sent elsewhere and
/// restored. The state of a [`Filter`](crate::Filter).
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
    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Number of these steps taken in logarithms, which is several times slower: the belief
    /// before or after was outside the range of `f64`, or the observation contradicted the
    /// prediction too strongly. A prediction alone and an update alone count as one each.
    ///
    /// If there are many, and the tails of the model are not credible anyway, [rounded
    /// tails](crate::Hmm::with_rounded_tails) are faster.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let stay = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
    /// let hmm = Hmm::new(prior, stay, LikelihoodVector::log(2))?;
    /// let mut filter = hmm.filter();
    /// filter.step(&[0.0, -10.0])?;
    /// assert_eq!(filter.steps_in_logs(), 0);
    /// filter.step(&[0.0, -1000.0])?; // e^-1010 is beyond doubles
    /// filter.step(&[0.0, -10.0])?;
    /// assert_eq!(filter.steps_in_logs(), 2);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }

    /// Present belief: p(X_k | y_1 … y_k) after an update, the predicted one after a prediction,
    /// the prior before any step.
    #[must_use]
    pub fn belief(&self) -> BeliefView<'_> {
        Belief::view(&self.belief)
    }

    /// Log-likelihood ln p(y_1 … y_k) of the observations so far, and of evidence on moves.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }

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

    pub(crate) fn belief_ref(&self) -> BeliefRef<'_> {
        let logs = Some(&self.logs[..]).filter(|logs| !logs.is_empty());
        BeliefRef { linear: &self.belief, logs }
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
                mem::swap(&mut self.belief, &mut output.updated);
                (lifted.valid, lifted.tiny) = (false, tiny);
            }
            BeliefForm::Lifted { tiny } => {
                mem::swap(&mut self.belief, &mut output.after);
                mem::swap(&mut lifted.values, &mut output.updated);
                (lifted.valid, lifted.tiny) = (true, tiny);
            }
            BeliefForm::Other => {
                mem::swap(&mut self.belief, &mut output.after);
                lifted.reset(&self.belief);
            }
        }
        lifted.more = lifted.more.saturating_sub(1);
        // Logarithms are kept only as long as some state needs them.
        if outcome.result_in_logs {
            mem::swap(&mut self.logs, &mut output.logs);
            // The swap brought back an empty vector unless the last belief had logarithms too. Its
            // capacity is n, so this does not allocate.
            output.logs.resize(self.logs.len(), 0.0);
        } else {
            self.logs.clear();
        }
        self.steps = number;
        self.steps_in_logs = self.steps_in_logs.saturating_add(usize::from(outcome.taken_in_logs));
        self.log_likelihood.add(outcome.log);
    }
}

/// Scratch memory of steps, allocated once. If the belief is changed from outside, [`LiftedBelief`]
/// has to [reset](LiftedBelief::reset).
#[derive(Debug, Clone)]
pub(crate) struct StepScratch {
    pub(crate) lifted: LiftedBelief,
    pub(crate) output: StepOutput,
    pub(crate) sensor: SensorScratch,
}

impl StepScratch {
    pub(crate) fn new(belief: &[f64]) -> Self {
        let n = belief.len();
        // Fresh zeros instead of clones: the system provides zeroed pages lazily, on first write.
        let zeros = || Aligned::new(n, 0.0);
        // All memory is allocated now: the first step in logarithms may come late, and must not
        // allocate either.
        let tiny = kernels::any_tiny(belief);
        let lifted = LiftedBelief { values: zeros(), valid: false, tiny, more: 0 };
        // Products in logarithms use buffers of the thread.
        buffers::reserve_two(n);
        let (predicted, logs) = (vec![0.0; n], vec![0.0; n]);
        let output = StepOutput { predicted, after: zeros(), updated: zeros(), logs };
        Self { lifted, output, sensor: SensorScratch::new(n) }
    }
}

/// Memory for the values of a sensor, and for scaled likelihoods or logarithms.
#[derive(Debug, Clone, Default)]
pub(crate) struct SensorScratch {
    pub(crate) scratch: Scratch,
    pub(crate) values: Vec<f64>,
}

impl SensorScratch {
    pub(crate) fn new(states: usize) -> Self {
        Self { scratch: Scratch::default(), values: vec![0.0; states] }
    }
}

/// Belief before a step, as the operand of the product: lifted by
/// [`LIFT`](wayfix_kernels::limits::LIFT), unless neither it nor the matrix has values small enough
/// for that to matter.
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
    pub(crate) fn reset(&mut self, belief: &[f64]) {
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

/// Where a step leaves its result, and in what form.
#[derive(Debug, Clone, Copy)]
pub(crate) enum BeliefForm {
    /// The belief is in [`StepOutput::updated`], not lifted.
    Plain { tiny: bool },
    /// The belief is in [`StepOutput::after`], and lifted in [`StepOutput::updated`].
    Lifted { tiny: bool },
    /// The belief is in [`StepOutput::after`] alone.
    Other,
}

/// Output buffers of a step.
#[derive(Debug, Clone)]
pub(crate) struct StepOutput {
    /// Lifted prediction. Sums to [`LIFT`](wayfix_kernels::limits::LIFT) up to rounding and
    /// evidence on the move; not written by steps that don't need it.
    pub(crate) predicted: Vec<f64>,
    /// Belief after the observation.
    pub(crate) after: Aligned,
    /// Belief after the observation as the update leaves it: lifted, or in plain form without a
    /// lift.
    pub(crate) updated: Aligned,
    /// Logarithms of the belief, if [`StepOutcome::result_in_logs`].
    pub(crate) logs: Vec<f64>,
}

/// Outcome of a step, apart from its [`StepOutput`].
pub(crate) struct StepOutcome {
    /// ln N, the log-likelihood of the observation and of evidence on the move.
    pub(crate) log: f64,
    /// N itself if the step used the likelihoods as the sensor gave them, else 0.
    pub(crate) normalizer: f64,
    /// True if the step was taken in logarithms.
    pub(crate) taken_in_logs: bool,
    /// True if the belief has to be kept in logarithms too.
    pub(crate) result_in_logs: bool,
    /// Form and place of the belief.
    pub(crate) form: BeliefForm,
}

impl StepOutcome {
    /// Creates the outcome of a step in linear space.
    pub(crate) fn linear(log: f64, normalizer: f64, form: BeliefForm) -> Self {
        Self { log, normalizer, taken_in_logs: false, result_in_logs: false, form }
    }
}

/// A distribution, with its logarithms too if it has positive values outside the range of `f64`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BeliefRef<'a> {
    pub(crate) linear: &'a [f64],
    pub(crate) logs: Option<&'a [f64]>,
}

impl BeliefRef<'_> {
    /// Returns the logarithm of one probability.
    #[doc(hidden)]
    pub(crate) fn log(&self, state: usize) -> f64 {
        self.logs.map_or_else(|| self.linear[state].ln(), |logs| logs[state])
    }

    /// Lists the states j that lead into state i, with weights proportional to α(j) A\[i, j\]. If
    /// none has a positive weight, the weights are NaN or all 0. `in_logs` says that the step needs
    /// logarithms.
    pub(crate) fn predecessors<A: TransitionEntries>(
        &self,
        transition: &A,
        control: &A::Control,
        to: usize,
        in_logs: bool,
        predecessors: &mut Vec<(usize, f64)>,
    ) {
        predecessors.clear();
        if !in_logs && self.logs.is_none() {
            let incoming = transition.incoming(control, to);
            predecessors.extend(incoming.map(|(from, p)| (from, self.linear[from] * LIFT * p)));
            let total: f64 = predecessors.iter().map(|way| way.1).sum();
            // All weights are truly 0 if every listed α(j) is. An empty list proves nothing, since
            // entries too small for doubles are not listed in linear form.
            let nothing = || {
                !predecessors.is_empty() && predecessors.iter().all(|way| self.linear[way.0] == 0.0)
            };
            if limits::can_draw(total) || nothing() {
                return;
            }
        }
        // Some or all weights are too small for `f64`. Dividing by the largest, in logarithms,
        // makes it 1; −∞ − −∞ gives the documented NaN.
        predecessors.clear();
        let incoming = transition.incoming_log2(control, to);
        predecessors.extend(incoming.map(|(from, log2)| (from, self.log(from) + log2 * LN_2)));
        let largest = predecessors.iter().map(|way| way.1).fold(f64::NEG_INFINITY, f64::max);
        predecessors.iter_mut().for_each(|way| way.1 = (way.1 - largest).exp());
    }

    /// Writes the logarithms, from either form.
    pub(crate) fn logs_to(&self, out: &mut [f64]) {
        match self.logs {
            Some(logs) => out.copy_from_slice(logs),
            None => out.iter_mut().zip(self.linear).for_each(|(out, p)| *out = p.ln()),
        }
    }
}

/// Returns true if some probability above 0 rounds to 0 in linear space.
pub(crate) fn loses(logs: &[f64], linear: &[f64]) -> bool {
    logs.iter().zip(linear).any(|(log, p)| limits::needs_log(*p, *log))
}

/// Normalises a distribution given by logarithms, and writes it to `linear` too. Returns the
/// logarithm of the sum, or `None` if the sum is 0.
pub(crate) fn normalize_logs(logs: &mut [f64], linear: &mut [f64]) -> Option<f64> {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return None;
    }
    // Log-sum-exp: the largest term is e^0, so the sum is from 1 to n, and small terms round away
    // harmlessly.
    linear.iter_mut().zip(&*logs).for_each(|(out, log)| *out = (log - largest).exp());
    let sum = kernels::sum(linear);
    kernels::normalize(linear, sum);
    let normalizer = largest + sum.ln();
    // Two subtractions: `largest + ln sum` would round at the size of `largest`, whereas the first
    // difference here is small and so nearly exact.
    logs.iter_mut().for_each(|log| *log = (*log - largest) - sum.ln());
    Some(normalizer)
}
