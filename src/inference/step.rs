//! One step of the filter: prediction, update, normaliser (paper eq. 8).

use std::f64::consts::LN_2;

use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::kernels::{self, LIFT};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::transition::Transition;

/// ln of [`LIFT`].
pub(super) const LN_LIFT: f64 = 1000.0 * LN_2;

/// A step is taken in linear space if the normaliser is at least this part of
/// the largest likelihood. What underflows in it is then below 2^-1040 of the
/// result, so that a probability of 1e-300 still has 14 digits.
const LEAST_NORMALISER: f64 = f64::from_bits((1023 - 32) << 52);
/// Likelihoods with their largest value in this range are taken as they are.
const UNSCALED: std::ops::RangeInclusive<f64> =
    f64::from_bits((1023 - 16) << 52)..=f64::from_bits((1023 + 16) << 52);

/// Memory for steps; allocated once, when it is made.
#[derive(Debug, Clone)]
pub(super) struct Workspace {
    scratch: Scratch,
    values: Vec<f64>,
}

impl Workspace {
    pub(super) fn new(states: usize) -> Self {
        Self { scratch: Scratch::default(), values: vec![0.0; states] }
    }
}

/// The model at one step.
pub(super) struct Step<'m, A: Transition, B> {
    pub(super) hmm: &'m Hmm<A, B>,
    /// The number of the step, for errors.
    pub(super) number: usize,
    /// The control, or `None` if nothing moves.
    pub(super) control: Option<&'m A::Control>,
}

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// `after = A before`, or the same if nothing moves.
    pub(super) fn predict(&self, before: &[f64], after: &mut [f64]) -> Result<(), InferenceError> {
        match self.control {
            Some(control) => {
                let transition = self.hmm.transition();
                transition
                    .check_control(control)
                    .map_err(|source| InferenceError::Control { step: self.number, source })?;
                transition.apply(control, before, after);
            }
            None => after.copy_from_slice(before),
        }
        Ok(())
    }

    /// Checks the diagonal of an observation, and gives it with its largest
    /// value.
    pub(super) fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), InferenceError> {
        let wrap = |source| InferenceError::Likelihood { step: self.number, source };
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).map_err(wrap)?;
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        Ok((diagonal, largest))
    }

    /// From the last belief to the `predicted` one (which sums to one but for
    /// rounding) and the one `after` the observation. Returns ln N, the
    /// log-likelihood of the observation.
    pub(super) fn advance(
        &self,
        observation: &B::Observation,
        before: &[f64],
        predicted: &mut [f64],
        after: &mut [f64],
        work: &mut Workspace,
    ) -> Result<f64, InferenceError> {
        self.predict(before, predicted)?;
        let Workspace { scratch, values } = work;
        let (diagonal, largest) = self.diagonal(observation, scratch)?;
        // Likelihoods near one, with the logarithm of what was divided out.
        let (linear, largest, log_scale): (&[f64], _, _) = match diagonal.values {
            Values::Linear(linear) | Values::Checked { linear, .. } => {
                if UNSCALED.contains(&largest) {
                    (linear, largest, 0.0)
                } else if largest == 0.0 {
                    return Err(InferenceError::Impossible { step: self.number });
                } else {
                    values.iter_mut().zip(linear).for_each(|(out, b)| *out = b / largest);
                    (values, 1.0, largest.ln())
                }
            }
            Values::Log(logs) => {
                if largest == f64::NEG_INFINITY {
                    return Err(InferenceError::Impossible { step: self.number });
                }
                values.iter_mut().zip(logs).for_each(|(out, log)| *out = (log - largest).exp());
                (values, 1.0, largest)
            }
        };
        let lifted = kernels::multiply(predicted, linear, after);
        let normaliser = lifted / LIFT;
        if normaliser >= LEAST_NORMALISER * largest && lifted <= f64::MAX {
            kernels::normalise(after, lifted);
            return Ok(normaliser.ln() + log_scale + diagonal.log_factor);
        }
        self.advance_in_logs(diagonal, log_scale, before, after, values)
    }

    /// The same step where linear space does not hold it: the likelihood
    /// contradicts the prediction by more than 2^32. `log_scale` is taken out
    /// of the logarithms first, so that they keep their digits.
    #[cold]
    fn advance_in_logs(
        &self,
        diagonal: Diagonal<'_>,
        log_scale: f64,
        before: &[f64],
        after: &mut [f64],
        lifted: &mut [f64],
    ) -> Result<f64, InferenceError> {
        lifted.iter_mut().zip(before).for_each(|(out, p)| *out = p * LIFT);
        self.predict(lifted, after)?;
        if let Err(state) = kernels::largest(after) {
            let value = after[state] / LIFT;
            return Err(InferenceError::Predicted { step: self.number, state, value });
        }
        let mut largest = f64::NEG_INFINITY;
        for (out, log) in after.iter_mut().zip(diagonal.logs()) {
            *out = out.ln() + (log - log_scale);
            largest = largest.max(*out);
        }
        if largest == f64::NEG_INFINITY {
            return Err(InferenceError::Impossible { step: self.number });
        }
        let normaliser = exponentiate(after, largest);
        Ok(largest + normaliser.ln() - LN_LIFT + log_scale + diagonal.log_factor)
    }
}

/// From logarithms, of which the largest is given, to a distribution in
/// proportion to what they are the logarithms of. Returns the sum of these
/// over the largest.
pub(super) fn exponentiate(logs: &mut [f64], largest: f64) -> f64 {
    logs.iter_mut().for_each(|log| *log = (*log - largest).exp());
    let sum = kernels::sum(logs);
    kernels::normalise(logs, sum);
    sum
}
