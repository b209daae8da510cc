//! Expectations of learning, in lanes.

use super::{BatchMemory, BatchModel, Group};
use crate::inference::learning::expectations::Expectations;
use crate::kernels::{self, LANES, Lines, Packed};
use crate::likelihood::LearnLikelihood;
use crate::limits::BACK_LIFT;
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Move, MoveCounts};

/// Returns the expectations of the sequences of a group, added up, and the lanes that have them.
pub(crate) fn expect<A, B, S>(
    model: &BatchModel<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut BatchMemory,
) -> (Expectations<B>, [bool; LANES])
where
    A: LearnTransition,
    B: LearnLikelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let n = model.ones.len();
    let forward = model.forward(group, memory, true, |_, _| ());
    let mut held = forward.held;
    let transition = model.hmm.transition();
    let in_family = |control| transition.family(control) < transition.families();
    let counted = transition.no_control().is_some_and(in_family);
    let entries = if counted { model.columns.values().len() } else { 0 };
    let mut counts = vec![Packed::default(); entries];
    model.backward(group, memory, &mut held, counted.then_some(&mut counts));
    let mut expected = model.hmm.no_expectations();
    if let Some(moves) = expected.moves.first_mut().filter(|_| counted) {
        *moves = move_counts(model.columns, n, &counts, held);
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
        kernels::unpack(&memory.alpha[step * n..][..n], out);
        for (l, (row, (_, sequence))) in rows.chunks_exact(n).zip(group.sequences).enumerate() {
            if held[l] && step <= group.steps[l] {
                let observation = sequence.observation(step);
                model.hmm.likelihood().add(&mut expected.sensor, observation, row);
            }
        }
    }
    (expected, held)
}

/// Moves of the lanes that have held: α(j) A\[i, j\] γ(i) / p(i), where `counts` has the sums over
/// the steps but for A.
fn move_counts(columns: Lines<'_>, n: usize, counts: &[Packed], held: [bool; LANES]) -> MoveCounts {
    let weight = |p: f64, counts: &Packed| {
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
