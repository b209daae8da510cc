//! The filter in lanes. Beliefs are lifted, as a single step does where it must.

use super::{BatchMemory, BatchModel, Group, GroupRows, Outcome};
use crate::inference::LogSum;
use crate::kernels::{self, LANES, Packed};
use crate::likelihood::Likelihood;
use crate::limits::{LEAST_NORMALIZER, LIFT};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Results of the forward pass for each lane.
pub(crate) struct Forward {
    /// True if linear space has held it, and there was no error.
    pub(crate) held: [bool; LANES],
    pub(crate) log_likelihoods: [LogSum; LANES],
}

/// [`Hmm::forward`](crate::Hmm::forward): log-likelihoods of each step and of all, beside the rows.
pub(crate) fn filter<A, B, S>(
    model: &BatchModel<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut BatchMemory,
    rows: GroupRows<'_>,
) -> Outcome<(Vec<f64>, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
    let forward = model.forward(group, memory, true, |lane, log| logs[lane].push(log));
    rows.fill(group, &memory.alpha, forward.held);
    let mut logs = logs.into_iter();
    std::array::from_fn(|l| {
        let logs = logs.next()?;
        forward.held[l].then(|| (logs, forward.log_likelihoods[l].value()))
    })
}

/// [`Hmm::log_likelihood`](crate::Hmm::log_likelihood).
pub(crate) fn log_likelihood<A, B, S>(
    model: &BatchModel<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut BatchMemory,
    _: GroupRows<'_>,
) -> Outcome<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let forward = model.forward(group, memory, false, |_, _| ());
    std::array::from_fn(|l| forward.held[l].then(|| forward.log_likelihoods[l].value()))
}

impl<A: Transition, B: Likelihood> BatchModel<'_, A, B> {
    /// Filters a group, and keeps beliefs and likelihoods of all steps with `keep`. Passes
    /// ln p(y_k | y_1 … y_{k-1}) of each lane and step to `each`.
    pub(crate) fn forward<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut BatchMemory,
        keep: bool,
        mut each: impl FnMut(usize, f64),
    ) -> Forward
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let prior = self.hmm.prior();
        let start = prior.belief().as_slice();
        let n = self.ones.len();
        memory.fit(n, if keep { group.longest } else { 0 }, group.longest);
        let BatchMemory { alpha, likelihoods, inverse, x, next, lanes, .. } = memory;
        for ((x, alpha), p) in x.iter_mut().zip(&mut *alpha).zip(start) {
            (*x, *alpha) = (Packed([p * LIFT; LANES]), Packed([*p; LANES]));
        }
        let (mut held, mut log_likelihoods) = (group.lanes(), [LogSum::default(); LANES]);
        for step in 1..=group.longest {
            let row = if keep { step } else { 0 };
            let alpha = &mut alpha[row * n..][..n];
            let likelihoods = &mut likelihoods[row.saturating_sub(1) * n..][..n];
            let taken = self.likelihoods(group, step, lanes, &mut held, likelihoods);
            let matrix = prior.moves_at(step).then_some(self.rows);
            let sums = kernels::batch_forward(matrix, x, likelihoods, next);
            let lost = kernels::batch_normalize(next, alpha, sums);
            std::mem::swap(x, next);
            let inverse = &mut inverse[step - 1];
            for l in 0..LANES {
                let normalizer = sums[l] / LIFT;
                inverse[l] = 1.0 / normalizer;
                // A NaN does not hold either.
                held[l] &= step > group.steps[l]
                    || normalizer >= LEAST_NORMALIZER * taken.largest[l]
                        && normalizer.is_finite()
                        && (!lost[l] || self.hmm.rounds_tails());
                if held[l] && step <= group.steps[l] {
                    let log = normalizer.ln() + taken.logs[l];
                    log_likelihoods[l].add(log);
                    each(l, log);
                }
                if !inverse[l].is_normal() {
                    // A marked lane continues from the prior: no infinity or NaN stays in memory
                    // that other sequences use.
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
