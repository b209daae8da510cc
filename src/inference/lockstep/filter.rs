//! Filtered distributions in lock-step.

use super::{Group, Memory, Outcome, Plan};
use crate::inference::filtering::Filtering;
use crate::inference::posteriors::Posteriors;
use crate::kernels::LANES;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

use super::smooth::Rows;

/// What [`Hmm::forward`](crate::Hmm::forward) gives, of each lane.
pub(in super::super) fn filter<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
) -> Outcome<Filtering>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let n = plan.ones.len();
    let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
    let forward = plan.forward(group, memory, true, |lane, log| logs[lane].push(log));
    let mut rows = Rows::new(n, group, forward.held);
    for step in 0..=group.longest {
        rows.put(group, step, &memory.alpha[step * n..][..n]);
    }
    let mut parts = rows.values.into_iter().zip(logs);
    std::array::from_fn(|l| {
        let (values, logs) = parts.next()?;
        let log_likelihood = forward.log_likelihoods[l].value();
        let posteriors = Posteriors::from_values(n, values);
        forward.held[l].then(|| Filtering::new(posteriors, logs, log_likelihood))
    })
}
