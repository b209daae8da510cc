//! Viterbi in lanes. Sums of scores are exact, so that paths and their probabilities are those of
//! the general routine to the bit.

use super::{BatchMemory, BatchModel, Group, GroupRows, Lane, Outcome};
use crate::inference::ViterbiPath;
use crate::inference::decoding::scores::{TakenOut, best, likelihood_scores};
use crate::inference::step::Step;
use crate::kernels::{self, LANES, Packed, ScoresIn};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// [`Hmm::viterbi`](crate::Hmm::viterbi).
pub(crate) fn viterbi<A, B, S>(
    model: &BatchModel<'_, A, B>,
    group: &Group<'_, S>,
    memory: &mut BatchMemory,
    _: GroupRows<'_>,
) -> Outcome<ViterbiPath>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation>,
{
    let mut ends: [Option<(usize, usize, f64)>; LANES] = [None; LANES];
    let n = model.ones.len();
    let mut first = vec![0.0; n];
    let control = model.hmm.transition().no_control().filter(|_| model.hmm.prior().moves_at(1));
    let step = Step { hmm: model.hmm, number: 1, control };
    if step.first_scores(&mut first, &mut TakenOut::default()).is_err() {
        return [const { None }; LANES];
    }
    let log2 = model.log2.get_or_init(|| {
        let mut values = model.rows.values().to_vec();
        kernels::log2_in_place(&mut values);
        values
    });
    memory.fit(n, 0, 0);
    let BatchMemory { likelihoods, x, next, from, lanes, .. } = memory;
    x.iter_mut().zip(&first).for_each(|(x, score)| *x = Packed([*score; LANES]));
    from.resize(n * group.longest, [0; LANES]);
    let mut held = group.lanes();
    let mut taken_out: [TakenOut; LANES] = Default::default();
    for step in 1..=group.longest {
        let mut shifts = [0.0; LANES];
        let mut rows = [&model.zeros[..]; LANES];
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(&mut *lanes).enumerate() {
            if held[l] && step <= group.steps[l] {
                match model.scores(sequence.observation(step), lane, &mut taken_out[l]) {
                    Some(row) => (rows[l], shifts[l]) = row,
                    None => held[l] = false,
                }
            }
        }
        let likelihoods = &mut likelihoods[..n];
        kernels::pack(rows, likelihoods);
        let log2 = (step > 1).then(|| model.rows.with_values(log2));
        let from = &mut from[(step - 1) * n..][..n];
        let largest = kernels::batch_max(log2, x, likelihoods, shifts, next, from);
        let floors = largest.map(|best| if best.is_finite() { best.floor() } else { 0.0 });
        next.iter_mut().for_each(|next| (0..LANES).for_each(|l| next[l] -= floors[l]));
        std::mem::swap(x, next);
        for l in (0..LANES).filter(|l| step <= group.steps[*l]) {
            held[l] &= largest[l] > f64::NEG_INFINITY;
            taken_out[l].whole += floors[l];
        }
        for l in (0..LANES).filter(|l| held[*l] && step == group.steps[*l]) {
            let scores: Vec<f64> = x.iter().map(|x| x[l]).collect();
            let last = best(&scores);
            let log_probability = taken_out[l].log_probability(scores[last]);
            ends[l] = Some((step, last, log_probability));
        }
        if held == [false; LANES] {
            break;
        }
    }
    let mut lane = 0;
    ends.map(|end| {
        lane += 1;
        end.map(|(steps, last, log_probability)| {
            let mut states = vec![last; steps];
            for k in (1..steps).rev() {
                states[k - 1] = from[k * n + states[k]][lane - 1] as usize;
            }
            ViterbiPath { states, log_probability }
        })
    })
}

impl<A: TransitionEntries, B: Likelihood> BatchModel<'_, A, B> {
    /// Returns the scores of an observation, and by how much they are to be lowered; `None` if the
    /// likelihoods are not valid, or nothing is possible.
    fn scores<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut Lane,
        taken_out: &mut TakenOut,
    ) -> Option<(&'a [f64], f64)> {
        let n = self.ones.len();
        let Lane { scratch, values } = lane;
        scratch.ask_for_log2();
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).ok()?;
        let largest = diagonal.check(n).ok()?;
        let scores = likelihood_scores(&diagonal, largest, taken_out)?;
        if scores.form == ScoresIn::Log2 {
            return Some((scores.values, scores.shift));
        }
        values.resize(n, 0.0);
        scores.write(values);
        Some((values, 0.0))
    }
}
