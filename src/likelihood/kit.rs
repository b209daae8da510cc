//! Tests for sensors of your own: [`check`], [`check_local`] and [`check_samples`] compare the
//! methods of a sensor with one another.
//!
//! Inference checks that a diagonal is valid, but not that a sensor says the same of an observation
//! by each of its methods. A bound that does not hold makes the error bounds of a pruned filter
//! wrong, and nobody notices. A test calls these functions with some observations:
//!
//! ```
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//! use wayfix::likelihood::{LocalLikelihood, SampleObservation, kit};
//! use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
//!
//! /// A compass that tells the heading of a state, north, east, south or west, or the next one.
//! struct Compass(Vec<usize>);
//!
//! impl Compass {
//!     fn shown(&self, heading: usize, state: usize) -> f64 {
//!         [0.75, 0.25, 0.0, 0.0][(heading + 4 - self.0[state]) % 4]
//!     }
//! }
//!
//! impl Likelihood for Compass {
//!     type Observation = usize;
//!     fn states(&self) -> usize {
//!         self.0.len()
//!     }
//!     fn diagonal<'a>(&'a self, &y: &usize, scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
//!         let b = scratch.values(self.states());
//!         b.iter_mut().enumerate().for_each(|(state, b)| *b = self.shown(y, state));
//!         Ok(Diagonal::linear(b))
//!     }
//! }
//!
//! impl LocalLikelihood for Compass {
//!     fn local<'a>(
//!         &'a self, &y: &'a usize, states: &[usize], scratch: &'a mut Scratch,
//!     ) -> Result<(Diagonal<'a>, f64), LikelihoodError> {
//!         let b = scratch.values(states.len());
//!         b.iter_mut().zip(states).for_each(|(b, &state)| *b = self.shown(y, state));
//!         Ok((Diagonal::linear(b), 0.75))
//!     }
//! }
//!
//! impl SampleObservation for Compass {
//!     type Sample = usize;
//!     fn sample<R: rand::Rng + ?Sized>(&self, state: usize, rng: &mut R) -> usize {
//!         (self.0[state] + usize::from(rng.next_u32() % 4 == 0)) % 4
//!     }
//! }
//!
//! let compass = Compass(vec![0, 1, 1, 2, 3]);
//! for heading in 0..4 {
//!     kit::check(&compass, &heading)?;
//!     kit::check_local(&compass, &heading)?;
//! }
//! kit::check_samples(&compass, 100, &mut ChaCha8Rng::seed_from_u64(1))?;
//! # Ok::<(), LikelihoodError>(())
//! ```

use std::borrow::Borrow;

use rand::Rng;

use super::{
    Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch, check_local as check_bound,
};
use crate::error::{Disagreement, LikelihoodError};

/// Largest relative difference of log-likelihoods that count as equal, absolute near 0.
const TOLERANCE: f64 = 1e-9;

/// Checks the diagonal of an observation: n valid values, which depend on the observation and not
/// on what the [`Scratch`] holds, and equal those [by groups](Likelihood::by_groups). O(n).
///
/// # Errors
///
/// [`LikelihoodError::Disagreement`] with the method, the state, and both log-likelihoods, and the
/// errors of an observation at a step.
pub fn check<B: Likelihood + ?Sized>(
    sensor: &B,
    observation: &B::Observation,
) -> Result<(), LikelihoodError> {
    let n = sensor.states();
    let expected = logs_of(sensor, observation)?;
    // Memory of an earlier step: a value that is not written stays NaN, which is never valid.
    let mut used = Scratch::default();
    used.values(n).fill(f64::NAN);
    let diagonal = sensor.diagonal(observation, &mut used)?;
    diagonal.check(n)?;
    compare("diagonal with used memory", absolute(&diagonal).zip(&expected).enumerate())?;
    let mut scratch = Scratch::default();
    let Some(by_groups) = sensor.by_groups(observation, &mut scratch) else { return Ok(()) };
    let (diagonal, groups) = by_groups?;
    let group_of = groups.as_slice();
    if group_of.len() != n {
        return Err(LikelihoodError::WrongLength { found: group_of.len(), expected: n });
    }
    diagonal.check(groups.count())?;
    let found: Vec<f64> = absolute(&diagonal).collect();
    compare("by_groups", group_of.iter().map(|group| found[*group]).zip(&expected).enumerate())
}

/// Checks the likelihoods of some states: those that are asked for equal the diagonal, and the
/// others are at most the bound; [listed states](LocalLikelihood::listed_states) exist. Tried on no
/// states, single ones, every other one, all of them, and the listed ones. O(n²).
///
/// # Errors
///
/// As [`check`], and [`LikelihoodError::Listed`].
pub fn check_local<B: LocalLikelihood + ?Sized>(
    sensor: &B,
    observation: &B::Observation,
) -> Result<(), LikelihoodError> {
    let n = sensor.states();
    let expected = logs_of(sensor, observation)?;
    let mut listed = Vec::new();
    sensor.listed_states(observation, &mut listed);
    if let Some(&state) = listed.iter().find(|state| **state >= n) {
        return Err(LikelihoodError::Listed { state, states: n });
    }
    listed.sort_unstable();
    listed.dedup();
    let mut choices = vec![Vec::new(), (0..n).collect(), listed];
    choices.extend([0, 1].map(|first| (first..n).step_by(2).collect::<Vec<_>>()));
    choices.extend((0..n).map(|state| vec![state]));
    // One scratch for all, as in a filter.
    let mut scratch = Scratch::default();
    for states in choices {
        let (diagonal, bound) = sensor.local(observation, &states, &mut scratch)?;
        check_bound(&diagonal, bound, &states)?;
        let values = states.iter().copied().zip(absolute(&diagonal));
        compare("local", values.map(|(state, found)| (state, (found, &expected[state]))))?;
        let bound = diagonal.log_factor() + if diagonal.is_log() { bound } else { bound.ln() };
        for (state, &log) in expected.iter().enumerate() {
            if states.binary_search(&state).is_err() && log > bound && !close(log, bound) {
                return Err(disagreement("the bound of local", state, bound, log));
            }
        }
    }
    Ok(())
}

/// Draws observations in each state, and checks that each is possible there and has a valid
/// diagonal. O(draws · n²).
///
/// # Errors
///
/// [`LikelihoodError::ImpossibleSample`] with the state, and the errors of an observation at a step.
pub fn check_samples<B: SampleObservation, R: Rng + ?Sized>(
    sensor: &B,
    draws: usize,
    rng: &mut R,
) -> Result<(), LikelihoodError> {
    for state in 0..sensor.states() {
        for _ in 0..draws {
            let observation = sensor.sample(state, rng);
            let log = logs_of(sensor, observation.borrow())?[state];
            if log == f64::NEG_INFINITY {
                return Err(LikelihoodError::ImpossibleSample { state });
            }
        }
    }
    Ok(())
}

/// Log-likelihoods of all states.
fn logs_of<B: Likelihood + ?Sized>(
    sensor: &B,
    observation: &B::Observation,
) -> Result<Vec<f64>, LikelihoodError> {
    let mut scratch = Scratch::default();
    let diagonal = sensor.diagonal(observation, &mut scratch)?;
    diagonal.check(sensor.states())?;
    Ok(absolute(&diagonal).collect())
}

/// Log-likelihoods with the factor that was taken out.
fn absolute(diagonal: &Diagonal<'_>) -> impl Iterator<Item = f64> {
    let factor = diagonal.log_factor();
    diagonal.logs().map(move |log| log + factor)
}

fn close(found: f64, expected: f64) -> bool {
    // Relative to a likelihood of 0, whose logarithm is infinite, nothing is close.
    let relative =
        expected.is_finite() && (found - expected).abs() <= TOLERANCE * expected.abs().max(1.0);
    found == expected || relative
}

/// Compares pairs (state, (found, expected)).
fn compare<'a>(
    method: &'static str,
    mut pairs: impl Iterator<Item = (usize, (f64, &'a f64))>,
) -> Result<(), LikelihoodError> {
    let wrong = pairs.find(|(_, (found, expected))| !close(*found, **expected));
    wrong.map_or(Ok(()), |(state, (found, &expected))| {
        Err(disagreement(method, state, found, expected))
    })
}

fn disagreement(method: &'static str, state: usize, found: f64, expected: f64) -> LikelihoodError {
    Disagreement { method, to: Some(state), from: None, found, expected }.into()
}
