//! What learning expects of the hidden states, in lock-step.

use super::backward::Carried;
use super::{Group, Memory, Plan};
use crate::inference::baum_welch::Expected;
use crate::kernels::lockstep::{self, Abreast, Lines};
use crate::kernels::{BACK_LIFT, LANES};
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Move, MoveCounts};

/// The expectations of the sequences of a group, added up, and in which lanes it
/// could have them.
pub(in super::super) fn expect<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
) -> (Expected<B>, [bool; LANES])
where
    A: LearnTransition,
    B: LearnLikelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let n = plan.ones.len();
    let forward = plan.forward(group, memory, true, |_, _| ());
    let (mut held, mut carried) = (forward.held, Carried::new(memory));
    let transition = plan.hmm.transition();
    let counted = transition
        .no_control()
        .is_some_and(|control| transition.family(control) < transition.families());
    let mut counts =
        if counted { vec![Abreast::default(); plan.columns.values().len()] } else { Vec::new() };
    for step in (1..=group.longest).rev() {
        if held == [false; LANES] {
            break;
        }
        if plan.hmm.prior().moves_at(step) {
            // In lanes whose last step this is, γ is α.
            plan.retreat(group, step, memory, &mut carried, &mut held);
            let Memory { alpha, ratio, gamma, .. } = &mut *memory;
            let before = &mut alpha[(step - 1) * n..step * n];
            if counted {
                lockstep::count(plan.columns, before, ratio, &mut counts);
            }
            before.copy_from_slice(gamma);
        } else {
            memory.alpha.copy_within(n..2 * n, 0);
        }
    }
    let mut expected = plan.hmm.nothing_expected();
    if let Some(moves) = expected.moves.first_mut().filter(|_| counted) {
        *moves = move_counts(plan.columns, n, &counts, held);
    }
    for l in (0..LANES).filter(|l| held[*l]) {
        expected.log_likelihood.add(forward.log_likelihoods[l].value());
        expected.first.iter_mut().zip(&memory.alpha).for_each(|(sum, gamma)| *sum += gamma[l]);
    }
    // Only now is it known which lanes have held all the way.
    let mut rows = vec![0.0; n * LANES];
    for step in 1..=group.longest {
        let mut row = rows.chunks_exact_mut(n);
        let out = std::array::from_fn(|_| row.next().unwrap_or_default());
        lockstep::scatter(&memory.alpha[step * n..][..n], out);
        for (l, (row, (_, sequence))) in rows.chunks_exact(n).zip(group.sequences).enumerate() {
            if held[l] && step <= group.steps[l] {
                let observation = sequence.observation(step);
                plan.hmm.likelihood().add(&mut expected.sensor, observation, row);
            }
        }
    }
    (expected, held)
}

/// The moves of the lanes that have held: α(j) A\[i, j\] γ(i) / p(i), summed over
/// the steps but for A.
fn move_counts(
    columns: Lines<'_>,
    n: usize,
    counts: &[Abreast],
    held: [bool; LANES],
) -> MoveCounts {
    let weight = |p: f64, counts: &Abreast| {
        let sum: f64 = counts.iter().zip(held).filter(|c| c.1).map(|c| c.0).sum();
        p * sum / BACK_LIFT
    };
    let mut moves = MoveCounts::default();
    match columns {
        Lines::Sparse { starts, indices, values } => {
            let column = |j: usize| starts[j] as usize..starts[j + 1] as usize;
            moves.add((0..n).flat_map(|j| column(j).map(move |at| (j, at))).map(|(from, at)| {
                Move { from, to: indices[at] as usize, weight: weight(values[at], &counts[at]) }
            }));
        }
        Lines::Dense { values } | Lines::DenseTransposed { values } => {
            let stride = values.len() / n;
            let entries = values.iter().zip(counts).enumerate().filter(|entry| *entry.1.0 > 0.0);
            moves.add(entries.map(|(at, (p, counts))| Move {
                from: at / stride,
                to: at % stride,
                weight: weight(*p, counts),
            }));
        }
    }
    moves
}
