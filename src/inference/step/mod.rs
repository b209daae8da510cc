//! One step of the filter: prediction, update, normaliser (paper eq. 8).

pub(crate) mod backward;
pub(crate) mod belief_form;
pub(crate) mod evidence;
pub(crate) mod forward_pass;
pub(crate) mod grouped;
pub(crate) mod log_sum;
pub(crate) mod scores;

use self::belief_form::{
    BeliefForm, BeliefRef, LiftedBelief, StepOutcome, StepOutput, loses, normalize_logs,
};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::kernels::{self, ForwardStep, ForwardSums, Product, Valid, Watch};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::limits::{self, LIFT};
use crate::sequence::Sequence;
use crate::transition::{SparseTransition, Stored, Transition};

/// Scratch memory for steps, allocated once.
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

/// Model, number and control of one step.
pub(crate) struct Step<'m, A: Transition, B> {
    pub(crate) hmm: &'m Hmm<A, B>,
    /// Number of the step, for errors.
    pub(crate) number: usize,
    /// Control, or `None` without a transition.
    pub(crate) control: Option<&'m A::Control>,
}

impl<'m, A: Transition, B: Likelihood> Step<'m, A, B> {
    /// Creates the step of a sequence with this number.
    pub(crate) fn of<S>(hmm: &'m Hmm<A, B>, sequence: &'m S, number: usize) -> Self
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let control = hmm.prior().moves_at(number).then(|| sequence.control(number));
        Self { hmm, number, control }
    }

    /// Predicts: `after = A before`, or a copy without a transition; of any scale. The control
    /// must have been checked.
    pub(crate) fn predict(&self, before: &[f64], after: &mut [f64]) {
        match self.control {
            Some(control) => self.hmm.transition().apply(control, before, after),
            None => after.copy_from_slice(before),
        }
    }

    pub(crate) fn check_control(&self, control: &A::Control) -> Result<(), InferenceError> {
        let wrap = |cause| InferenceError::control(self.number, cause);
        self.hmm.transition().check_control(control).map_err(wrap)
    }

    /// Returns the checked diagonal of an observation, and its largest value.
    pub(crate) fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), InferenceError> {
        let wrap = |cause| InferenceError::likelihood(self.number, cause);
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).map_err(wrap)?;
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        Ok((diagonal, largest))
    }

    /// Advances from the last belief to the one after the observation.
    ///
    /// The step is taken in linear space unless it needs logarithms: because the belief before is
    /// kept in logarithms, because the observation contradicts the prediction by more than 2^32,
    /// or because a possible state would get 0. The last does not count in a model with rounded
    /// tails.
    ///
    /// `lifted` is the lifted form of the belief before.
    pub(crate) fn advance(
        &self,
        observation: &B::Observation,
        before: BeliefRef<'_>,
        lifted: &mut LiftedBelief,
        results: &mut StepOutput<'_>,
        work: &mut Workspace,
    ) -> Result<StepOutcome, InferenceError> {
        let Workspace { scratch, values } = work;
        if let Some(found) = self.hmm.likelihood().by_groups(observation, scratch)
            && let Ok((diagonal, groups)) = found
            && diagonal.check_shape(groups.count()).is_ok()
        {
            let evidence = self.evidence()?;
            let (has_evidence, likelihoods) = (evidence.is_some(), (&diagonal, groups));
            let advanced =
                self.advance_by_blocks(likelihoods, has_evidence, before, lifted, results);
            if let Some((normalizer, form)) = advanced {
                let log = normalizer.ln() + diagonal.log_factor + evidence.unwrap_or(0.0);
                return Ok(StepOutcome { log, normalizer, by_logs: false, in_logs: false, form });
            }
        }
        let wrap = |cause| InferenceError::likelihood(self.number, cause);
        // Borrowed, since copying a diagonal that was just written takes as long as some rows.
        let found = self.hmm.likelihood().diagonal(observation, scratch);
        let diagonal = match found {
            Ok(ref diagonal) => diagonal,
            Err(source) => return Err(wrap(source)),
        };
        diagonal.check_shape(self.hmm.states()).map_err(wrap)?;
        if let Some(log_factor) = self.evidence()? {
            return self.advance_by_evidence(log_factor, diagonal, before, lifted, results, values);
        }
        let tails_rounded = self.hmm.rounds_tails();
        // Unscaled if possible; the update checks validity on the way.
        if let (None, Some(linear)) = (before.logs, diagonal.linear_values()) {
            let as_they_are =
                Likelihoods { diagonal, values: linear, scaled: false, tails_rounded };
            let advanced = self.advance_in_doubles(as_they_are, before.linear, lifted, results)?;
            if let Some((normalizer, form)) = advanced {
                let log = normalizer.ln() + diagonal.log_factor;
                return Ok(StepOutcome { log, normalizer, by_logs: false, in_logs: false, form });
            }
        }
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        let log_scale = self.scale(diagonal, largest, values)?;
        if before.logs.is_none() {
            let scaled = Likelihoods { diagonal, values, scaled: true, tails_rounded };
            let advanced = self.advance_in_doubles(scaled, before.linear, lifted, results)?;
            if let Some((scaled, form)) = advanced {
                let log = scaled.ln() + log_scale + diagonal.log_factor;
                return Ok(StepOutcome {
                    log,
                    normalizer: 0.0,
                    by_logs: false,
                    in_logs: false,
                    form,
                });
            }
        }
        self.predict_in_logs(before, None, results, values)?;
        self.update_in_logs(diagonal, log_scale, results)
    }

    /// Scales likelihoods to a largest value of one, and returns the logarithm of the divisor.
    pub(crate) fn scale(
        &self,
        diagonal: &Diagonal<'_>,
        largest: f64,
        values: &mut [f64],
    ) -> Result<f64, InferenceError> {
        match diagonal.values {
            Values::Linear(linear) | Values::Checked { linear, .. } => {
                if largest == 0.0 {
                    return Err(InferenceError::Impossible { step: self.number });
                }
                values.iter_mut().zip(linear).for_each(|(out, b)| *out = b / largest);
                Ok(largest.ln())
            }
            Values::Log(logs) => {
                if largest == f64::NEG_INFINITY {
                    return Err(InferenceError::Impossible { step: self.number });
                }
                values.iter_mut().zip(logs).for_each(|(out, log)| *out = (log - largest).exp());
                Ok(largest)
            }
        }
    }

    /// Takes the step in linear space. Returns the normaliser of the likelihoods, or `None` if
    /// the results leave the range of `f64` or the likelihoods are not valid or need scaling.
    #[inline]
    fn advance_in_doubles(
        &self,
        likelihoods: Likelihoods<'_>,
        belief: &[f64],
        lifted: &mut LiftedBelief,
        results: &mut StepOutput<'_>,
    ) -> Result<Option<(f64, BeliefForm)>, InferenceError> {
        let matrix = self.matrix();
        if !lifted.is_needed()
            && let Some(matrix) = matrix
            && matrix.plain
        {
            let product = Product::Sparse { matrix: &matrix.sliced_rows, x: belief };
            let updated = kernels::forward_step(likelihoods.update(product, 1.0, results.lifted));
            if !holds(&updated, 1.0) {
                return Ok(None);
            }
            if !updated.small {
                let tiny = kernels::normalize_in_place(results.lifted, updated.products);
                return Ok(Some((updated.products, BeliefForm::Plain { tiny })));
            }
            lifted.lift_for_some_steps();
        }
        let lifted = lifted.values(belief);
        let updated = self.update(matrix, likelihoods, lifted, results)?;
        if !holds(&updated, LIFT) {
            return Ok(None);
        }
        let tiny = kernels::normalize_and_lift(results.lifted, results.after, updated.products);
        if updated.small && self.loses_states(likelihoods, lifted, results) {
            return Ok(None);
        }
        Ok(Some((updated.products / LIFT, BeliefForm::Lifted { tiny })))
    }

    /// Returns the sparse matrix of a step without evidence, if there is one.
    fn matrix(&self) -> Option<&'m SparseTransition> {
        self.hmm.transition().stored(self.control?).and_then(Stored::as_sparse)
    }

    /// Writes the product of prediction and likelihoods into the lifted result.
    #[inline]
    fn update(
        &self,
        matrix: Option<&SparseTransition>,
        likelihoods: Likelihoods<'_>,
        lifted: &[f64],
        results: &mut StepOutput<'_>,
    ) -> Result<ForwardSums, InferenceError> {
        if let Some(matrix) = matrix {
            let product = Product::Sparse { matrix: &matrix.sliced_rows, x: lifted };
            return Ok(kernels::forward_step(likelihoods.update(product, LIFT, results.lifted)));
        }
        let Some(control) = self.control else {
            return Ok(kernels::forward_step(likelihoods.update(
                Product::Computed(lifted),
                LIFT,
                results.lifted,
            )));
        };
        self.hmm.transition().apply(control, lifted, results.predicted);
        let product = Product::Computed(results.predicted);
        let updated = kernels::forward_step(likelihoods.update(product, LIFT, results.lifted));
        if updated.negative_predicted || !limits::is_one(updated.predicted / LIFT) {
            self.check_prediction(results.predicted)?;
        }
        Ok(updated)
    }

    /// Returns true if a state that prediction and likelihood allow has become 0, or a scaled
    /// likelihood is too small to have all its digits.
    #[cold]
    pub(crate) fn loses_states(
        &self,
        likelihoods: Likelihoods<'_>,
        lifted: &[f64],
        results: &mut StepOutput<'_>,
    ) -> bool {
        self.predict(lifted, results.predicted);
        let lost =
            |((&p, &after), &scaled): ((&f64, &f64), &f64)| limits::is_lost(p, after, scaled);
        let states = results.predicted.iter().zip(&*results.after).zip(likelihoods.values);
        match likelihoods.diagonal.values {
            Values::Linear(b) | Values::Checked { linear: b, .. } => {
                states.zip(b).any(|(state, b)| lost(state) && *b > 0.0)
            }
            Values::Log(b) => states.zip(b).any(|(state, b)| lost(state) && *b > f64::NEG_INFINITY),
        }
    }

    /// Updates the prediction in logarithms to the belief after the observation. `log_scale` is
    /// taken out of the likelihoods first, so that they keep their digits.
    #[cold]
    pub(crate) fn update_in_logs(
        &self,
        diagonal: &Diagonal<'_>,
        log_scale: f64,
        results: &mut StepOutput<'_>,
    ) -> Result<StepOutcome, InferenceError> {
        for (out, log) in results.logs.iter_mut().zip(diagonal.logs()) {
            *out += log - log_scale;
        }
        let Some(normalizer) = normalize_logs(results.logs, results.after) else {
            return Err(InferenceError::Impossible { step: self.number });
        };
        let log = normalizer + log_scale + diagonal.log_factor;
        let in_logs = !self.hmm.rounds_tails() && loses(results.logs, results.after);
        Ok(StepOutcome { log, normalizer: 0.0, by_logs: true, in_logs, form: BeliefForm::Other })
    }

    /// Predicts in logarithms, into those of the results, and checks the prediction: a
    /// distribution, unless there is evidence on the move.
    pub(crate) fn predict_in_logs(
        &self,
        before: BeliefRef<'_>,
        evidence: Option<f64>,
        results: &mut StepOutput<'_>,
        values: &mut [f64],
    ) -> Result<(), InferenceError> {
        before.logs_to(values);
        match self.control {
            Some(control) => self.hmm.transition().apply_log(control, values, results.logs),
            None => results.logs.copy_from_slice(values),
        }
        if evidence.is_some() {
            return self.check_log_evidence(results.logs);
        }
        let logs = results.logs.iter();
        let lift = LIFT.ln();
        results.predicted.iter_mut().zip(logs).for_each(|(out, log)| *out = (log + lift).exp());
        self.check_prediction(results.predicted)?;
        Ok(())
    }

    /// Checks that a lifted prediction is a distribution, since any operator may have made it,
    /// and returns its sum.
    pub(crate) fn check_prediction(&self, predicted: &[f64]) -> Result<f64, InferenceError> {
        let step = self.number;
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            return Err(InferenceError::Predicted { step, state, value });
        }
        let lifted = kernels::sum(predicted);
        let sum = lifted / LIFT;
        if limits::is_one(sum) {
            Ok(lifted)
        } else {
            Err(InferenceError::PredictedSum { step, sum })
        }
    }
}

/// Likelihoods in proportion to those of a diagonal.
#[derive(Clone, Copy)]
pub(crate) struct Likelihoods<'a> {
    pub(crate) diagonal: &'a Diagonal<'a>,
    pub(crate) values: &'a [f64],
    /// True if they have been scaled, so that a value of 0 may have been positive.
    pub(crate) scaled: bool,
    /// True if the model rounds tails.
    pub(crate) tails_rounded: bool,
}

impl<'a> Likelihoods<'a> {
    pub(crate) fn update(
        self,
        prediction: Product<'a>,
        lift: f64,
        out: &'a mut [f64],
    ) -> ForwardStep<'a> {
        // Without a lift, small results lose digits, so that they are watched with rounded tails
        // too.
        let watch = match self {
            _ if lift > 1.0 && self.tails_rounded => Watch::Nothing,
            Self { scaled: true, .. } => Watch::Predictions,
            Self { scaled: false, .. } => Watch::Products,
        };
        ForwardStep { prediction, lift, likelihoods: self.values, watch, out }
    }
}

/// Returns true if the results of an update are within the range of `f64`, and the likelihoods
/// are valid and near enough to one.
#[inline]
pub(crate) fn holds(updated: &ForwardSums, lift: f64) -> bool {
    let ForwardSums { products, predicted, largest_likelihood, .. } = *updated;
    !updated.negative_likelihood
        && limits::linear_holds(products, predicted, largest_likelihood, lift)
}
