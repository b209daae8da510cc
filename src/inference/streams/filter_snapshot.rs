//! State of a filter as plain data: accessors, copies at rest, and formats. The struct itself is
//! defined where steps are taken, in [`step::state`](crate::inference::step::state).
//!
//! A copy at rest is compact, without the memory that steps need; [`checked`] establishes for bytes
//! from outside what steps guarantee for a running filter: the belief is a distribution, and its
//! logarithms, if any, agree with it.
//!
//! [`checked`]: FilterSnapshot::checked

use super::bytes::{Kind, Reader, Writer, contents};
use super::format::{BELIEF, COUNT, MAYBE_LOGS, SUM, in_bytes};
use crate::belief::{Belief, BeliefView, SUM_TOLERANCE};
use crate::error::SnapshotError;
use crate::inference::step::state::{FilterSnapshot, LogSum, MOST_STEPS};
use wayfix_kernels::Aligned;

impl Clone for FilterSnapshot {
    /// Copies the state into as little memory as possible.
    fn clone(&self) -> Self {
        // A state at rest needs no aligned memory: there may be millions of a few hundred bytes.
        let belief = Aligned::from(self.belief.to_vec());
        Self { belief, logs: self.logs.clone(), ..*self }
    }

    /// Copies the state into existing memory. Allocates nothing if both have the same number of
    /// states, unless only the source has logarithms.
    fn clone_from(&mut self, other: &Self) {
        self.copy(other);
        // A vehicle that needed logarithms once should not keep the memory for them.
        if other.logs.is_empty() {
            self.logs = Vec::new();
        }
    }
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

    /// True if a state may be the true one, also where its probability is below the range of
    /// doubles.
    #[doc(hidden)]
    #[must_use]
    pub fn is_possible(&self, state: usize) -> bool {
        self.belief_ref().log(state) > f64::NEG_INFINITY
    }

    /// Replaces the belief, its logarithms if there are any (with −∞ for nothing), and the number
    /// of steps, for models that get more states. A filter checks the result when it is restored.
    #[doc(hidden)]
    #[must_use]
    pub fn remade(&self, steps: usize, mut values: impl FnMut(&[f64], f64) -> Vec<f64>) -> Self {
        let belief = Aligned::from(values(&self.belief, 0.0));
        let logs = values(&self.logs, f64::NEG_INFINITY);
        Self { steps, belief, logs, ..self.clone() }
    }

    /// Memory on the heap in bytes, in addition to the snapshot itself: 8 for each state, or 16 if
    /// the belief is held in logarithms too. (The state within a filter keeps room for steps.)
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        (self.belief.capacity() + self.logs.capacity()) * size_of::<f64>()
    }

    /// Returns the state as bytes: 8 bytes for each possible state, one bit for each state, and
    /// about 60 bytes more. Needs no feature.
    ///
    /// ```
    /// # use wayfix::inference::FilterSnapshot;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
    /// let mut filter = hmm.filter();
    /// filter.step(&[0.9, 0.2])?;
    /// let mut bytes = filter.snapshot().to_bytes();
    ///
    /// let mut next = hmm.filter();
    /// next.restore(&FilterSnapshot::from_bytes(&bytes)?)?;
    /// assert_eq!(next.snapshot(), filter.snapshot()); // to the bit
    ///
    /// bytes[20] ^= 1;
    /// assert!(FilterSnapshot::from_bytes(&bytes).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # The format
    ///
    /// The bytes begin with `wayfix`, the kind of state and the version, 1, and end with a
    /// checksum, which detects damage. They mean the same on all machines; other versions of the
    /// format are refused.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        Writer::whole(Kind::Filter, |out| self.write(out))
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        Reader::whole(bytes, Kind::Filter, Self::read)?.checked().map_err(contents)
    }

    /// Creates an empty state, whose fields are read next.
    pub(crate) fn blank() -> Self {
        Self::start(&[])
    }

    /// Checks that the numbers, which may be damaged, can be those of a filter.
    pub(crate) fn checked(self) -> Result<Self, String> {
        let Self { steps, belief, logs, log_likelihood, .. } = &self;
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if !logs.is_empty() {
            let (found, expected) = (logs.len(), belief.len());
            if found != expected {
                return Err(format!("{found} logarithms for a belief over {expected} states"));
            }
            for (state, (log, p)) in logs.iter().zip(&**belief).enumerate() {
                // Steps read the logarithms, accessors the belief: the two must agree. (The
                // comparison is false for NaN.)
                let agree = (log.exp() - p).abs() <= SUM_TOLERANCE;
                if !agree {
                    return Err(format!(
                        "state {state} has probability {p}, expected exp({log}) as its logarithm says"
                    ));
                }
            }
        }
        let LogSum { sum, compensation } = *log_likelihood;
        if !log_likelihood.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {compensation}, expected finite values"
            ));
        }
        Ok(self)
    }
}

/// The fields of a filter's state.
macro_rules! filter_fields {
    ($apply:ident) => {
        $apply! {
            FilterSnapshot, {
                steps: usize = COUNT(steps),
                steps_in_logs: usize = COUNT(steps_in_logs),
                belief: Belief = BELIEF(belief),
                logs: Option<Vec<Option<f64>>> = MAYBE_LOGS(logs),
                log_likelihood: [f64; 2] = SUM(log_likelihood),
            }
            bytes: steps, steps_in_logs, log_likelihood, belief, logs
        }
    };
}
filter_fields!(in_bytes);
#[cfg(feature = "serde")]
use crate::inference::streams::format::with_names;
#[cfg(feature = "serde")]
filter_fields!(with_names);
