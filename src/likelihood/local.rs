//! Sensors that can be evaluated at a few states only.

use super::{Likelihood, Scratch};
use crate::error::LikelihoodError;
use crate::kernels::Valid;

/// A sensor that gives the likelihoods of some states without evaluating all, and a bound on
/// those of all others. Pruned algorithms require it, such as
/// [`Hmm::pruned_filter`](crate::Hmm::pruned_filter) and
/// [`Hmm::beam_viterbi`](crate::Hmm::beam_viterbi).
///
/// The error bounds of these algorithms rest on this bound: it must hold, and the smaller it is,
/// the tighter they are. A sensor behind a reference, `Box`, `Rc` or `Arc` implements the trait,
/// too.
///
/// # Implement it yourself
///
/// A beacon beside a road of n places, which is received less well the farther away it is:
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
///         // Of the unlisted places, the nearest has the largest likelihood.
///         let distance = (0..self.0).find(|d| {
///             [beacon.checked_sub(*d), Some(beacon + d)].into_iter().flatten()
///                 .any(|i| i < self.0 && states.binary_search(&i).is_err())
///         });
///         Ok(Unlisted::at_most(distance.map_or(0.0, |d| self.heard(beacon, beacon + d))))
///     }
///
///     // Places near the beacon, even if the filter has no mass there.
///     fn listed_states(&self, &beacon: &usize, states: &mut Vec<usize>) {
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
    /// Writes the likelihood of each of `states` to `out`, and returns a bound on the likelihood
    /// of every other state. With [`Unlisted::log_at_most`], both are natural logarithms.
    ///
    /// `states` are below [`states`](Likelihood::states), distinct and in ascending order; `out`
    /// has the same length. Likelihoods may have any positive scale, as in
    /// [`diagonal`](Likelihood::diagonal), but the same in `out` and in the bound;
    /// [`Unlisted::with_log_factor`] gives the factor that was taken out. A likelihood of 0 rules
    /// a state out; use logarithms where likelihoods may underflow. The caller checks the values.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the observation has no valid likelihood.
    fn local(
        &self,
        observation: &Self::Observation,
        states: &[usize],
        out: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError>;

    /// Appends the states with the largest likelihoods of an observation, in any order. These are
    /// then evaluated even if no tracked state leads there, which keeps the bound on the others
    /// low. All must be below [`states`](Likelihood::states).
    ///
    /// The choice affects the cost and the tightness of the error bounds, not their validity. By
    /// default no states are appended.
    fn listed_states(&self, observation: &Self::Observation, states: &mut Vec<usize>) {
        let _ = (observation, states);
    }
}

/// Bound on the likelihoods of all states not listed in a call of [`LocalLikelihood::local`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unlisted {
    largest: f64,
    is_log: bool,
    log_factor: f64,
}

impl Unlisted {
    /// Creates an upper bound on likelihoods: finite and at least 0, and 0 if all states are
    /// listed.
    #[must_use]
    pub fn at_most(largest: f64) -> Self {
        Self { largest, is_log: false, log_factor: 0.0 }
    }

    /// Creates an upper bound on natural log-likelihoods, for `out` in natural logarithms, too:
    /// each at most 1e300 in magnitude, or −∞, which rules a state out. It is −∞ if all states
    /// are listed.
    #[must_use]
    pub fn log_at_most(largest: f64) -> Self {
        Self { largest, is_log: true, log_factor: 0.0 }
    }

    /// Adds ln c to the log factor, where c is a factor that was taken out of all likelihoods,
    /// listed or not.
    #[must_use]
    pub fn with_log_factor(self, log_factor: f64) -> Self {
        Self { log_factor: self.log_factor + log_factor, ..self }
    }

    /// Returns the bound.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// True if the bound and the likelihoods returned with it are natural logarithms.
    #[must_use]
    pub fn is_log(&self) -> bool {
        self.is_log
    }

    /// True if a likelihood, in the form of the bound, is above 0.
    pub(crate) fn is_possible(&self, likelihood: f64) -> bool {
        likelihood > if self.is_log { f64::NEG_INFINITY } else { 0.0 }
    }

    /// Logarithm of the factor that was taken out of all likelihoods.
    #[must_use]
    pub fn log_factor(&self) -> f64 {
        self.log_factor
    }

    /// Checks the bound and the likelihoods returned with it, and returns the maximum of them
    /// all, in their form.
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
