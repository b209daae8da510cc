//! Log-likelihoods in lock-step.

use super::{Group, Memory, Outcome, Plan, Rows};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// ln p(y_1 … y_T) of each lane.
pub(in super::super) fn score<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
    _: Rows<'_>,
) -> Outcome<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let forward = plan.forward(group, memory, false, |_, _| ());
    std::array::from_fn(|l| forward.held[l].then(|| forward.log_likelihoods[l].value()))
}
