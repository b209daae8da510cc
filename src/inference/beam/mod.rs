//! Viterbi decoding along a beam, for very large maps, with a test for the optimality of the path
//! ("Beam search" in section 13 of the [formulas](crate::guide::formulas)).
//!
//! The invariant: at every step each state of the beam has the score of the best path to it that
//! never left the beam, and an upper bound on the scores of paths to it that did; one more bound
//! covers all paths to other states. If at the end all bounds are below the score of the path
//! found, no path is better. Scores are logarithms throughout, so that the forms of `limits` do not
//! apply.

mod scores;

use std::f64::consts::LOG2_E;

use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::decoding::viterbi::ViterbiPath;
use crate::inference::pruned::active_set::ActiveSet;
use crate::inference::step::Step;
use crate::inference::step::scores::{TakenOut, best};
use crate::likelihood::{LocalLikelihood, Scratch, check_local};
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
use scores::{Beam, ENTRY, Pointers, largest_log2};

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
    /// If there is no proof, use a wider beam. An infinite one keeps all states; a negative or NaN
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
    /// [`InferenceError`] with the step at which an observation is impossible, or has no valid
    /// likelihood, or a control is not valid; [`InferenceError::Pruned`] if an observation is
    /// impossible in all states of the beam, but perhaps not in another: a wider beam may help.
    pub fn beam_viterbi<S>(&self, sequence: &S, width: f64) -> Result<BeamPath, InferenceError>
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
        let mut beam = Beam { elsewhere: f64::NEG_INFINITY, ..Beam::default() };
        // Starts with all states that the prior allows. No path has left the beam yet, so that the
        // bound on others is −∞.
        beam.states.extend((0..prior.len()).filter(|&state| prior[state] > 0.0));
        active_set.follow(&[], &beam.states);
        let mut next = Beam::default();
        let mut pointers = Pointers::default();
        let (mut from, mut wanted) = (Vec::new(), Vec::new());
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
            wanted.clear();
            // The sensor names the states with the largest likelihoods. A path that has left the
            // beam may return to them, so that each gets a bound of its own; otherwise their
            // likelihoods would raise the bound shared by all other states.
            if beam.elsewhere > f64::NEG_INFINITY {
                self.likelihood().listed_states(observation, &mut wanted);
            }
            active_set.list(&beam.states, moves, &wanted);
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
                next.elsewhere = beam.elsewhere;
                // Entries of a stochastic operator are at most one, up to tolerance. Evidence has
                // no such bound, and its largest entry has to be found.
                if evidence.is_none() {
                    next.elsewhere += ENTRY;
                } else if beam.elsewhere > f64::NEG_INFINITY {
                    next.elsewhere += largest_log2(transition, control);
                }
            }
            // Determined before the likelihoods are added: it decides which error an impossible
            // step gives.
            let nothing = evidence.is_some() && next.is_nowhere();
            let wrap = |cause| InferenceError::likelihood(step, cause);
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
                return Err(InferenceError::ImpossibleMove { step });
            }
            // Take out a whole number, then drop states too far from the best.
            let best = next.scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if best == f64::NEG_INFINITY {
                // If a bound on other paths is above −∞, one of those may be possible.
                return Err(if next.is_nowhere() {
                    InferenceError::Impossible { step }
                } else {
                    InferenceError::Pruned { step }
                });
            }
            taken_out.whole += best.floor();
            next.prune(best, width, &mut from);
            pointers.starts.push(pointers.entries.len());
            let entries = next.states.iter().zip(&from);
            pointers.entries.extend(entries.map(|(&state, &from)| (state as u32, from)));
            most_active = most_active.max(next.states.len());
            active_set.follow(&beam.states, &next.states);
            std::mem::swap(&mut beam, &mut next);
        }
        let at = best(&beam.scores);
        // Every path that left the beam scores at most one of the ceilings, or `elsewhere`.
        let pruned = beam.ceilings.iter().copied().fold(beam.elsewhere, f64::max);
        let path = ViterbiPath {
            states: pointers.path(at),
            log_probability: taken_out.log_probability(beam.scores[at]),
        };
        Ok(BeamPath { path, pruned: taken_out.log_probability(pruned), most_active })
    }
}
