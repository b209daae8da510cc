//! The smoother in lock-step.

use super::backward::Carried;
use super::{Group, Memory, Outcome, Plan};
use crate::inference::posteriors::Posteriors;
use crate::inference::smoother::Smoothing;
use crate::kernels::LANES;
use crate::kernels::lockstep::{self, Abreast};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// What [`Hmm::smooth`](crate::Hmm::smooth) gives, of each lane.
pub(in super::super) fn smooth<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
) -> Outcome<Smoothing>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let n = plan.ones.len();
    let forward = plan.forward(group, memory, true, |_, _| ());
    let mut held = forward.held;
    let (mut rows, mut carried) = (Rows::new(n, group, held), Carried::new());
    for step in (1..=group.longest).rev() {
        rows.end(group, step, &memory.alpha[step * n..][..n]);
        if plan.hmm.prior().moves_at(step) {
            plan.retreat(group, step, memory, &mut carried, &mut held);
            rows.put(group, step - 1, &memory.gamma);
        } else {
            // The same state as the next.
            rows.values
                .iter_mut()
                .filter(|v| !v.is_empty())
                .for_each(|v| v.copy_within(n..2 * n, 0));
        }
        if held == [false; LANES] {
            break;
        }
    }
    let mut values = rows.values.into_iter();
    std::array::from_fn(|l| {
        let posteriors = Posteriors::from_values(n, values.next()?);
        held[l].then(|| Smoothing::new(posteriors, forward.log_likelihoods[l].value()))
    })
}

/// The rows of the results: one for each step from 0, in each lane.
pub(super) struct Rows {
    states: usize,
    pub(super) values: [Vec<f64>; LANES],
    /// For lanes that have no such step.
    spare: Vec<f64>,
}

impl Rows {
    /// Rows for the lanes that are held.
    pub(super) fn new<S>(states: usize, group: &Group<'_, S>, held: [bool; LANES]) -> Self {
        let values = std::array::from_fn(|l| {
            if held[l] { vec![0.0; states * (group.steps[l] + 1)] } else { Vec::new() }
        });
        Self { states, values, spare: vec![0.0; states * LANES] }
    }

    /// Writes the row of a step of each lane that has it.
    pub(super) fn put<S>(&mut self, group: &Group<'_, S>, step: usize, from: &[Abreast]) {
        let n = self.states;
        let mut spare = self.spare.chunks_exact_mut(n);
        let mut values = self.values.iter_mut();
        let rows = std::array::from_fn(|l| match (values.next(), spare.next()) {
            (Some(values), Some(spare)) if values.is_empty() || step > group.steps[l] => spare,
            (Some(values), _) => &mut values[step * n..(step + 1) * n],
            _ => &mut [],
        });
        lockstep::scatter(from, rows);
    }

    /// Writes the last row of each lane that ends with this step.
    fn end<S>(&mut self, group: &Group<'_, S>, step: usize, from: &[Abreast]) {
        for (l, values) in self.values.iter_mut().enumerate() {
            if step == group.steps[l] && !values.is_empty() {
                let row = &mut values[step * self.states..];
                row.iter_mut().zip(from).for_each(|(out, from)| *out = from[l]);
            }
        }
    }
}
