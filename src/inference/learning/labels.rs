//! Estimation by counting, from sequences whose states are known: one M-step (section 9 of the
//! [formulas](crate::guide::formulas)) with γ and ξ of 0 and 1.

use super::learned_model::LearningOptions;
use crate::error::{LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::inference::LabelledSequence;
use crate::inference::step::Step;
use crate::likelihood::{LearnLikelihood, Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Move, Transition};

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Estimates the model from labelled sequences: relative frequencies, with the pseudo-counts of
    /// `learning` added to the entries that this model allows. O(T n) for each sequence.
    ///
    /// With a [stationary](Prior::Stationary) prior, the first states of sequences count for the
    /// operator too.
    ///
    /// Probabilities of 0 stay 0, so that smoothing adds no move where the map has no road.
    /// Parameters without observations or pseudo-counts keep their values. If only some states
    /// are known, [`learn`](Self::learn) accepts [labels beside
    /// observations](crate::guide::labels).
    ///
    /// ```
    /// use wayfix::inference::{LabelledSequence, LearningOptions};
    /// use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::BeforeFirstTransition(Belief::certain(3, 0)?),
    ///     SparseTransition::from_triplets(
    ///         3, // the possible moves; their probabilities are learned
    ///         [(0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (2, 1, 0.5), (2, 2, 1.0)],
    ///     )?,
    ///     TableLikelihood::from_rows(&[[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])?,
    /// )?;
    /// let labelled = LabelledSequence { initial: Some(0), states: &[0, 0, 1, 2], sequence: &[0, 0, 1, 2] };
    /// let learning = LearningOptions::default().with_transition_pseudo_count(1.0);
    /// let learned = hmm.fit(&[labelled], &learning)?;
    /// assert_eq!(learned.transition().get(1, 0), (1.0 + 1.0) / (3.0 + 2.0));
    /// assert_eq!(learned.transition().get(2, 0), 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError`] if there is neither an observation nor an initial state; and, naming
    /// sequence and step, for a state that does not exist, a move or an observation that the model
    /// forbids, an observation without a valid likelihood, or a control that is not valid.
    pub fn fit<S>(
        &self,
        sequences: &[LabelledSequence<'_, S>],
        learning: &LearningOptions,
    ) -> Result<Self, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        learning.check()?;
        let is_empty = |labelled: &LabelledSequence<'_, S>| {
            labelled.initial.is_none()
                && labelled.states.is_empty()
                && labelled.sequence.steps() == 0
        };
        if sequences.iter().all(is_empty) {
            return Err(LearnError::nothing(sequences.len(), None));
        }
        let mut expected = self.no_expectations();
        // The E-step with certain posteriors: at each step one state has probability 1.
        let mut certain = vec![0.0; self.states()];
        let mut moves = Vec::new();
        for (number, labelled) in sequences.iter().enumerate() {
            self.check_labelled(number, labelled)?;
            // The prior is the distribution of X_0, or of X_1 if no move leads to it.
            let (mut before, first) = match self.prior() {
                Prior::BeforeFirstTransition(_) => (labelled.initial, labelled.initial),
                Prior::AtFirstObservation(_) | Prior::Stationary(_) => {
                    (None, labelled.states.first().copied())
                }
            };
            first.into_iter().for_each(|state| expected.first[state] += 1.0);
            for (step, &to) in (1..).zip(labelled.states) {
                certain[to] = 1.0;
                let observation = labelled.sequence.observation(step);
                self.likelihood().add(&mut expected.sensor, observation, &certain);
                certain[to] = 0.0;
                if let Some(from) = before {
                    moves.push((from, to, labelled.sequence.control(step)));
                }
                before = Some(to);
            }
        }
        // In the order of the entries, so that `append` adds each at the end.
        moves.sort_by_key(|&(from, to, _)| (from, to));
        for (from, to, control) in moves {
            if let Some(counts) = self.transition().counts(&mut expected.moves, control) {
                counts.append(Move { from, to, weight: 1.0 });
            }
        }
        self.maximize_unchecked(&expected, learning)
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Checks that the model allows the states, moves and observations of a sequence.
    fn check_labelled<S>(
        &self,
        sequence: usize,
        labelled: &LabelledSequence<'_, S>,
    ) -> Result<(), LearnError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let LabelledSequence { initial, states: path, sequence: observed } = *labelled;
        let (states, observations) = (path.len(), observed.steps());
        if states != observations {
            return Err(LearnError::Length { sequence, states, observations });
        }
        let states = self.states();
        let initial = initial.filter(|_| self.prior().moves_at(1));
        let all =
            initial.map(|state| (0, state)).into_iter().chain((1..).zip(path.iter().copied()));
        // Checked before a state is used as an index.
        for (step, state) in all.clone() {
            if state >= states {
                return Err(LearnError::State { sequence, step, state, states });
            }
        }
        let start = if self.prior().moves_at(1) { initial } else { path.first().copied() };
        if let Some(state) = start
            && self.prior().belief().as_slice()[state] == 0.0
        {
            return Err(LearnError::Start { sequence, state });
        }
        let mut scratch = Scratch::default();
        let mut before = initial;
        for (number, to) in all.filter(|step| step.0 > 0) {
            let step = Step::of(self, observed, number);
            let wrap = |source| SequenceError { sequence, source };
            let (diagonal, _) =
                step.diagonal(observed.observation(number), &mut scratch).map_err(wrap)?;
            // The known state has likelihood 0: no model that keeps this zero could have made the
            // sequence.
            if diagonal.logs().nth(to) == Some(f64::NEG_INFINITY) {
                return Err(LearnError::Sighting { sequence, step: number, state: to });
            }
            if let (Some(control), Some(from)) = (step.control, before) {
                step.check_control(control).map_err(wrap)?;
                if !self.transition().outgoing(control, from).any(|entry| entry.0 == to) {
                    return Err(LearnError::Forbidden { sequence, step: number, from, to });
                }
            }
            before = Some(to);
        }
        Ok(())
    }
}
