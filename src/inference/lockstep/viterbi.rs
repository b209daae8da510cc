//! Viterbi in lock-step. Sums of scores are exact, so that paths and their
//! probabilities are those of the general routine to the bit.

use super::{Group, Lane, Memory, Outcome, Plan, Rows};
use crate::inference::ViterbiPath;
use crate::inference::scores::{TakenOut, best, likelihood_scores};
use crate::inference::step::Step;
use crate::kernels::lockstep::{self, Abreast};
use crate::kernels::lockstep_max::{self, Maximize};
use crate::kernels::{self, LANES};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// What [`Hmm::viterbi`](crate::Hmm::viterbi) gives, of each lane.
pub(in super::super) fn viterbi<A, B, S>(
    plan: &Plan<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut Memory,
    _: Rows<'_>,
) -> Outcome<ViterbiPath>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let mut paths = [const { None }; LANES];
    let n = plan.ones.len();
    let mut first = vec![0.0; n];
    let control =
        if plan.hmm.prior().moves_at(1) { plan.hmm.transition().no_control() } else { None };
    if (Step { hmm: plan.hmm, number: 1, control })
        .first_scores(&mut first, &mut TakenOut::default())
        .is_err()
    {
        return paths;
    }
    let log2 =
        plan.log2.get_or_init(|| plan.rows.values().iter().map(|p| kernels::log2(*p)).collect());
    let mut x: Vec<Abreast> = first.iter().map(|score| Abreast([*score; LANES])).collect();
    let (mut next, mut likelihoods) = (x.clone(), x.clone());
    let mut from = vec![[0; LANES]; n * group.longest.saturating_sub(1)];
    let mut held = group.lanes();
    let mut taken_out: [TakenOut; LANES] = Default::default();
    for step in 1..=group.longest {
        let mut shifts = [0.0; LANES];
        let mut rows = [&plan.zeros[..]; LANES];
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(&mut memory.lanes).enumerate()
        {
            if !held[l] || step > group.steps[l] {
                continue;
            }
            let seen = plan.scores(sequence.observation(step), lane, &mut taken_out[l]);
            match seen {
                Some((scores, shift)) => (rows[l], shifts[l]) = (scores, shift),
                None => held[l] = false,
            }
        }
        lockstep::gather(rows, &mut likelihoods);
        let largest = if step == 1 {
            let mut largest = [f64::NEG_INFINITY; LANES];
            for ((next, x), b) in next.iter_mut().zip(&x).zip(&likelihoods) {
                for l in 0..LANES {
                    next[l] = x[l] + (b[l] - shifts[l]);
                    largest[l] = largest[l].max(next[l]);
                }
            }
            largest
        } else {
            lockstep_max::maximize(Maximize {
                log2: plan.rows.with_values(log2),
                x: &x,
                likelihoods: &likelihoods,
                shifts,
                next: &mut next,
                from: &mut from[(step - 2) * n..][..n],
            })
        };
        let floors = largest.map(|best| if best.is_finite() { best.floor() } else { 0.0 });
        next.iter_mut().for_each(|next| (0..LANES).for_each(|l| next[l] -= floors[l]));
        std::mem::swap(&mut x, &mut next);
        for l in (0..LANES).filter(|l| step <= group.steps[*l]) {
            held[l] &= largest[l] > f64::NEG_INFINITY;
            taken_out[l].whole += floors[l];
            if held[l] && step == group.steps[l] {
                let scores: Vec<f64> = x.iter().map(|x| x[l]).collect();
                let last = best(&scores);
                let log_probability = taken_out[l].log_probability(scores[last]);
                let states = back(&from, n, l, (step, last));
                paths[l] = Some(ViterbiPath { states, log_probability });
            }
        }
        if held == [false; LANES] {
            break;
        }
    }
    paths
}

/// The path of a lane that ends in a state.
fn back(from: &[[u32; LANES]], n: usize, lane: usize, (steps, last): (usize, usize)) -> Vec<usize> {
    let mut states = vec![last; steps];
    let mut state = last;
    for (index, out) in states[..steps - 1].iter_mut().enumerate().rev() {
        state = from[index * n + state][lane] as usize;
        *out = state;
    }
    states
}

impl<A: TransitionEntries, B: Likelihood> Plan<'_, A, B> {
    /// The scores of an observation, and by how much they are to be lowered; `None`
    /// if the likelihoods are not valid, or nothing is possible.
    fn scores<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut Lane,
        taken_out: &mut TakenOut,
    ) -> Option<(&'a [f64], f64)> {
        let n = self.ones.len();
        let Lane { scratch, values } = lane;
        values.resize(n, 0.0);
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).ok()?;
        let largest = diagonal.check(n).ok()?;
        let (shifted, left_out) = likelihood_scores(&diagonal, largest, values)?;
        taken_out.factors.add(left_out);
        Some((shifted.scores, shifted.shift))
    }
}
