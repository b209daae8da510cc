//! Filtered distributions in lock-step.

use super::{Group, Memory, Outcome, Plan, Rows};
use crate::kernels::LANES;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// What [`Hmm::forward`](crate::Hmm::forward) gives: the rows, and the log-likelihoods of
/// each step and of all, of each lane.
pub(in super::super) fn filter<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
    rows: Rows<'_>,
) -> Outcome<(Vec<f64>, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
    let forward = plan.forward(group, memory, true, |lane, log| logs[lane].push(log));
    rows.fill(group, &memory.alpha, forward.held);
    let mut logs = logs.into_iter();
    std::array::from_fn(|l| {
        let logs = logs.next()?;
        forward.held[l].then(|| (logs, forward.log_likelihoods[l].value()))
    })
}
