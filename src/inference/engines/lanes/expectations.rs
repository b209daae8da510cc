//! Expectations of learning, in lanes: Σ γ and Σ ξ over the steps of eight sequences (section 9 of
//! the [formulas](crate::guide::formulas)).

use super::{Group, LaneMemory, LaneModel};
use crate::kernels::{self, LANES, Lines, Packed};
use crate::likelihood::LearnLikelihood;
use crate::limits::BACK_LIFT;
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Move, MoveCounts};

/// Expectations of the sequences of a group, added up over its valid lanes.
pub(crate) struct LaneExpectations<T> {
    /// Σ p(X_0 | y_1 … y_T).
    pub(crate) first: Vec<f64>,
    /// Moves of the only family, if they are counted.
    pub(crate) moves: Option<MoveCounts>,
    /// Statistics of the sensor.
    pub(crate) sensor: T,
    /// ln p(y_1 … y_T) of each valid lane; the sequences of the others are not in the sums.
    pub(crate) log_likelihoods: [Option<f64>; LANES],
}

impl<A: LearnTransition, B: LearnLikelihood> LaneModel<'_, A, B> {
    /// Returns the expectations of the sequences of a group.
    pub(crate) fn expectations<S>(
        &self,
        group: &Group<'_, S>,
        memory: &mut LaneMemory,
    ) -> LaneExpectations<B::Statistics>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let n = self.states();
        let mut forward = self.forward(group, memory, true, |_, _| ());
        let transition = self.hmm.transition();
        let in_family = |control| transition.family(control) < transition.families();
        let counted = transition.no_control().is_some_and(in_family);
        let entries = if counted { self.columns.values().len() } else { 0 };
        // Without A, which is the same at all steps and is multiplied in at the end.
        let mut counts = vec![Packed::default(); entries];
        self.backward(group, memory, &mut forward.valid, counted.then_some(&mut counts));
        let log_likelihoods = forward.log_likelihoods();
        let valid = forward.valid;
        let mut first = vec![0.0; n];
        for l in (0..LANES).filter(|l| valid[*l]) {
            // The first n beliefs are those of step 0.
            first.iter_mut().zip(&memory.beliefs).for_each(|(sum, gamma)| *sum += gamma[l]);
        }
        // The sensor's statistics take a second walk over the steps: a lane may become invalid at
        // any step of the way back, and nothing of it may have been added then.
        let mut sensor = self.hmm.likelihood().statistics();
        let mut rows = vec![0.0; n * LANES];
        for step in 1..=group.longest {
            let mut row = rows.chunks_exact_mut(n);
            let out = std::array::from_fn(|_| row.next().unwrap_or_default());
            kernels::unpack(&memory.beliefs[step * n..][..n], out);
            for (l, (row, (_, sequence))) in rows.chunks_exact(n).zip(group.sequences).enumerate() {
                if valid[l] && step <= group.steps[l] {
                    self.hmm.likelihood().add(&mut sensor, sequence.observation(step), row);
                }
            }
        }
        let moves = counted.then(|| move_counts(self.columns, n, &counts, valid));
        LaneExpectations { first, moves, sensor, log_likelihoods }
    }
}

/// Moves of the valid lanes: α(j) A\[i, j\] γ(i) / p(i), where `counts` has the sums over
/// the steps but for A.
fn move_counts(
    columns: Lines<'_>,
    n: usize,
    counts: &[Packed],
    valid: [bool; LANES],
) -> MoveCounts {
    let weight = |p: f64, counts: &Packed| {
        let sum: f64 = counts.iter().zip(valid).filter(|c| c.1).map(|c| c.0).sum();
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
            // Entries that are 0, and the padding of lines, are no moves: they would be listed as
            // such.
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
