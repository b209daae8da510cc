//! The smoother in lanes: see [`backward`](crate::inference::step::backward).

use super::{BatchMemory, BatchModel, Group, GroupRows, Outcome};
use crate::kernels::{self, LANES, Lines, Packed};
use crate::likelihood::Likelihood;
use crate::limits::{self, BACK_LIFT};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// [`Hmm::smooth`](crate::Hmm::smooth): log-likelihoods, beside the rows.
pub(crate) fn smooth<A, B, S>(
    model: &BatchModel<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut BatchMemory,
    rows: GroupRows<'_>,
) -> Outcome<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let forward = model.forward(group, memory, true, |_, _| ());
    let mut held = forward.held;
    model.backward(group, memory, &mut held, None);
    rows.fill(group, &memory.alpha, held);
    std::array::from_fn(|l| held[l].then(|| forward.log_likelihoods[l].value()))
}

impl<A: Transition, B: Likelihood> BatchModel<'_, A, B> {
    /// Replaces the beliefs of all steps by smoothed ones, from the last, and adds
    /// α(j) γ(i) / p(i), lifted, to the counts of the columns' entries. Lanes start at their last
    /// step. Marks lanes that do not hold.
    pub(crate) fn backward<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut BatchMemory,
        held: &mut [bool; LANES],
        mut counts: Option<&mut [Packed]>,
    ) {
        let n = self.ones.len();
        let columns: Lines<'_> = self.columns;
        // Lanes that begin later must not find what other sequences left.
        memory.q.fill(Packed::default());
        let mut sums = [1.0; LANES];
        let BatchMemory { alpha, likelihoods, inverse, q, ratio, .. } = memory;
        for step in (1..=group.longest).rev() {
            if *held == [false; LANES] {
                break;
            }
            if !self.hmm.prior().moves_at(step) {
                alpha.copy_within(n..2 * n, 0); // the same state as the next
                continue;
            }
            let mut factors = [0.0; LANES];
            for l in 0..LANES {
                if step == group.steps[l] {
                    q.iter_mut().for_each(|q| q[l] = BACK_LIFT);
                    sums[l] = 1.0;
                }
                if step <= group.steps[l] && held[l] {
                    factors[l] = inverse[step - 1][l] / sums[l];
                }
            }
            let before = &mut alpha[(step - 1) * n..][..n];
            let likelihoods = &likelihoods[(step - 1) * n..][..n];
            kernels::batch_ratio(q, likelihoods, factors, ratio);
            if let Some(counts) = &mut counts {
                kernels::count_moves(columns, before, ratio, counts);
            }
            sums = kernels::batch_backward(columns, factors, ratio, before, q);
            for (l, held) in held.iter_mut().enumerate() {
                if *held && step <= group.steps[l] && !limits::is_one(sums[l]) {
                    *held = false;
                    q.iter_mut().for_each(|q| q[l] = 0.0);
                }
            }
        }
    }
}
