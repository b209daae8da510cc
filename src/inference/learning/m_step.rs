//! The M-step of learning: the model that fits expectations best (section 9 of the
//! [formulas](crate::guide::formulas)).
//!
//! The expected log-likelihood Q is a sum of terms for prior, operator and sensor, so that each is
//! maximised by itself. Probabilities of 0 stay 0.
//!
//! Only a stationary prior, which follows from the operator, is maximised together with it ("A
//! stationary prior" in the same section). Q = Σ n_ij ln A_ij + Σ γ_i ln π_i has no maximum in
//! closed form, since π depends on A. Its derivative with respect to A_ij is n_ij / A_ij + h_i π_j,
//! with the potentials h of γ / π (Schweitzer 1968). Up to a constant in each column, which changes
//! nothing because columns keep their sums, that is the derivative of Σ m_ij ln A_ij with the
//! counts m_ij = n_ij + A_ij π_j (h_i + c), for any c. So maximising this sum, as without the
//! prior, is a step uphill, and shorter for a larger c; c is chosen large enough that Q gains too.
//!
//! Steps are repeated, each with π and h of the last operator, until they gain nothing (or 200 were
//! taken, fewer with more than 110 states; the next E-step then continues from there). They end
//! only where the derivative of Q vanishes, whatever c was, under all constraints of the operator
//! (ties, fixed entries).

use super::e_step::Expectations;
use super::learned_model::LearningOptions;
use crate::belief::Belief;
use crate::error::{LearnError, OutOfRange};
use crate::hmm::{Hmm, Prior};
use crate::likelihood::LearnLikelihood;
use crate::transition::{LearnTransition, Move, Stationary, stationary_control};

/// # Learning in parts
impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Returns the model that best fits expectations computed under this model: the M-step. The
    /// options used are the pseudo-counts and `keep_prior`.
    ///
    /// # Errors
    ///
    /// [`LearnError`] if an option is not valid, the expectations are those of another model or
    /// of no sequences ([`LearnError::Nothing`]), or a part cannot be re-estimated.
    pub fn maximize(
        &self,
        expectations: &Expectations<B, A::Statistics>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        learning.check()?;
        let (found, expected) = (expectations.first.len(), self.states());
        if found != expected {
            return Err(LearnError::Expectations { found, expected });
        }
        // Every sequence with an observation adds one to the sum of `first`.
        if expectations.first.iter().all(|p| *p == 0.0) {
            return Err(LearnError::nothing(0, None));
        }
        self.maximize_unchecked(expectations, learning)
    }

    /// Returns the model that best fits the expectations, without checking these.
    pub(crate) fn maximize_unchecked(
        &self,
        expected: &Expectations<B, A::Statistics>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        let (transition, pseudo_count) = (self.transition(), learning.transition_pseudo_count);
        let belief = self.prior().belief();
        // π(i) ∝ F(i) + c_π (section 9 of `guide::formulas`): `seen` plus the pseudo-count.
        let known = belief.as_slice().iter().zip(&expected.first);
        let first: Vec<f64> = known
            .map(|(&old, &seen)| {
                // A pseudo-count must not make possible a state that the model rules out.
                if old > 0.0 { seen + learning.prior_pseudo_count } else { 0.0 }
            })
            .collect();
        let (prior, transition) = match self.prior() {
            Prior::Stationary(_) if learning.keep_prior => {
                // The numbers are kept, but the new operator has another stationary distribution.
                let prior = Prior::AtFirstObservation(belief.clone());
                (prior, transition.maximize(&expected.moves, pseudo_count)?)
            }
            Prior::Stationary(_) => {
                let (transition, belief) =
                    maximize_stationary(transition, &expected.moves, &first, pseudo_count)?;
                (Prior::Stationary(belief), transition)
            }
            prior => {
                // Labelled sequences may all begin at unknown states: then nothing is learned about
                // the prior, which stays.
                let unseen =
                    learning.prior_pseudo_count == 0.0 && expected.first.iter().all(|p| *p == 0.0);
                let belief = if learning.keep_prior || unseen {
                    belief.clone()
                } else {
                    Belief::from_weights(first).map_err(LearnError::Prior)?
                };
                (prior.with_belief(belief), transition.maximize(&expected.moves, pseudo_count)?)
            }
        };
        let likelihood = self
            .likelihood()
            .maximize(&expected.sensor, learning.likelihood_pseudo_count)
            .map_err(LearnError::likelihood)?;
        Ok(Self::new(prior, transition, likelihood)?.rounding_tails(self.rounds_tails()))
    }
}

/// Least and largest number of steps, and a limit on the operations of their eliminations.
const STEPS: (usize, usize) = (10, 200);
const OPERATIONS: usize = 1 << 28;
/// Relative change of Q up to which it counts as rounding.
const ROUNDING: f64 = 1e-13;
/// Range of the constant c above its smallest value, in units of the range of h.
const LEAST: f64 = 0.125;
const MOST: f64 = 1e9;
/// Least share of the gain of Σ m_ij ln A_ij that Q must gain for a step to be accepted. The share
/// is 1 if both have the same curvature, and less if Q bends more.
const FAIR: f64 = 0.25;

/// Returns the operator that best fits statistics of moves and expected first states, and its
/// stationary distribution. Each step takes an elimination, O(n³) for a full matrix, and O(moves).
fn maximize_stationary<A: LearnTransition>(
    transition: &A,
    statistics: &A::Statistics,
    first: &[f64],
    pseudo_count: f64,
) -> Result<(A, Belief), LearnError> {
    let expected = Expected { statistics, first, pseudo_count };
    let mut damping = 1.0;
    let here = expected.point(transition)?;
    let mut step = expected.ascend(transition, &here, &mut damping)?;
    let operations = transition.states().saturating_pow(3).max(1);
    for _ in 1..(OPERATIONS / operations).clamp(STEPS.0, STEPS.1) {
        if step.surrogate_gain <= rounding(step.point.value) {
            break;
        }
        step = expected.ascend(&step.learned, &step.point, &mut damping)?;
    }
    Ok((step.learned, step.point.prior))
}

fn rounding(value: f64) -> f64 {
    ROUNDING * value.abs().max(1.0)
}

/// Expectations of the E-step.
struct Expected<'e, A: LearnTransition> {
    statistics: &'e A::Statistics,
    first: &'e [f64],
    pseudo_count: f64,
}

/// Stationary distribution of an operator, the potentials h above their least value, and Q.
struct Point {
    prior: Belief,
    potentials: Vec<f64>,
    value: f64,
}

struct Step<A> {
    learned: A,
    point: Point,
    /// Gain of Σ m_ij ln A_ij.
    surrogate_gain: f64,
}

impl<A: LearnTransition> Expected<'_, A> {
    fn point(&self, transition: &A) -> Result<Point, LearnError> {
        let chain = Stationary::of(transition)?;
        let prior = chain.distribution();
        let moves = transition.log_probability(self.statistics).ok_or(LearnError::Stationary)?;
        // Q is the sum of the moves, the starts Σ F(i) ln π(i), and the log prior of the operator.
        let first = || self.first.iter().zip(prior.as_slice());
        let starts = first().filter(|(seen, _)| **seen > 0.0).map(|(seen, p)| seen * p.ln());
        let value = moves + starts.sum::<f64>() + transition.log_prior(self.pseudo_count);
        let rewards: Vec<f64> =
            first().map(|(seen, p)| if *seen > 0.0 { seen / p } else { 0.0 }).collect();
        let mut potentials = chain.potentials(&rewards);
        if let Some(state) = potentials.iter().position(|h| !h.is_finite()) {
            let what = format!("the derivative of the log-likelihood by moves to state {state}");
            return Err(OutOfRange::new(what, potentials[state], "a finite value").into());
        }
        // The potentials h are defined up to a constant. With a least value of 0 in the recurrent
        // class, the counts m_ij are not negative for any c ≥ 0.
        let least = chain.class().map(|state| potentials[state]).fold(f64::INFINITY, f64::min);
        chain.class().for_each(|state| potentials[state] -= least);
        Ok(Point { prior, potentials, value })
    }

    /// Takes a step from an operator, the longest tried for which Q gains a fair share of what
    /// Σ m_ij ln A_ij does. (Otherwise steps may overshoot the maximum, back and forth.)
    fn ascend(
        &self,
        transition: &A,
        here: &Point,
        damping: &mut f64,
    ) -> Result<Step<A>, LearnError> {
        loop {
            let counts = self.counts(transition, here, *damping)?;
            let learned = transition.maximize(&counts, self.pseudo_count)?;
            let [before, after] = [transition, &learned].map(|transition| {
                let moves = transition.log_probability(&counts).unwrap_or(f64::NEG_INFINITY);
                moves + transition.log_prior(self.pseudo_count)
            });
            let surrogate_gain = after - before;
            let tolerance = rounding(here.value) + rounding(before);
            // An error here means that the chain has come apart and has no stationary distribution:
            // the step was too long.
            let next = self.point(&learned);
            let is_fair =
                |next: &Point| next.value - here.value >= FAIR * surrogate_gain - tolerance;
            if *damping >= MOST || next.as_ref().is_ok_and(is_fair) {
                *damping = f64::max(*damping / 2.0, LEAST);
                return Ok(Step { learned, point: next?, surrogate_gain });
            }
            *damping *= 4.0;
        }
    }

    /// Returns the counts m_ij = n_ij + A_ij π_j (h_i + c).
    fn counts(
        &self,
        transition: &A,
        here: &Point,
        damping: f64,
    ) -> Result<A::Statistics, LearnError> {
        let control = stationary_control(transition)?;
        let constant = damping * here.potentials.iter().copied().fold(0.0, f64::max);
        let mut statistics = self.statistics.clone();
        if constant > 0.0
            && let Some(counts) = transition.counts(&mut statistics, control)
        {
            let out_of = |(from, before): (usize, &f64)| {
                let before = *before;
                transition.counted(control, from).map(move |(to, p)| {
                    let weight = p * before * (here.potentials[to] + constant);
                    Move { from, to, weight }
                })
            };
            let left = here.prior.as_slice().iter().enumerate().filter(|(_, p)| **p > 0.0);
            counts.add(left.flat_map(out_of));
        }
        Ok(statistics)
    }
}
