//! The filter in lock-step. Beliefs are lifted as a single step does where it must.

use super::{Group, Memory, Plan};
use crate::inference::LogSum;
use crate::kernels::lockstep::{self, Abreast, Update};
use crate::kernels::{LANES, LIFT};
use crate::likelihood::Likelihood;
use crate::range::LEAST_NORMALIZER as LEAST_NORMALISER;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// What the filter says of each lane.
pub(super) struct Forward {
    /// Whether doubles have held it, and there was no error.
    pub(super) held: [bool; LANES],
    pub(super) log_likelihoods: [LogSum; LANES],
}

impl<A: Transition, B: Likelihood> Plan<'_, A, B> {
    /// Filters a group. Keeps beliefs and likelihoods of all steps if it is to.
    /// Hands ln p(y_k | y_1 … y_{k-1}) of each lane and step to `each`.
    pub(super) fn forward<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut Memory,
        keep: bool,
        mut each: impl FnMut(usize, f64),
    ) -> Forward
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let prior = self.hmm.prior();
        let start = prior.belief().as_slice();
        let n = self.ones.len();
        let kept = if keep { group.longest } else { 0 };
        memory.fit(n, kept, group.longest);
        let Memory { alpha, likelihoods, inverse, x, next, lanes, .. } = memory;
        for ((x, alpha), p) in x.iter_mut().zip(&mut *alpha).zip(start) {
            (*x, *alpha) = (Abreast([p * LIFT; LANES]), Abreast([*p; LANES]));
        }
        let (mut held, mut log_likelihoods) = (group.lanes(), [LogSum::default(); LANES]);
        for step in 1..=group.longest {
            let row = if keep { step } else { 0 };
            let alpha = &mut alpha[row * n..][..n];
            let likelihoods = &mut likelihoods[row.saturating_sub(1) * n..][..n];
            let sensed = self.sense(group, step, lanes, &mut held, likelihoods);
            let matrix = prior.moves_at(step).then_some(self.rows);
            let sums = lockstep::update(Update { matrix, x, likelihoods, out: next });
            let lost = lockstep::settle(next, alpha, sums);
            std::mem::swap(x, next);
            let inverse = &mut inverse[step - 1];
            for l in 0..LANES {
                let normalizer = sums[l] / LIFT;
                inverse[l] = 1.0 / normalizer;
                // A NaN does not hold either.
                held[l] &= step > group.steps[l]
                    || normalizer >= LEAST_NORMALISER * sensed.largest[l]
                        && normalizer.is_finite()
                        && (!lost[l] || self.hmm.rounds_tails());
                if held[l] && step <= group.steps[l] {
                    let log = normalizer.ln() + sensed.logs[l];
                    log_likelihoods[l].add(log);
                    each(l, log);
                }
                if !inverse[l].is_normal() {
                    // A lane that does not hold goes on from the prior: no infinity or
                    // NaN stays in memory that other sequences use.
                    inverse[l] = 1.0;
                    for ((x, alpha), p) in x.iter_mut().zip(&mut *alpha).zip(start) {
                        (x[l], alpha[l]) = (p * LIFT, *p);
                    }
                }
            }
            if held == [false; LANES] {
                break;
            }
        }
        Forward { held, log_likelihoods }
    }
}

impl Memory {
    /// Makes room for steps to keep and to go through.
    fn fit(&mut self, states: usize, kept: usize, steps: usize) {
        let grow = |room: &mut Vec<Abreast>, count: usize| {
            if room.len() < count {
                room.resize(count, Abreast::default());
            }
        };
        grow(&mut self.alpha, (states * (kept + 1)).next_multiple_of(LANES));
        grow(&mut self.likelihoods, states * kept.max(1));
        grow(&mut self.inverse, steps);
        for room in [&mut self.x, &mut self.next, &mut self.q, &mut self.ratio, &mut self.gamma] {
            room.resize(states, Abreast::default());
        }
    }
}
