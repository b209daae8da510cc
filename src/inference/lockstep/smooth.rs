//! The smoother in lock-step.

use super::backward::Carried;
use super::{Group, Memory, Outcome, Plan, Rows};
use crate::kernels::LANES;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// What [`Hmm::smooth`](crate::Hmm::smooth) gives: the rows, and the log-likelihood, of
/// each lane.
pub(in super::super) fn smooth<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
    rows: Rows<'_>,
) -> Outcome<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let n = plan.ones.len();
    let forward = plan.forward(group, memory, true, |_, _| ());
    let (mut held, mut carried) = (forward.held, Carried::new(memory));
    for step in (1..=group.longest).rev() {
        if held == [false; LANES] {
            break;
        }
        if plan.hmm.prior().moves_at(step) {
            // In lanes whose last step this is, γ is α.
            plan.retreat(group, step, memory, &mut carried, &mut held);
            memory.alpha[(step - 1) * n..step * n].copy_from_slice(&memory.gamma);
        } else {
            // The same state as the next.
            memory.alpha.copy_within(n..2 * n, 0);
        }
    }
    rows.fill(group, &memory.alpha, held);
    std::array::from_fn(|l| held[l].then(|| forward.log_likelihoods[l].value()))
}
