//! The M-step of a model with a stationary prior, which follows from the operator ("A stationary
//! prior" in section 9 of the [formulas](crate::guide::formulas)).
//!
//! The expected log-likelihood Q = Σ n_ij ln A_ij + Σ γ_i ln π_i has no maximum in closed form,
//! since π depends on A. Its derivative with respect to A_ij is n_ij / A_ij + h_i π_j, with the
//! potentials h of γ / π (Schweitzer 1968). Up to a constant in each column, which changes nothing
//! because columns keep their sums, that is the derivative of Σ m_ij ln A_ij with the counts
//! m_ij = n_ij + A_ij π_j (h_i + c), for any c. So maximising this sum, as without the prior, is a
//! step uphill, and shorter for a larger c; c is chosen large enough that Q gains too.
//!
//! Steps are repeated, each with π and h of the last operator, until they gain nothing (or 200 were
//! taken, fewer with more than 110 states; the next E-step then continues from there). They end
//! only where the derivative of Q vanishes, whatever c was, under all constraints of the operator
//! (ties, fixed entries).

use crate::belief::Belief;
use crate::error::{LearnError, Parameter};
use crate::transition::{LearnTransition, Move, Stationary, stationary_control};

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
pub(super) fn maximize<A: LearnTransition>(
    transition: &A,
    statistics: &A::Statistics,
    first: &[f64],
    pseudo_count: f64,
) -> Result<(A, Belief), LearnError> {
    let expected = Expected { statistics, first, pseudo_count };
    let mut extra = 1.0;
    let here = expected.point(transition)?;
    let mut step = expected.climb(transition, &here, &mut extra)?;
    let operations = transition.states().saturating_pow(3).max(1);
    for _ in 1..(OPERATIONS / operations).clamp(STEPS.0, STEPS.1) {
        if step.promised <= rounding(step.point.value) {
            break;
        }
        step = expected.climb(&step.learned, &step.point, &mut extra)?;
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
    promised: f64,
}

impl<A: LearnTransition> Expected<'_, A> {
    fn point(&self, transition: &A) -> Result<Point, LearnError> {
        let chain = Stationary::of(transition)?;
        let prior = chain.distribution();
        let moves = transition.log_probability(self.statistics).ok_or(LearnError::Stationary)?;
        // Q: moves, then starts Σ F(i) ln π(i), then the log prior of the operator.
        let first = || self.first.iter().zip(prior.as_slice());
        let starts = first().filter(|(seen, _)| **seen > 0.0).map(|(seen, p)| seen * p.ln());
        let value = moves + starts.sum::<f64>() + transition.log_prior(self.pseudo_count);
        let rewards: Vec<f64> =
            first().map(|(seen, p)| if *seen > 0.0 { seen / p } else { 0.0 }).collect();
        let mut potentials = chain.potentials(&rewards);
        if let Some(state) = potentials.iter().position(|h| !h.is_finite()) {
            let what = format!("the derivative of the log-likelihood by moves to state {state}");
            return Err(Parameter::new(what, potentials[state], "a finite value").into());
        }
        // h is defined up to a constant: with a least value of 0 in the recurrent class, the counts
        // m_ij are not negative for any c ≥ 0.
        let least = chain.class().map(|state| potentials[state]).fold(f64::INFINITY, f64::min);
        chain.class().for_each(|state| potentials[state] -= least);
        Ok(Point { prior, potentials, value })
    }

    /// Takes a step from an operator, the longest tried for which Q gains a fair share of what
    /// Σ m_ij ln A_ij does. (Otherwise steps may overshoot the maximum, back and forth.)
    fn climb(&self, transition: &A, here: &Point, extra: &mut f64) -> Result<Step<A>, LearnError> {
        loop {
            let counts = self.counts(transition, here, *extra)?;
            let learned = transition.maximize(&counts, self.pseudo_count)?;
            let [before, after] = [transition, &learned].map(|transition| {
                let moves = transition.log_probability(&counts).unwrap_or(f64::NEG_INFINITY);
                moves + transition.log_prior(self.pseudo_count)
            });
            let promised = after - before;
            let tolerance = rounding(here.value) + rounding(before);
            // An error here means that the chain has come apart and has no stationary distribution:
            // the step was too long.
            let next = self.point(&learned);
            let is_fair = |next: &Point| next.value - here.value >= FAIR * promised - tolerance;
            if *extra >= MOST || next.as_ref().is_ok_and(is_fair) {
                *extra = f64::max(*extra / 2.0, LEAST);
                return Ok(Step { learned, point: next?, promised });
            }
            *extra *= 4.0;
        }
    }

    /// Returns the counts m_ij = n_ij + A_ij π_j (h_i + c).
    fn counts(
        &self,
        transition: &A,
        here: &Point,
        extra: f64,
    ) -> Result<A::Statistics, LearnError> {
        let control = stationary_control(transition)?;
        let constant = extra * here.potentials.iter().copied().fold(0.0, f64::max);
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
