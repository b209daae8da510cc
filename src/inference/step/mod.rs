//! One step of the filter: prediction, update, normaliser (paper eq. 8; section 2 of the
//! [formulas](crate::guide::formulas)).
//!
//! N α' = b ∘ (A α), where A is any linear operator, stored or not. Each step is taken in the
//! cheapest form that keeps every possible state: plain, lifted, or in logarithms. The results
//! themselves show whether a form was sufficient ([`limits`](wayfix_kernels::limits) has the
//! proof). If it was not, time is lost but no digits, because the state has not been touched yet.
//!
//! With evidence on the move, measurements between two steps multiply the entries of A. The
//! prediction then sums to their probability instead of one; linear space is used while that sum
//! is from 2^-100 to 2^7.

pub(crate) mod forward_backward;
pub(crate) mod scores;
pub(crate) mod state;

use self::state::{
    BeliefForm, BeliefRef, LiftedBelief, StepOutcome, StepOutput, StepScratch, loses,
    normalize_logs,
};
use crate::error::HmmError;
use crate::groups::Groups;
use crate::hmm::Hmm;
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::{SparseTransition, Stored, Transition, TransitionEntries};
use wayfix_kernels as kernels;
use wayfix_kernels::limits::LIFT;
use wayfix_kernels::{ForwardStep, ForwardSums, Product, Valid, Watch, limits};

pub(crate) use self::state::SensorScratch;

/// Model, number and control of one step.
pub(crate) struct Step<'m, A: Transition, B> {
    pub(crate) hmm: &'m Hmm<A, B>,
    /// Number of the step, for errors.
    pub(crate) number: usize,
    /// Control, or `None` if the step has no transition.
    pub(crate) control: Option<&'m A::Control>,
}

impl<'m, A: Transition, B: Likelihood> Step<'m, A, B> {
    /// Creates the step that follows `steps` steps. The control is dropped if the step has no
    /// transition: the first, under a prior at the first observation.
    pub(crate) fn after(
        hmm: &'m Hmm<A, B>,
        steps: usize,
        control: &'m A::Control,
    ) -> Result<Self, HmmError> {
        let number = state::next_step(steps)?;
        Ok(Self { hmm, number, control: hmm.prior().moves_at(number).then_some(control) })
    }

    /// Creates step `number` of a sequence.
    pub(crate) fn of<S>(hmm: &'m Hmm<A, B>, sequence: &'m S, number: usize) -> Self
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let control = hmm.prior().moves_at(number).then(|| sequence.control(number));
        Self { hmm, number, control }
    }

    pub(crate) fn check_control(&self, control: &A::Control) -> Result<(), HmmError> {
        let wrap = |cause| HmmError::control(self.number, cause);
        self.hmm.transition().check_control(control).map_err(wrap)
    }

    /// Checks the control, and returns the log factor of the evidence on the move to this step,
    /// if any.
    #[inline]
    pub(crate) fn evidence(&self) -> Result<Option<f64>, HmmError> {
        let Some(control) = self.control else { return Ok(None) };
        self.check_control(control)?;
        match self.hmm.transition().evidence(control) {
            Some(value) if limits::is_log(value) => Ok(Some(value)),
            Some(value) => Err(HmmError::EvidenceFactor { step: self.number, value }),
            None => Ok(None),
        }
    }

    /// Returns the sparse matrix of the step, if it has one and no evidence on the move.
    #[inline]
    pub(crate) fn stored(&self, control: &A::Control) -> Option<&'m SparseTransition> {
        let transition = self.hmm.transition();
        let matrix = transition.stored(control).and_then(Stored::as_sparse)?;
        transition.evidence(control).is_none().then_some(matrix)
    }

    /// Advances from the last belief to the one after the observation. A belief in
    /// [plain](BeliefForm::Plain) form is appended to `rows`, if given, in the pass that normalises
    /// it; a belief in another form is left for the caller to append.
    ///
    /// The step is taken in linear space unless it needs logarithms: the previous belief is in
    /// logarithms, the observation contradicts the prediction by more than 2^32 (number 2 in
    /// [`limits`](wayfix_kernels::limits)), or a possible state would become 0. The last reason
    /// does not apply to a model with rounded tails.
    pub(crate) fn advance(
        &self,
        observation: &B::Observation,
        before: BeliefRef<'_>,
        scratch: &mut StepScratch,
        mut rows: Option<&mut Vec<f64>>,
    ) -> Result<StepOutcome, HmmError> {
        let StepScratch { lifted, output, sensor: SensorScratch { scratch, values } } = scratch;
        if let Some(found) = self.hmm.likelihood().by_groups(observation, scratch)
            && let Ok((diagonal, groups)) = found
            && diagonal.check_shape(groups.count()).is_ok()
        {
            // A shortcut: it only has to be right where it succeeds. A failing sensor, or a step
            // that cannot be plain, falls through to the general code below, which reports errors.
            let evidence = self.evidence()?;
            let likelihoods = (&diagonal, groups);
            let (rows, has_evidence) = (rows.as_deref_mut(), evidence.is_some());
            let advanced =
                self.advance_by_blocks(likelihoods, has_evidence, before, lifted, output, rows);
            if let Some((normalizer, form)) = advanced {
                let log = normalizer.ln() + diagonal.log_factor + evidence.unwrap_or(0.0);
                return Ok(StepOutcome::linear(log, normalizer, form));
            }
        }
        let wrap = |cause| HmmError::likelihood(self.number, cause);
        // Borrowed: copying a diagonal that was just written costs as much as a few rows of A.
        let found = self.hmm.likelihood().diagonal(observation, scratch);
        let diagonal = match found {
            Ok(ref diagonal) => diagonal,
            Err(source) => return Err(wrap(source)),
        };
        let states = before.linear.len();
        diagonal.check_shape(states).map_err(wrap)?;
        let (evidence, tails_rounded) = (self.evidence()?, self.hmm.rounds_tails());
        let log_factors = evidence.map_or(diagonal.log_factor, |log| log + diagonal.log_factor);
        let linear = diagonal.linear_values().map(|linear| Likelihoods {
            diagonal,
            values: linear,
            scaled: false,
            tails_rounded,
        });
        // First attempt: likelihoods as the sensor gave them. The update itself checks that they
        // are valid, which saves a separate pass over them.
        if let (None, None, Some(linear)) = (before.logs, evidence, linear)
            && let Some((n, form)) = self.advance_in_doubles(
                linear,
                before.linear,
                false,
                lifted,
                output,
                rows.as_deref_mut(),
            )?
        {
            return Ok(StepOutcome::linear(n.ln() + log_factors, n, form));
        }
        let largest = diagonal.check(states).map_err(wrap)?;
        // Second attempt. Without evidence, the unscaled likelihoods have just failed above (or the
        // step is in logarithms anyway), so they are scaled; with evidence they are still to be
        // tried.
        let unscaled = linear.filter(|_| evidence.is_some() && limits::is_unscaled(largest));
        let (likelihoods, log_scale) = if let Some(likelihoods) = unscaled {
            (likelihoods, 0.0)
        } else {
            let log_scale = self.scale(diagonal, largest, values)?;
            (Likelihoods { diagonal, values, scaled: true, tails_rounded }, log_scale)
        };
        if before.logs.is_none()
            && !(evidence.is_some() && self.needs_logs())
            && let Some((n, form)) = self.advance_in_doubles(
                likelihoods,
                before.linear,
                evidence.is_some(),
                lifted,
                output,
                rows,
            )?
        {
            // The backward pass asks the sensor again and gets unscaled values, which do not belong
            // to the N of scaled values. A normaliser of 0 tells it so.
            let normalizer = if likelihoods.scaled { 0.0 } else { n };
            return Ok(StepOutcome::linear(n.ln() + log_scale + log_factors, normalizer, form));
        }
        // Last resort, starting over from `before`: whatever the attempts left in `output` is
        // overwritten.
        self.predict_in_logs(before, evidence, output, values)?;
        let advanced = self.update_in_logs(diagonal, log_scale, output)?;
        let log = evidence.map_or(advanced.log, |log_factor| advanced.log + log_factor);
        Ok(StepOutcome { log, ..advanced })
    }

    /// Takes the step in linear space. Returns the normaliser N, which includes the probability of
    /// evidence on the move, or `None` if the results leave the range of `f64`, or if the
    /// likelihoods are invalid or need scaling.
    #[inline]
    fn advance_in_doubles(
        &self,
        likelihoods: Likelihoods<'_>,
        belief: &[f64],
        has_evidence: bool,
        lifted: &mut LiftedBelief,
        output: &mut StepOutput,
        rows: Option<&mut Vec<f64>>,
    ) -> Result<Option<(f64, BeliefForm)>, HmmError> {
        let StepOutput { predicted, after, updated: out, .. } = output;
        // With evidence, `stored` returns `None`, hence no plain step: entries then lack a known
        // lower bound.
        let matrix = self.control.and_then(|control| self.stored(control));
        // Plain if no belief is tiny (2^-900) and no entry small (2^-100), so that every term of
        // A α is 0 or at least 2^-1000 ("A plain step" in `limits`).
        if !lifted.is_needed()
            && let Some(matrix) = matrix
            && matrix.no_tiny_entries
        {
            let product = Product::Sparse { matrix: &matrix.sliced_rows, x: belief };
            let updated = kernels::forward_step(likelihoods.update(product, 1.0, out));
            if !is_within_range(&updated, 1.0) {
                return Ok(None);
            }
            if !updated.small {
                let tiny = kernels::normalize_in_place(out, updated.products, rows);
                return Ok(Some((updated.products, BeliefForm::Plain { tiny })));
            }
            // A result below 2^-1000 may lack digits that the lifted step keeps.
            lifted.lift_for_some_steps();
        }
        let lifted = lifted.values(belief);
        let prediction = match (matrix, self.control) {
            (Some(matrix), _) => Product::Sparse { matrix: &matrix.sliced_rows, x: lifted },
            (None, None) => Product::Computed(lifted),
            (None, Some(control)) => {
                self.hmm.transition().apply(control, lifted, predicted);
                Product::Computed(predicted)
            }
        };
        let updated = kernels::forward_step(likelihoods.update(prediction, LIFT, out));
        // A matrix was checked at construction; any other operator is checked by its sum, which a
        // NaN or infinite value makes NaN or infinite. Only then do `evidence_sum` and
        // `check_prediction` search for the state at fault, so that valid steps don't pay for it.
        let sum = updated.predicted / LIFT;
        if has_evidence {
            if updated.negative_predicted || !limits::is_evidence_sum(sum) {
                self.evidence_sum(predicted)?;
                return Ok(None);
            }
        } else if matrix.is_none()
            && self.control.is_some()
            && (updated.negative_predicted || !limits::is_one(sum))
        {
            self.check_prediction(predicted)?;
        }
        // With evidence, N is compared with the sum of the prediction in place of one: only a
        // contradiction between the observation and what the evidence has left counts.
        if !is_within_range(&updated, if has_evidence { updated.predicted } else { LIFT }) {
            return Ok(None);
        }
        let tiny = kernels::normalize_and_lift(out, after, updated.products);
        // `small`: a lifted product fell below 1 ("A lifted step" in `limits`). A possible state
        // may have been lost; one more pass decides.
        if updated.small && self.loses_states(likelihoods, lifted, output) {
            return Ok(None);
        }
        Ok(Some((updated.products / LIFT, BeliefForm::Lifted { tiny })))
    }

    /// Scales likelihoods so that the largest is one, and returns the logarithm of the divisor.
    fn scale(
        &self,
        diagonal: &Diagonal<'_>,
        largest: f64,
        values: &mut [f64],
    ) -> Result<f64, HmmError> {
        let impossible = Err(HmmError::Impossible { step: self.number });
        match diagonal.values {
            Values::Linear(_) | Values::Checked { .. } if largest == 0.0 => impossible,
            Values::Linear(linear) | Values::Checked { linear, .. } => {
                values.iter_mut().zip(linear).for_each(|(out, b)| *out = b / largest);
                Ok(largest.ln())
            }
            Values::Log(_) if largest == f64::NEG_INFINITY => impossible,
            // The largest is subtracted first: exp(ln b − ln c) is at most 1 and cannot overflow.
            Values::Log(logs) => {
                values.iter_mut().zip(logs).for_each(|(out, log)| *out = log - largest);
                kernels::exp_in_place(values);
                Ok(largest)
            }
        }
    }
}

/// Likelihoods proportional to those of a diagonal.
#[derive(Clone, Copy)]
struct Likelihoods<'a> {
    diagonal: &'a Diagonal<'a>,
    values: &'a [f64],
    /// True if they were scaled, so that a 0 among them may stand for a positive value.
    scaled: bool,
    /// True if the model rounds tails.
    tails_rounded: bool,
}

impl<'a> Likelihoods<'a> {
    fn update(self, prediction: Product<'a>, lift: f64, out: &'a mut [f64]) -> ForwardStep<'a> {
        // Without a lift, small results lose digits; so a plain step is watched even in a model
        // with rounded tails. Scaled likelihoods may have become 0, and then the product b p no
        // longer shows the loss; the prediction p does.
        let watch = match self {
            _ if lift > 1.0 && self.tails_rounded => Watch::Nothing,
            Self { scaled: true, .. } => Watch::Predictions,
            Self { scaled: false, .. } => Watch::Products,
        };
        ForwardStep { prediction, lift, likelihoods: self.values, watch, out }
    }
}

/// Returns true if the results of an update are within the range of `f64` and the likelihoods
/// are valid and within the unscaled range (numbers 1 and 2 in [`limits`](wayfix_kernels::limits)).
#[inline]
fn is_within_range(updated: &ForwardSums, lift: f64) -> bool {
    let ForwardSums { products, predicted, largest_likelihood, .. } = *updated;
    !updated.negative_likelihood
        && limits::linear_holds(products, predicted, largest_likelihood, lift)
}

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Returns true if the operator reports products of this step outside the range of `f64`.
    pub(crate) fn needs_logs(&self) -> bool {
        self.control.is_some_and(|control| self.hmm.transition().needs_logs(control))
    }

    /// Returns true if the operator reports single entries of this step outside the range of `f64`.
    pub(crate) fn entries_need_logs(&self) -> bool
    where
        A: TransitionEntries,
    {
        self.control.is_some_and(|control| self.hmm.transition().entries_need_logs(control))
    }

    /// Returns the checked diagonal of an observation and its largest value.
    pub(crate) fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), HmmError> {
        let wrap = |cause| HmmError::likelihood(self.number, cause);
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).map_err(wrap)?;
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        Ok((diagonal, largest))
    }

    /// Computes `after = A before`, or a copy without a transition, for vectors of any scale. The
    /// control must have been checked.
    pub(crate) fn predict(&self, before: &[f64], after: &mut [f64]) {
        match self.control {
            Some(control) => self.hmm.transition().apply(control, before, after),
            None => after.copy_from_slice(before),
        }
    }

    /// Takes the step without an observation. Its log-likelihood is that of evidence on the move,
    /// or 0 without evidence.
    pub(crate) fn advance_unseen(
        &self,
        before: BeliefRef<'_>,
        scratch: &mut StepScratch,
    ) -> Result<StepOutcome, HmmError> {
        let StepScratch { lifted, output, sensor } = scratch;
        let (evidence, rounds_tails) = (self.evidence()?, self.hmm.rounds_tails());
        let mut taken_in_logs = before.logs.is_some() || (evidence.is_some() && self.needs_logs());
        // ln p(u), before the log factor of the evidence is added.
        let mut log = 0.0;
        if !taken_in_logs {
            // Always lifted: no update follows that would notice small products.
            self.predict(lifted.values(before.linear), &mut output.after);
            let sum = match evidence {
                None => Some(self.check_prediction(&output.after)?),
                Some(_) => self.evidence_sum(&output.after)?,
            };
            match sum {
                Some(sum) => {
                    let loses = output.after.iter().any(|p| limits::rounds_to_zero(*p, sum));
                    // Without evidence the sum is one up to rounding, which must not accumulate
                    // over steps.
                    kernels::normalize(&mut output.after, sum);
                    (taken_in_logs, log) = (loses && !rounds_tails, (sum / LIFT).ln());
                }
                None => taken_in_logs = true,
            }
        }
        // Starts over from the previous belief; the linear result is overwritten.
        let mut result_in_logs = false;
        if taken_in_logs {
            self.predict_in_logs(before, evidence, output, &mut sensor.values)?;
            log = normalize_logs(&mut output.logs, &mut output.after).unwrap_or(f64::NEG_INFINITY);
            result_in_logs = !rounds_tails && loses(&output.logs, &output.after);
        }
        let log = evidence.map_or(0.0, |log_factor| log + log_factor);
        Ok(StepOutcome {
            log,
            normalizer: 0.0,
            taken_in_logs,
            result_in_logs,
            form: BeliefForm::Other,
        })
    }

    /// Checks that a lifted prediction is a distribution, since the operator may be the user's own,
    /// and returns its sum.
    pub(crate) fn check_prediction(&self, predicted: &[f64]) -> Result<f64, HmmError> {
        let step = self.number;
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            return Err(HmmError::Predicted { step, state, value });
        }
        let lifted = kernels::sum(predicted);
        let sum = lifted / LIFT;
        if limits::is_one(sum) { Ok(lifted) } else { Err(HmmError::PredictedSum { step, sum }) }
    }

    /// Returns the sum of a lifted prediction with evidence, or `None` if the step has to be
    /// taken in logarithms.
    pub(crate) fn evidence_sum(&self, predicted: &[f64]) -> Result<Option<f64>, HmmError> {
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            // An overflow may come from the lift, and a NaN from 0 · ∞ after one: try logarithms.
            // If the operator itself gave ∞ or NaN, its logarithms will also be invalid.
            if value == f64::INFINITY || value.is_nan() {
                return Ok(None);
            }
            return Err(HmmError::Predicted { step: self.number, state, value });
        }
        let sum = kernels::sum(predicted);
        Ok(limits::is_evidence_sum(sum / LIFT).then_some(sum))
    }

    /// Predicts in logarithms, into `output.logs`, and checks the prediction: it must be a
    /// distribution unless there is evidence on the move.
    pub(crate) fn predict_in_logs(
        &self,
        before: BeliefRef<'_>,
        evidence: Option<f64>,
        output: &mut StepOutput,
        values: &mut [f64],
    ) -> Result<(), HmmError> {
        before.logs_to(values);
        match self.control {
            Some(control) => self.hmm.transition().apply_log(control, values, &mut output.logs),
            None => output.logs.copy_from_slice(values),
        }
        if evidence.is_some() {
            return self.check_log_evidence(&output.logs);
        }
        // Lifted, so that the test of the sum includes values below the range of `f64`.
        // `predicted` is unused by a step in logarithms, and serves as scratch here.
        let lift = LIFT.ln();
        let states = output.predicted.iter_mut().zip(&output.logs);
        states.for_each(|(out, log)| *out = (log + lift).exp());
        self.check_prediction(&output.predicted)?;
        Ok(())
    }

    /// Updates the prediction in logarithms to the belief after the observation. `log_scale` is
    /// subtracted from the log-likelihoods first, so that the sums keep their digits.
    #[cold]
    pub(crate) fn update_in_logs(
        &self,
        diagonal: &Diagonal<'_>,
        log_scale: f64,
        output: &mut StepOutput,
    ) -> Result<StepOutcome, HmmError> {
        for (out, log) in output.logs.iter_mut().zip(diagonal.logs()) {
            *out += log - log_scale;
        }
        // Callers have excluded an all-zero prediction and all-zero likelihoods, but the two may
        // have no state in common.
        let Some(normalizer) = normalize_logs(&mut output.logs, &mut output.after) else {
            return Err(HmmError::Impossible { step: self.number });
        };
        let log = normalizer + log_scale + diagonal.log_factor;
        let result_in_logs = !self.hmm.rounds_tails() && loses(&output.logs, &output.after);
        Ok(StepOutcome {
            log,
            normalizer: 0.0,
            taken_in_logs: true,
            result_in_logs,
            form: BeliefForm::Other,
        })
    }

    /// Checks that the logarithms of a prediction with evidence are finite or −∞, and not all −∞.
    pub(crate) fn check_log_evidence(&self, logs: &[f64]) -> Result<(), HmmError> {
        let step = self.number;
        match kernels::largest(logs, Valid::Logs) {
            Err(state) => Err(HmmError::Predicted { step, state, value: logs[state].exp() }),
            Ok(f64::NEG_INFINITY) => Err(HmmError::ImpossibleMove { step }),
            Ok(_) => Ok(()),
        }
    }

    /// Returns true if a state that prediction and likelihood allow has become 0, or if a scaled
    /// likelihood is too small to have all its digits.
    #[cold]
    fn loses_states(
        &self,
        likelihoods: Likelihoods<'_>,
        lifted: &[f64],
        output: &mut StepOutput,
    ) -> bool {
        // Predicted again: the fused product with a stored matrix did not keep p.
        self.predict(lifted, &mut output.predicted);
        let lost =
            |((&p, &after), &scaled): ((&f64, &f64), &f64)| limits::is_lost(p, after, scaled);
        let states = output.predicted.iter().zip(&*output.after).zip(likelihoods.values);
        // If the sensor's own likelihood is 0 the state is impossible, and 0 is right.
        match likelihoods.diagonal.values {
            Values::Linear(b) | Values::Checked { linear: b, .. } => {
                states.zip(b).any(|(state, b)| lost(state) && *b > 0.0)
            }
            Values::Log(b) => states.zip(b).any(|(state, b)| lost(state) && *b > f64::NEG_INFINITY),
        }
    }
}

/// Number of states of one group that are multiplied at a time.
const REPEATED: usize = 512;

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Takes the step with likelihoods of groups of states. Returns the normaliser, which includes
    /// the probability of evidence on the move, or `None` if belief or entries may be too small
    /// for a plain step, or if the results leave the range of `f64`.
    fn advance_by_blocks(
        &self,
        (diagonal, groups): (&Diagonal<'_>, &Groups),
        has_evidence: bool,
        before: BeliefRef<'_>,
        lifted: &mut LiftedBelief,
        output: &mut StepOutput,
        rows: Option<&mut Vec<f64>>,
    ) -> Option<(f64, BeliefForm)> {
        let (transition, control) = (self.hmm.transition(), self.control?);
        let likelihoods = diagonal.linear_values()?;
        let largest = diagonal.check(groups.count()).ok()?;
        let fits = limits::is_unscaled(largest) && groups.as_slice().len() == before.linear.len();
        // Conditions of a plain step ("A plain step" in `limits`): this test rules out tiny
        // beliefs, the next one small entries. Without a matrix to look at, the operator reports
        // its smallest entry.
        if !fits || before.logs.is_some() || lifted.is_needed() {
            return None;
        }
        if !limits::is_plain(transition.smallest_entry(control)) {
            return None;
        }
        // Watched even with rounded tails, since nothing is lifted here.
        let watch = Watch::Products;
        let after = &mut *output.updated;
        let (mut updated, mut states) = (ForwardSums::NONE, 0);
        transition.apply_in_blocks(control, before.linear, &mut |first, predicted| {
            states += predicted.len();
            let after = &mut after[first..first + predicted.len()];
            for (run, group, same) in groups.runs(first..first + predicted.len()) {
                let run = run.start - first..run.end - first;
                let (predicted, after) = (&predicted[run.clone()], &mut after[run]);
                let mut update = |predicted, likelihoods, out| {
                    let prediction = Product::Computed(predicted);
                    let part = ForwardStep { prediction, lift: 1.0, likelihoods, watch, out };
                    updated = updated.and(kernels::forward_step(part));
                };
                // A run is either one group throughout, whose likelihood is repeated, or states of
                // consecutive groups, whose likelihoods are contiguous in memory already.
                if same {
                    let repeated = [likelihoods[group]; REPEATED];
                    let parts = predicted.chunks(REPEATED).zip(after.chunks_mut(REPEATED));
                    parts.for_each(|(p, after)| update(p, &repeated[..p.len()], after));
                } else {
                    update(predicted, &likelihoods[group..group + predicted.len()], after);
                }
            }
        });
        // Errors are left for the whole-vector step to report. An operator that passed too few
        // blocks breaks its contract: the output would keep values of an earlier step.
        if states != before.linear.len() || updated.negative_predicted || updated.small {
            if updated.small {
                lifted.lift_for_some_steps();
            }
            return None;
        }
        let predicted = updated.predicted;
        let is_valid = if has_evidence { limits::is_evidence_sum } else { limits::is_one };
        if !is_valid(predicted) || !is_within_range(&updated, predicted) {
            return None;
        }
        let tiny = kernels::normalize_in_place(&mut output.updated, updated.products, rows);
        Some((updated.products, BeliefForm::Plain { tiny }))
    }
}
