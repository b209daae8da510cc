//! Viterbi decoding along a beam, for very large maps, with a test for the optimality of the path
//! (v, u and δ of "Beam search" in section 13 of the [formulas](crate::guide::formulas)).
//!
//! The invariant: at every step each state of the beam has the score of the best path to it that
//! never left the beam, and an upper bound on the scores of paths to it that did; one more bound
//! covers all paths to other states. If at the end all bounds are below the score of the path
//! found, no path is better. Scores are logarithms throughout, so that the forms of `limits` do not
//! apply. They are computed as by the exact decoder, on the same grid, so that a path proven
//! optimal is the exact decoder's path with its probability.

use std::f64::consts::LOG2_E;

use super::active_set::ActiveSet;
use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::decoding::viterbi::ViterbiPath;
use crate::inference::step::Step;
use crate::inference::step::scores::{TakenOut, best, unlifted_log2};
use crate::likelihood::{LocalLikelihood, Scratch, check_local};
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
use wayfix_kernels as kernels;
use wayfix_kernels::limits::LIFT;

/// Best path within a beam, with a proven bound on all other paths. Made by
/// [`Hmm::beam_viterbi`].
#[derive(Debug, Clone, PartialEq)]
pub struct BeamPath {
    path: ViterbiPath,
    pruned: f64,
    most_active: usize,
}

impl BeamPath {
    /// Best of the paths that never left the beam.
    #[must_use]
    pub fn path(&self) -> &ViterbiPath {
        &self.path
    }

    /// Returns the path by value.
    #[must_use]
    pub fn into_path(self) -> ViterbiPath {
        self.path
    }

    /// Upper bound on ln p(path, y_1 … y_T) of all paths, up to rounding (1e-14 a factor): the
    /// larger of that of the path found and a bound on those of all paths that left the beam.
    #[must_use]
    pub fn upper_bound(&self) -> f64 {
        self.path.log_probability.max(self.pruned)
    }

    /// Returns true if no path that left the beam can be better than the one found, which then is
    /// as probable as the path of [`Hmm::viterbi`]. Paths that differ by less than rounding (1e-14
    /// a factor) may be ranked either way.
    #[must_use]
    pub fn is_optimal(&self) -> bool {
        self.pruned <= self.path.log_probability
    }

    /// Returns true if every path that left the beam is worse than the one found, which then is the
    /// path of [`Hmm::viterbi`], by the same rule for ties. Paths within the beam that differ by
    /// less than rounding may be ranked either way here too.
    #[must_use]
    pub fn is_unrivalled(&self) -> bool {
        self.pruned < self.path.log_probability
    }

    /// Largest number of states in the beam at any step.
    #[must_use]
    pub fn most_active(&self) -> usize {
        self.most_active
    }
}

/// # Paths
impl<A: TransitionEntries, B: LocalLikelihood> Hmm<A, B> {
    /// Returns the most probable path among those that stay within `width` nats of the best at
    /// every step, and tells whether no other path is [proven](BeamPath::is_optimal) to be better:
    /// for models so large that [`viterbi`](Self::viterbi) takes too long, or its 4 n T bytes are
    /// too many.
    ///
    /// Without a proof, use a wider beam. An infinite one keeps all states; a negative or NaN
    /// width counts as 0. The proof depends on the sensor's bound for the states that it is not
    /// asked about: over steps at which these may be as likely as those of the path, the path gains
    /// nothing against them, and the width has to be sufficient.
    ///
    /// A step costs O(entries into and out of the states in the beam, and the cost of the sensor),
    /// and 8 bytes for each of these states for the backpointers; O(n) once. With [evidence on
    /// moves](crate::Transition::evidence) a step costs O(E), for the largest entry.
    ///
    /// ```
    /// # use wayfix::likelihood::SparseObservation;
    /// # use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition};
    /// # let n = 1000;
    /// # let moves = (0..n).flat_map(|j| [(j, j, 0.5), ((j + 1) % n, j, 0.5)]);
    /// # let motion = SparseTransition::from_triplets(n, moves)?;
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    /// # let hmm = Hmm::new(prior, motion, SparseLikelihood::new(n))?;
    /// # let seen = |place| SparseObservation::new(vec![(place, 0.9)], 1e-4);
    /// # let ys = [seen(700)?, seen(701)?, seen(20)?, seen(702)?];
    /// let mut width = 5.0;
    /// let found = loop {
    ///     let found = hmm.beam_viterbi(&ys, width)?;
    ///     if found.is_optimal() || width > 1000.0 {
    ///         break found;
    ///     }
    ///     width *= 2.0;
    /// };
    /// assert!(found.is_optimal());
    /// assert_eq!(found.path().states(), [700, 701, 701, 702]);
    /// # assert_eq!(found.path(), &hmm.viterbi(&ys)?);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step at which an observation is impossible, or has no valid
    /// likelihood, or a control is not valid; [`HmmError::Pruned`] if an observation is
    /// impossible in all states of the beam, but perhaps not in another: a wider beam may help.
    pub fn beam_viterbi<S>(&self, sequence: &S, width: f64) -> Result<BeamPath, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let steps = sequence.steps();
        if steps == 0 {
            let path = ViterbiPath { states: Vec::new(), log_probability: 0.0 };
            return Ok(BeamPath { path, pruned: f64::NEG_INFINITY, most_active: 0 });
        }
        let width = width.max(0.0) * LOG2_E;
        let prior = self.prior().belief().as_slice();
        let mut active_set = ActiveSet::new(self.states());
        let mut beam = Beam { inactive_ceiling: f64::NEG_INFINITY, ..Beam::default() };
        // Starts with all states that the prior allows. No path has left the beam yet, so the bound
        // on others is −∞.
        beam.states.extend((0..prior.len()).filter(|&state| prior[state] > 0.0));
        active_set.replace(&[], &beam.states);
        let mut next = Beam::default();
        let mut pointers = Pointers::default();
        let (mut from, mut named) = (Vec::new(), Vec::new());
        let mut scratch = Scratch::default();
        let mut taken_out = TakenOut::default();
        let mut most_active = 0;
        for step in 1..=steps {
            let observation = sequence.observation(step);
            let mut evidence = None;
            let moves = if self.prior().moves_at(step) {
                let control = sequence.control(step);
                evidence = Step { hmm: self, number: step, control: Some(control) }.evidence()?;
                Some((self.transition(), control))
            } else {
                None
            };
            named.clear();
            // The sensor names the states with the largest likelihoods. A path that has left the
            // beam may return to them, so each gets a bound of its own. Otherwise their likelihoods
            // would raise the bound shared by all other states.
            if beam.inactive_ceiling > f64::NEG_INFINITY {
                self.likelihood().listed_states(observation, &mut named);
            }
            active_set.list(&beam.states, moves, &named);
            next.clear();
            next.states.extend_from_slice(active_set.candidates());
            from.clear();
            if step == 1 {
                next.start(prior, moves, &mut from);
            } else if let Some((transition, control)) = moves {
                next.extend(
                    &beam,
                    &active_set,
                    |i| transition.incoming_log2(control, i),
                    &mut from,
                );
                next.inactive_ceiling = beam.inactive_ceiling;
                // Entries of a stochastic operator are at most one, up to tolerance. Evidence has
                // no such bound, and its largest entry has to be found.
                if evidence.is_none() {
                    next.inactive_ceiling += ENTRY;
                } else if beam.inactive_ceiling > f64::NEG_INFINITY {
                    next.inactive_ceiling += largest_log2(transition, control);
                }
            }
            // Determined before the likelihoods are added: it decides which error an impossible
            // step gives.
            let nothing = evidence.is_some() && next.is_nowhere();
            let wrap = |cause| HmmError::likelihood(step, cause);
            let local = self.likelihood().local(observation, &next.states, &mut scratch);
            let (local, others) = local.map_err(wrap)?;
            let largest = check_local(&local, others, &next.states).map_err(wrap)?;
            let factor = if local.is_log() {
                next.weigh_with_logs(local.as_slice(), others, largest)
            } else {
                taken_out.whole += next.weigh(local.as_slice(), others, largest);
                0.0
            };
            taken_out.factors.add(factor + local.log_factor() + evidence.unwrap_or(0.0));
            if nothing && local.is_possible(largest) {
                return Err(HmmError::ImpossibleMove { step });
            }
            // Take out a whole number, then drop states too far from the best.
            let best = next.scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if best == f64::NEG_INFINITY {
                // If a bound on other paths is above −∞, one of those may be possible.
                return Err(if next.is_nowhere() {
                    HmmError::Impossible { step }
                } else {
                    HmmError::Pruned { step }
                });
            }
            taken_out.whole += best.floor();
            next.prune(best, width, &mut from);
            pointers.starts.push(pointers.entries.len());
            let entries = next.states.iter().zip(&from);
            pointers.entries.extend(entries.map(|(&state, &from)| (state as u32, from)));
            most_active = most_active.max(next.states.len());
            active_set.replace(&beam.states, &next.states);
            std::mem::swap(&mut beam, &mut next);
        }
        let at = best(&beam.scores);
        // Every path that left the beam scores at most one of the ceilings, or `inactive_ceiling`.
        let pruned = beam.ceilings.iter().copied().fold(beam.inactive_ceiling, f64::max);
        let path = ViterbiPath {
            states: pointers.path(at),
            log_probability: taken_out.log_probability(beam.scores[at]),
        };
        Ok(BeamPath { path, pruned: taken_out.log_probability(pruned), most_active })
    }
}

/// Upper bound on log2 of an entry without evidence on the move. It is above 0, since the sums of
/// columns may deviate from one by 1e-9.
pub(crate) const ENTRY: f64 = 1.6e-9;

/// Scores of a step: logarithms to base 2 on the grid of `kernels::log2`.
#[derive(Debug, Default)]
pub(crate) struct Beam {
    /// States in the beam, in ascending order.
    pub(crate) states: Vec<usize>,
    /// Score of the best path to each state that never left the beam.
    pub(crate) scores: Vec<f64>,
    /// Upper bound on the scores of the paths to each state that left the beam.
    pub(crate) ceilings: Vec<f64>,
    /// Upper bound on the scores of the paths to any other state.
    pub(crate) inactive_ceiling: f64,
}

/// Backpointers of all steps.
#[derive(Debug, Default)]
pub(crate) struct Pointers {
    /// States of all steps, each with the position of its predecessor among those of the step
    /// before.
    pub(crate) entries: Vec<(u32, u32)>,
    /// Index of the first entry of each step.
    pub(crate) starts: Vec<usize>,
}

impl Beam {
    pub(crate) fn clear(&mut self) {
        self.states.clear();
        self.scores.clear();
        self.ceilings.clear();
    }

    /// Computes the scores of step 1; X_0 is summed over.
    pub(crate) fn start<A: TransitionEntries>(
        &mut self,
        prior: &[f64],
        moves: Option<(&A, &A::Control)>,
        from: &mut Vec<u32>,
    ) {
        // Asked once, since the answer requires a look at all entries.
        let in_logs = moves.is_some_and(|(a, u)| a.evidence(u).is_some() && a.entries_need_logs(u));
        for &i in &self.states {
            let lifted = match moves {
                Some(_) if in_logs => 0.0,
                Some((transition, control)) => {
                    let entries = transition.incoming(control, i);
                    entries.map(|(j, a)| a * (prior[j] * LIFT)).sum()
                }
                None => prior[i] * LIFT,
            };
            self.scores.push(match moves {
                // A tiny prior times a small entry may leave the range of `f64` even when lifted.
                Some((transition, control)) if !(1.0..=f64::MAX).contains(&lifted) => {
                    let entries = || transition.incoming_log2(control, i);
                    log2_sum(|| entries().map(|(j, log2)| log2 + kernels::log2(prior[j])))
                }
                _ => unlifted_log2(lifted),
            });
            self.ceilings.push(f64::NEG_INFINITY);
            from.push(0);
        }
        self.inactive_ceiling = f64::NEG_INFINITY;
    }

    /// Returns true if no path has a probability above 0.
    pub(crate) fn is_nowhere(&self) -> bool {
        let all = self.scores.iter().chain(&self.ceilings).chain([&self.inactive_ceiling]);
        all.copied().all(|score| score == f64::NEG_INFINITY)
    }

    /// Extends the best paths from the states before to each state, and the bounds on the others.
    pub(crate) fn extend<I: Iterator<Item = (usize, f64)>>(
        &mut self,
        before: &Self,
        active_set: &ActiveSet,
        incoming: impl Fn(usize) -> I,
        from: &mut Vec<u32>,
    ) {
        for &i in &self.states {
            let (mut score, mut best) = (f64::NEG_INFINITY, 0);
            let (mut ceiling, mut inactive_entry) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
            for (j, log2) in incoming(i) {
                // Through a state of the beam: the best path that never left the beam, and the
                // bound on those that did.
                if let Some(at) = active_set.position(j) {
                    let value = log2 + before.scores[at];
                    if value > score {
                        (score, best) = (value, at as u32);
                    }
                    ceiling = f64::max(ceiling, log2 + before.ceilings[at]);
                } else {
                    // States outside share one bound: with the largest entry out of them it covers
                    // all paths from there.
                    inactive_entry = f64::max(inactive_entry, log2);
                }
            }
            self.scores.push(score);
            self.ceilings.push(ceiling.max(before.inactive_ceiling + inactive_entry));
            from.push(best);
        }
    }

    /// Adds the logarithms of likelihoods, each at most `largest`, less a whole number.
    /// Returns that number.
    pub(crate) fn weigh(&mut self, listed: &[f64], others: f64, largest: f64) -> f64 {
        // The same whole number as the exact decoder takes out, so that scores are the same.
        let whole = if largest > 0.0 { kernels::log2(largest).floor() } else { 0.0 };
        self.add(listed.iter().map(|b| kernels::log2(*b) - whole));
        self.inactive_ceiling += kernels::log2(others) - whole;
        whole
    }

    /// Adds likelihoods given by their natural logarithms, less the largest. Returns the largest.
    pub(crate) fn weigh_with_logs(&mut self, listed: &[f64], others: f64, largest: f64) -> f64 {
        let largest = if largest.is_finite() { largest } else { 0.0 };
        // Rounded to the grid as by the exact decoder (`Hmm::viterbi`), whose scores these must
        // equal.
        let log2 = |log: f64| kernels::on_grid((log - largest) * LOG2_E);
        self.add(listed.iter().map(|log| log2(*log)));
        self.inactive_ceiling += log2(others);
        largest
    }

    fn add(&mut self, log2: impl Iterator<Item = f64>) {
        for ((score, ceiling), log2) in self.scores.iter_mut().zip(&mut self.ceilings).zip(log2) {
            *score += log2;
            *ceiling += log2;
        }
    }

    /// Drops the states whose score and bound are both more than `width` below the best score, and
    /// takes out the whole part of that score.
    pub(crate) fn prune(&mut self, best: f64, width: f64, from: &mut Vec<u32>) {
        let (floor, least) = (best.floor(), best - width);
        let mut kept = 0;
        for at in 0..self.states.len() {
            let (score, ceiling) = (self.scores[at], self.ceilings[at]);
            // A state is kept also because of its bound alone: dropping it would raise the bound on
            // all other states.
            let highest = score.max(ceiling);
            if highest >= least && highest > f64::NEG_INFINITY {
                (self.states[kept], from[kept]) = (self.states[at], from[at]);
                (self.scores[kept], self.ceilings[kept]) = (score - floor, ceiling - floor);
                kept += 1;
            } else {
                self.inactive_ceiling = self.inactive_ceiling.max(highest);
            }
        }
        self.states.truncate(kept);
        self.scores.truncate(kept);
        self.ceilings.truncate(kept);
        from.truncate(kept);
        self.inactive_ceiling -= floor;
    }
}

impl Pointers {
    /// Returns the path to the state at this position of the last step.
    pub(crate) fn path(&self, mut at: usize) -> Vec<usize> {
        let mut states = vec![0; self.starts.len()];
        for (state, start) in states.iter_mut().zip(&self.starts).rev() {
            let (here, before) = self.entries[start + at];
            *state = here as usize;
            at = before as usize;
        }
        states
    }
}

/// Returns log2 of the largest entry. O(E).
pub(crate) fn largest_log2<A: TransitionEntries>(transition: &A, control: &A::Control) -> f64 {
    let entries = (0..transition.states()).flat_map(|i| transition.incoming_log2(control, i));
    entries.map(|entry| entry.1).fold(f64::NEG_INFINITY, f64::max)
}

/// Returns log2 of a sum of numbers, from their logarithms to base 2.
fn log2_sum<I: Iterator<Item = f64>>(logs: impl Fn() -> I) -> f64 {
    let largest = logs().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    kernels::on_grid(largest + logs().map(|log| (log - largest).exp2()).sum::<f64>().log2())
}
