//! Viterbi in lanes (section 7 of the [formulas](crate::guide::formulas)).
//!
//! Scores are on a grid on which sums are exact, so that paths and their probabilities are those of
//! the routine for one sequence to the bit, including ties.

use super::{Group, LaneModel, LaneScratch};
use crate::inference::step::scores::{TakenOut, best, likelihood_scores};
use crate::inference::step::{SensorScratch, Step};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::{TransitionEntries, constant_control};
use wayfix_kernels::{self as kernels, LANES, Packed, ScoresIn};

impl<A: TransitionEntries, B: Likelihood> LaneModel<'_, A, B> {
    /// Decodes a group: returns the path of each lane, and its log-probability.
    pub(crate) fn viterbi<S>(
        &self,
        group: &Group<'_, S>,
        scratch: &mut LaneScratch,
    ) -> [Option<(Vec<usize>, f64)>; LANES]
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let n = self.states();
        let mut first = vec![0.0; n];
        let control = constant_control::<A>().filter(|_| self.hmm.prior().moves_at(1));
        let step = Step { hmm: self.hmm, number: 1, control };
        // The first scores depend on no observation, so they are the same for all lanes, as is an
        // error.
        if step.first_scores(&mut first, &mut TakenOut::default()).is_err() {
            return [const { None }; LANES];
        }
        let log2 = self.log2.get_or_init(|| {
            let mut values = self.rows.values().to_vec();
            kernels::log2_in_place(&mut values);
            values
        });
        scratch.fit(n, 0, 0);
        let LaneScratch { likelihoods, x, next, backpointers, lanes, .. } = scratch;
        x.iter_mut().zip(&first).for_each(|(x, score)| *x = Packed([*score; LANES]));
        // Not cleared: all pointers of a step are written before any is read.
        backpointers.resize(n * group.longest, [0; LANES]);
        let mut valid = group.lanes();
        let mut taken_out: [TakenOut; LANES] = Default::default();
        let mut paths = [const { None }; LANES];
        for step in 1..=group.longest {
            let mut shifts = [0.0; LANES];
            // A lane whose sequence has ended continues with scores of 0; its path has been read.
            let mut rows = [&self.zeros[..]; LANES];
            for (l, ((_, sequence), lane)) in group.sequences.iter().zip(&mut *lanes).enumerate() {
                if valid[l] && step <= group.steps[l] {
                    match self.scores(sequence.observation(step), lane, &mut taken_out[l]) {
                        Some(row) => (rows[l], shifts[l]) = row,
                        None => valid[l] = false,
                    }
                }
            }
            let likelihoods = &mut likelihoods[..n];
            kernels::pack(rows, likelihoods);
            // The first scores already include the first move.
            let log2 = (step > 1).then(|| self.rows.with_values(log2));
            let from = &mut backpointers[(step - 1) * n..][..n];
            let largest = kernels::batch_max(log2, x, likelihoods, shifts, next, from);
            // Whole numbers are taken out without rounding, so that scores stay near 0.
            let floors = largest.map(|best| if best.is_finite() { best.floor() } else { 0.0 });
            next.iter_mut().for_each(|next| (0..LANES).for_each(|l| next[l] -= floors[l]));
            std::mem::swap(x, next);
            for l in (0..LANES).filter(|l| step <= group.steps[*l]) {
                valid[l] &= largest[l] > f64::NEG_INFINITY;
                taken_out[l].whole += floors[l];
            }
            for l in (0..LANES).filter(|l| valid[*l] && step == group.steps[*l]) {
                let scores: Vec<f64> = x.iter().map(|x| x[l]).collect();
                let last = best(&scores);
                let mut states = vec![last; step];
                for k in (1..step).rev() {
                    states[k - 1] = backpointers[k * n + states[k]][l] as usize;
                }
                paths[l] = Some((states, taken_out[l].log_probability(scores[last])));
            }
            if valid == [false; LANES] {
                break;
            }
        }
        paths
    }

    /// Returns the scores of an observation, and the amount still to be subtracted from them;
    /// `None` if the likelihoods are invalid or all 0.
    fn scores<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut SensorScratch,
        taken_out: &mut TakenOut,
    ) -> Option<(&'a [f64], f64)> {
        let n = self.states();
        let SensorScratch { scratch, values } = lane;
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
