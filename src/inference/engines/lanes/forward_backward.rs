//! Forward–backward in lanes: α_k = (A α_{k-1}) ∘ b / N_k forward, and backward q = A' (q ∘ b / N),
//! γ = α ∘ q (sections 2 and 3 of the [formulas](crate::guide::formulas)).
//!
//! Beliefs are lifted at all steps, as those of one sequence are where they must be, so that both
//! have the same digits.

use super::{Group, LaneMemory, LaneModel};
use crate::inference::LogSum;
use crate::kernels::{self, LANES, Packed};
use crate::likelihood::Likelihood;
use crate::limits::{self, BACK_LIFT, LEAST_NORMALIZER, LIFT};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Results of the passes for each lane.
pub(crate) struct LaneForward {
    /// True while linear space holds the sequence of a lane, and there is no error.
    pub(super) valid: [bool; LANES],
    pub(super) log_likelihoods: [LogSum; LANES],
}

impl LaneForward {
    /// Returns ln p(y_1 … y_T) of the valid lanes.
    pub(crate) fn log_likelihoods(&self) -> [Option<f64>; LANES] {
        std::array::from_fn(|l| self.valid[l].then(|| self.log_likelihoods[l].value()))
    }
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Filters a group: leaves beliefs in the memory, and returns the log-likelihoods of each step
    /// and of all.
    pub(crate) fn filter<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
    ) -> [Option<(Vec<f64>, f64)>; LANES]
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
        let forward = self.forward(group, memory, true, |lane, log| logs[lane].push(log));
        let mut sums = forward.log_likelihoods().into_iter();
        logs.map(|logs| sums.next().flatten().map(|sum| (logs, sum)))
    }

    /// Computes the log-likelihoods of a group.
    pub(crate) fn log_likelihood<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
    ) -> [Option<f64>; LANES]
    where
        S: Sequence<A::Control, B::Observation>,
    {
        self.forward(group, memory, false, |_, _| ()).log_likelihoods()
    }

    /// Smooths a group: leaves beliefs in the memory, and returns the log-likelihoods.
    pub(crate) fn smooth<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
    ) -> [Option<f64>; LANES]
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut forward = self.forward(group, memory, true, |_, _| ());
        self.backward(group, memory, &mut forward.valid, None);
        forward.log_likelihoods()
    }

    /// Filters a group, and stores beliefs and likelihoods of all steps if `stores`. Passes
    /// ln p(y_k | y_1 … y_{k-1}) of each lane and step to `visit`.
    pub(crate) fn forward<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
        stores: bool,
        mut visit: impl FnMut(usize, f64),
    ) -> LaneForward
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let prior = self.hmm.prior();
        let start = prior.belief().as_slice();
        let n = self.states();
        memory.fit(n, if stores { group.longest } else { 0 }, group.longest);
        let LaneMemory { beliefs, likelihoods, inverse, x, next, lanes, .. } = memory;
        for ((x, belief), p) in x.iter_mut().zip(&mut *beliefs).zip(start) {
            (*x, *belief) = (Packed([p * LIFT; LANES]), Packed([*p; LANES]));
        }
        let (mut valid, mut log_likelihoods) = (group.lanes(), [LogSum::default(); LANES]);
        for step in 1..=group.longest {
            let row = if stores { step } else { 0 };
            let belief = &mut beliefs[row * n..][..n];
            let likelihoods = &mut likelihoods[row.saturating_sub(1) * n..][..n];
            let scales = self.likelihoods(group, step, lanes, &mut valid, likelihoods);
            let matrix = prior.moves_at(step).then_some(self.rows);
            let sums = kernels::batch_forward(matrix, x, likelihoods, next);
            let lost = kernels::batch_normalize(next, belief, sums);
            std::mem::swap(x, next);
            let inverse = &mut inverse[step - 1];
            for l in 0..LANES {
                let normalizer = sums[l] / LIFT;
                inverse[l] = 1.0 / normalizer;
                // The conditions of `limits::holds` for predictions that sum to one; a NaN fails
                // them. A sequence that has ended goes on with likelihoods of one, unlooked at.
                valid[l] &= step > group.steps[l]
                    || normalizer >= LEAST_NORMALIZER * scales.largest[l]
                        && normalizer.is_finite()
                        && (!lost[l] || self.hmm.rounds_tails());
                if valid[l] && step <= group.steps[l] {
                    let log = normalizer.ln() + scales.logs[l];
                    log_likelihoods[l].add(log);
                    visit(l, log);
                }
                if !inverse[l].is_normal() {
                    // An invalid lane goes on from the prior, so that no infinity or NaN slows the
                    // vectors down, or stays in memory that later groups use.
                    inverse[l] = 1.0;
                    for ((x, belief), p) in x.iter_mut().zip(&mut *belief).zip(start) {
                        (x[l], belief[l]) = (p * LIFT, *p);
                    }
                }
            }
            if valid == [false; LANES] {
                break;
            }
        }
        LaneForward { valid, log_likelihoods }
    }

    /// Replaces the stored beliefs of all steps by smoothed ones, from the last, and adds
    /// α(j) γ(i) / p(i), lifted, to the counts of the columns' entries.
    pub(crate) fn backward<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
        valid: &mut [bool; LANES],
        mut counts: Option<&mut [Packed]>,
    ) {
        let n = self.states();
        // A lane whose sequence is shorter than the longest begins later, from these zeros: 0 times
        // an infinity that an earlier group left would be NaN.
        memory.q.fill(Packed::default());
        let mut sums = [1.0; LANES];
        let LaneMemory { beliefs, likelihoods, inverse, q, ratio, .. } = memory;
        for step in (1..=group.longest).rev() {
            if *valid == [false; LANES] {
                break;
            }
            if !self.hmm.prior().moves_at(step) {
                beliefs.copy_within(n..2 * n, 0); // X_0 is the same state as X_1
                continue;
            }
            // A factor of 0 keeps the belief of a lane as it is.
            let mut factors = [0.0; LANES];
            for l in 0..LANES {
                if step == group.steps[l] {
                    // γ_T = α_T, so that γ / α is one in all states.
                    q.iter_mut().for_each(|q| q[l] = BACK_LIFT);
                    sums[l] = 1.0;
                }
                if step <= group.steps[l] && valid[l] {
                    // Divided by the sum of the last γ, whose rounding would add up otherwise.
                    factors[l] = inverse[step - 1][l] / sums[l];
                }
            }
            let before = &mut beliefs[(step - 1) * n..][..n];
            let likelihoods = &likelihoods[(step - 1) * n..][..n];
            kernels::batch_ratio(q, likelihoods, factors, ratio);
            if let Some(counts) = &mut counts {
                kernels::count_moves(self.columns, before, ratio, counts);
            }
            sums = kernels::batch_backward(self.columns, factors, ratio, before, q);
            for (l, valid) in valid.iter_mut().enumerate() {
                // A step back conserves Σ γ. What overflows or is lost shows in it (`limits`, "The
                // way back").
                if *valid && step <= group.steps[l] && !limits::is_one(sums[l]) {
                    *valid = false;
                    q.iter_mut().for_each(|q| q[l] = 0.0);
                }
            }
        }
    }
}
