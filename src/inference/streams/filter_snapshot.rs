//! State of a filter, as plain data.

use crate::belief::{Belief, SUM_TOLERANCE};
use crate::error::InferenceError;
use crate::inference::LogSum;
use crate::inference::step::belief_form::BeliefRef;

/// Largest number of steps of a filter or snapshot: an `f64` can count them.
pub(crate) const MOST_STEPS: usize =
    if usize::BITS > 53 { (1_u64 << 53) as usize } else { usize::MAX };

/// Returns the number of the step after `steps` steps.
pub(crate) fn next_step(steps: usize) -> Result<usize, InferenceError> {
    if steps < MOST_STEPS { Ok(steps + 1) } else { Err(InferenceError::TooMany { steps }) }
}

/// State of a filter after k steps: plain data, to be kept, compared, sent elsewhere and
/// restored.
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
#[derive(Debug, Clone, PartialEq)]
pub struct FilterSnapshot {
    pub(crate) steps: usize,
    pub(crate) steps_in_logs: usize,
    pub(crate) belief: Belief,
    /// Logarithms of the belief, if it has values outside the range of `f64`.
    pub(crate) logs: Option<Vec<f64>>,
    pub(crate) log_likelihood: LogSum,
}

impl FilterSnapshot {
    /// Creates a snapshot from parts that may be damaged.
    pub(crate) fn checked(
        [steps, steps_in_logs]: [usize; 2],
        belief: Belief,
        logs: Option<Vec<f64>>,
        log_likelihood: LogSum,
    ) -> Result<Self, String> {
        if steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if let Some(logs) = &logs {
            let (found, expected) = (logs.len(), belief.states());
            if found != expected {
                return Err(format!("{found} logarithms for a belief over {expected} states"));
            }
            for (state, (log, p)) in logs.iter().zip(belief.as_slice()).enumerate() {
                // False for a NaN.
                let agree = (log.exp() - p).abs() <= SUM_TOLERANCE;
                if !agree {
                    return Err(format!(
                        "state {state} has probability {p}, expected exp({log}) as its logarithm says"
                    ));
                }
            }
        }
        let LogSum { sum, lost } = log_likelihood;
        if !log_likelihood.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {lost}, expected finite values"
            ));
        }
        Ok(Self { steps, steps_in_logs, belief, logs, log_likelihood })
    }

    pub(crate) fn held(&self) -> BeliefRef<'_> {
        BeliefRef { linear: self.belief.as_slice(), logs: self.logs.as_deref() }
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Number of these steps taken in logarithms, as counted by
    /// [`Filter::steps_in_logs`](crate::Filter::steps_in_logs).
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }

    /// Belief after these steps.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    /// Log-likelihood ln p(y_1 … y_k) of the observations so far.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }

    /// Memory on the heap, in bytes, besides the snapshot itself: 8 for each state, or 16 if the
    /// belief is also held as logarithms.
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        let logs = self.logs.as_ref().map_or(0, Vec::capacity);
        (self.belief.capacity() + logs) * size_of::<f64>()
    }
}
