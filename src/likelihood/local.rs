//! Sensors that can be asked for a few states only.

use super::{Likelihood, Scratch};
use crate::error::LikelihoodError;
use crate::kernels::Valid;

/// A sensor that gives the likelihoods of some states without looking at all of
/// them, and a bound on those of all others: what pruned routines ask, such as
/// [`Hmm::pruned_filter`](crate::Hmm::pruned_filter) and
/// [`Hmm::beam_viterbi`](crate::Hmm::beam_viterbi).
///
/// What these prove rests on the bound: it must hold, and the smaller it is, the
/// more they prove. A sensor behind a reference, `Box`, `Rc` or `Arc` is one, too.
///
/// # Implement it yourself
///
/// A beacon beside a road of n places, heard the worse the farther it is:
///
/// ```
/// use wayfix::likelihood::{LocalLikelihood, Unlisted};
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// struct Beacons(usize);
///
/// impl Beacons {
///     fn heard(&self, beacon: usize, place: usize) -> f64 {
///         1e-9 + 0.1_f64.powi(beacon.abs_diff(place).min(9) as i32)
///     }
/// }
///
/// impl Likelihood for Beacons {
///     type Observation = usize;
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn diagonal<'a>(&'a self, &beacon: &usize, scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let b = scratch.values(self.0);
///         b.iter_mut().enumerate().for_each(|(i, b)| *b = self.heard(beacon, i));
///         Ok(Diagonal::linear(b))
///     }
/// }
///
/// impl LocalLikelihood for Beacons {
///     fn local(&self, &beacon: &usize, states: &[usize], out: &mut [f64], _: &mut Scratch) -> Result<Unlisted, LikelihoodError> {
///         out.iter_mut().zip(states).for_each(|(b, &i)| *b = self.heard(beacon, i));
///         // The nearest place that is not listed is heard best of these.
///         let distance = (0..self.0).find(|d| {
///             [beacon.checked_sub(*d), Some(beacon + d)].into_iter().flatten()
///                 .any(|i| i < self.0 && states.binary_search(&i).is_err())
///         });
///         Ok(Unlisted::at_most(distance.map_or(0.0, |d| self.heard(beacon, beacon + d))))
///     }
///
///     // Where it is heard well, even if nobody thought of these places.
///     fn standing_out(&self, &beacon: &usize, states: &mut Vec<usize>) {
///         states.extend(beacon.saturating_sub(9)..(beacon + 10).min(self.0));
///     }
/// }
///
/// let mut out = [0.0; 2];
/// let others = Beacons(1_000_000).local(&500, &[499, 500], &mut out, &mut Scratch::default())?;
/// assert_eq!(out, [0.1 + 1e-9, 1.0 + 1e-9]);
/// assert_eq!(others.largest(), 0.1 + 1e-9);
/// # Ok::<(), LikelihoodError>(())
/// ```
pub trait LocalLikelihood: Likelihood {
    /// Writes the likelihood of each of `states` to `out`, and returns a bound on
    /// that of every state that is not listed; or, with
    /// [`Unlisted::log_at_most`], natural logarithms in both.
    ///
    /// `states` are below [`states`](Likelihood::states), distinct and in
    /// ascending order; `out` has as many values. Likelihoods may have any
    /// positive scale, as those of [`diagonal`](Likelihood::diagonal), but the
    /// same for `out` and the bound; [`Unlisted::with_log_factor`] says what was
    /// taken out. A likelihood of 0 rules a state out: where a double may not hold
    /// all likelihoods, logarithms do. Whoever calls this checks what comes back.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] when there is no likelihood for this observation.
    fn local(
        &self,
        observation: &Self::Observation,
        states: &[usize],
        out: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError>;

    /// Appends the states for which the observation speaks most, in any order:
    /// they are then asked for even if nothing known leads there, so that the
    /// bound on the rest is low. No state at or above
    /// [`states`](Likelihood::states).
    ///
    /// It changes how much is proven and what it costs, never what is true; none,
    /// unless an implementation says otherwise.
    fn standing_out(&self, observation: &Self::Observation, states: &mut Vec<usize>) {
        let _ = (observation, states);
    }
}

/// What a [`LocalLikelihood`] says of all states that were not listed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unlisted {
    largest: f64,
    is_log: bool,
    log_factor: f64,
}

impl Unlisted {
    /// Their likelihoods are at most this: finite and at least 0, 0 if all states
    /// are listed.
    #[must_use]
    pub fn at_most(largest: f64) -> Self {
        Self { largest, is_log: false, log_factor: 0.0 }
    }

    /// Their natural log-likelihoods are at most this, and `out` holds natural
    /// logarithms, too: at most 1e300 in size, or −∞, which rules a state out, and
    /// is the bound if all states are listed.
    #[must_use]
    pub fn log_at_most(largest: f64) -> Self {
        Self { largest, is_log: true, log_factor: 0.0 }
    }

    /// The same with ln c added to every log-likelihood, listed or not: c is a
    /// factor that was taken out of all values.
    #[must_use]
    pub fn with_log_factor(self, log_factor: f64) -> Self {
        Self { log_factor: self.log_factor + log_factor, ..self }
    }

    /// The bound.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// True if the bound and the likelihoods that came with it are natural
    /// logarithms.
    #[must_use]
    pub fn is_log(&self) -> bool {
        self.is_log
    }

    /// Whether a likelihood of this size, in the form of the bound, is not that of 0.
    pub(crate) fn is_possible(&self, likelihood: f64) -> bool {
        likelihood > if self.is_log { f64::NEG_INFINITY } else { 0.0 }
    }

    /// The logarithm of what was taken out of all likelihoods.
    #[must_use]
    pub fn log_factor(&self) -> f64 {
        self.log_factor
    }

    /// Checks the bound and the likelihoods that came with it, and returns the
    /// largest of them all, in the form that they have.
    pub(crate) fn check(&self, states: &[usize], listed: &[f64]) -> Result<f64, LikelihoodError> {
        super::diagonal::check_log_factor(self.log_factor)?;
        let valid = if self.is_log { Valid::Logs } else { Valid::Likelihoods };
        if !valid.is(self.largest) {
            let (value, expected) = (self.largest, valid.expected());
            return Err(LikelihoodError::Bound { kind: valid.kind(), value, expected });
        }
        let mut largest = self.largest;
        for (&state, &value) in states.iter().zip(listed) {
            if !valid.is(value) {
                let (kind, expected) = (valid.kind(), valid.expected());
                return Err(LikelihoodError::Value { state, kind, value, expected });
            }
            largest = largest.max(value);
        }
        Ok(largest)
    }
}
