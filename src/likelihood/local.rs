//! [`LocalLikelihood`]: sensors that can be evaluated at a few states only, with a bound on all
//! others. The error bounds of pruned algorithms rest on that bound.

use super::{Diagonal, Likelihood, Scratch};
use crate::error::LikelihoodError;
use wayfix_kernels::Valid;

/// A sensor that gives the likelihoods of some states without evaluating all, and a bound on
/// those of all others. Pruned algorithms require it, such as
/// [`Hmm::pruned_filter`](crate::Hmm::pruned_filter) and
/// [`Hmm::beam_viterbi`](crate::Hmm::beam_viterbi).
///
/// The error bounds of these algorithms rest on this bound: it must hold, and the smaller it is,
/// the tighter they are. A reference, `Box`, `Rc` or `Arc` of such a sensor implements the trait,
/// too.
///
/// # Implement it yourself
///
/// Beacons beside a road of n places. The farther away one is, the worse it is received:
///
/// ```
/// use wayfix::likelihood::LocalLikelihood;
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
///     fn local<'a>(
///         &'a self, &beacon: &'a usize, states: &[usize], scratch: &'a mut Scratch,
///     ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
///         let b = scratch.values(states.len());
///         b.iter_mut().zip(states).for_each(|(b, &i)| *b = self.heard(beacon, i));
///         // Of the other places, the nearest has the largest likelihood.
///         let distance = (0..self.0).find(|d| {
///             [beacon.checked_sub(*d), Some(beacon + d)].into_iter().flatten()
///                 .any(|i| i < self.0 && states.binary_search(&i).is_err())
///         });
///         Ok((Diagonal::linear(b), distance.map_or(0.0, |d| self.heard(beacon, beacon + d))))
///     }
///
///     // Places near the beacon, even if the filter has no mass there.
///     fn listed_states(&self, &beacon: &usize, states: &mut Vec<usize>) {
///         states.extend(beacon.saturating_sub(9)..(beacon + 10).min(self.0));
///     }
/// }
///
/// let mut scratch = Scratch::default();
/// let (near, others) = Beacons(1_000_000).local(&500, &[499, 500], &mut scratch)?;
/// assert_eq!(near.as_slice(), [0.1 + 1e-9, 1.0 + 1e-9]);
/// assert_eq!(others, 0.1 + 1e-9);
/// # Ok::<(), LikelihoodError>(())
/// ```
pub trait LocalLikelihood: Likelihood {
    /// Returns the likelihood of each of `states`, and a bound on that of every other state.
    ///
    /// `states` are below [`states`](Likelihood::states), distinct and in ascending order. The
    /// values are as in [`diagonal`](Likelihood::diagonal), of any positive scale. The bound has
    /// the same form and scale: it is a logarithm if they are, and also excludes the log factor. If
    /// all states are asked for, it is 0, or −∞ among logarithms. A likelihood of 0 rules a state
    /// out; use logarithms where likelihoods may underflow. The caller checks the values.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the observation has no valid likelihood.
    fn local<'a>(
        &'a self,
        observation: &'a Self::Observation,
        states: &[usize],
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), LikelihoodError>;

    /// Appends the states with the largest likelihoods of an observation, in any order. These are
    /// then evaluated even if no tracked state leads to them, which keeps the bound on the others
    /// low. All must be below [`states`](Likelihood::states).
    ///
    /// The choice affects the cost and the tightness of the error bounds, not their validity. By
    /// default no states are appended.
    fn listed_states(&self, observation: &Self::Observation, states: &mut Vec<usize>) {
        let _ = (observation, states);
    }
}

/// Checks the likelihoods of some states and the bound on all others, and returns the maximum of
/// them all, in their form.
pub(crate) fn check_local(
    diagonal: &Diagonal<'_>,
    bound: f64,
    states: &[usize],
) -> Result<f64, LikelihoodError> {
    let valid = if diagonal.is_log() { Valid::Logs } else { Valid::Likelihoods };
    diagonal.check_shape(states.len())?;
    if !valid.is(bound) {
        let (kind, expected) = (valid.kind(), valid.expected());
        return Err(LikelihoodError::Bound { kind, value: bound, expected });
    }
    // Value i is that of `states[i]`, which the error has to name.
    let largest = diagonal.check(states.len()).map_err(|error| match error {
        LikelihoodError::Value { state, kind, value, expected } => {
            LikelihoodError::Value { state: states[state], kind, value, expected }
        }
        error => error,
    })?;
    Ok(largest.max(bound))
}
