//! Streaming Viterbi decoding: states on which all surviving paths agree are final (Šrámek, Brejová
//! and Vinař 2007; section 7 of the [formulas](crate::guide::formulas)).
//!
//! A step computes the next scores beside the present ones, and swaps them once nothing can fail
//! any more; only then does the [tree](super::tree) of paths grow.

use std::mem;
use std::ops::Deref;

use super::online_viterbi_snapshot::{BestScores, OnlineViterbiSnapshot};
use super::tree::Tree;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::scores::{TakenOut, best};
use crate::inference::step::{SensorScratch, Step};
use crate::likelihood::Likelihood;
use crate::transition::{NoControl, TransitionEntries};

/// Streaming Viterbi decoder: commits the state of a step as soon as the best paths to all possible
/// present states agree on it, and never revises a committed state.
///
/// Committed and [undecided](Self::undecided) states together are the path of [`Hmm::viterbi`] at
/// any time. A step costs one max-product and, on average, O(n); memory is 8 n bytes for each
/// undecided step. There may be many of those if two paths stay apart. After an error the decoder
/// is as it was before the call. It has neither `update` nor `relocate`, which would change paths
/// already committed: fuse the sensors of a step in the model, and start a new decoder after a
/// relocation.
///
/// `M` is a pointer to the model, as for [`Filter`](crate::Filter).
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
/// let mut decoder = hmm.online_viterbi();
/// let mut path = Vec::new();
/// for sighting in [0, 0, 1, 0, 0] {
///     path.extend_from_slice(decoder.step(&sighting)?);
/// }
/// assert!(!path.is_empty()); // known before the end
/// assert_eq!(path.len() + decoder.undecided_len(), 5);
/// path.extend(decoder.undecided());
/// assert_eq!(path, hmm.viterbi(&[0, 0, 1, 0, 0])?.states());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct OnlineViterbi<M> {
    model: M,
    best: BestScores,
    tree: Tree,
    /// States that the last step has committed.
    committed: Vec<usize>,
    next: Vec<f64>,
    from: Vec<u32>,
    scratch: SensorScratch,
}

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Returns a decoder for a live stream, which borrows the model.
    #[must_use]
    pub fn online_viterbi(&self) -> OnlineViterbi<&Self> {
        OnlineViterbi::new(self)
    }
}

impl<M, A, B> OnlineViterbi<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: Likelihood,
{
    /// Creates a decoder before the first step, with any pointer to a model.
    #[must_use]
    pub fn new(model: M) -> Self {
        let n = model.states();
        Self {
            model,
            best: BestScores::start(n),
            tree: Tree::default(),
            committed: Vec::new(),
            next: vec![0.0; n],
            from: vec![0; n],
            scratch: SensorScratch::new(n),
        }
    }

    /// Takes one step under a control, which drives the transition to it. Returns the states that
    /// it commits, those of the oldest undecided steps: often none, sometimes many.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step, as [`Hmm::viterbi`].
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<&[usize], InferenceError> {
        self.advance(control, Some(observation))
    }

    /// Takes one step without an observation. Returns the states that it commits.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] if the control is not valid.
    pub fn predict_with(&mut self, control: &A::Control) -> Result<&[usize], InferenceError> {
        self.advance(control, None)
    }

    /// Returns the states of the steps not yet committed, on the best path so far: after the last
    /// observation, the rest of the decoded path.
    #[must_use]
    pub fn undecided(&self) -> Vec<usize> {
        self.tree.path(best(&self.best.scores))
    }

    /// Number of steps not yet committed.
    #[must_use]
    pub fn undecided_len(&self) -> usize {
        self.tree.len()
    }

    /// Log-probability ln p(path, y_1 … y_k) of the best path so far; 0 before any step.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.best.log_probability()
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.best.steps
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns a copy of the decoder's state: the paths that may still be the best one, without the
    /// committed states. A decoder that is [restored](Self::restore) from it continues with
    /// identical bits.
    #[must_use]
    pub fn snapshot(&self) -> OnlineViterbiSnapshot {
        OnlineViterbiSnapshot { best: self.best.clone(), levels: self.tree.nodes() }
    }

    /// Restores a snapshot of this decoder or another. O(n), and O(n) for each undecided step.
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if the snapshot has another number of states.
    pub fn restore(&mut self, snapshot: &OnlineViterbiSnapshot) -> Result<(), InferenceError> {
        let (found, expected) = (snapshot.best.scores.len(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "snapshot", found, expected });
        }
        // The snapshot is consistent: it was checked when it was read. How well it suits the model
        // can only be told by the number of states.
        self.best.clone_from(&snapshot.best);
        self.tree.restore(expected, &snapshot.levels);
        self.committed.clear();
        Ok(())
    }

    /// Goes back to before the first step.
    pub fn restart(&mut self) {
        let BestScores { steps, scores, taken_out } = &mut self.best;
        scores.fill(0.0);
        (*steps, *taken_out) = (0, TakenOut::default());
        self.tree.clear();
    }

    fn advance(
        &mut self,
        control: &A::Control,
        observation: Option<&B::Observation>,
    ) -> Result<&[usize], InferenceError> {
        let Self { model, best, tree, committed, next, from, scratch } = self;
        let step = Step::after(&**model, best.steps, control)?;
        // A copy (of three numbers), since a step may fail after it has taken something out.
        let mut taken_out = best.taken_out.clone();
        // X_0 is not part of the path: step 1 sums over it, and its states have no predecessors.
        if step.number == 1 {
            step.first_scores(next, &mut taken_out)?;
            if let Some(observation) = observation {
                step.observe(observation, scratch, next, &mut taken_out)?;
            }
            step.take_out_whole(next, &mut taken_out)?;
        } else {
            step.decode(&best.scores, observation, (next, from), scratch, &mut taken_out)?;
        }
        // Commit: nothing can fail from here. The scores are swapped first, since the tree reads
        // the new ones. (At step 1 `from` is stale, but the tree does not read it without a level
        // before.)
        (best.steps, best.taken_out) = (step.number, taken_out);
        mem::swap(&mut best.scores, next);
        tree.grow(&best.scores, from);
        tree.commit(committed);
        Ok(committed)
    }

    /// Takes one step. Returns the states that it commits.
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn step(&mut self, observation: &B::Observation) -> Result<&[usize], InferenceError>
    where
        A::Control: NoControl,
    {
        self.step_with(&A::Control::NONE, observation)
    }

    /// Takes one step without an observation. Returns the states that it commits.
    ///
    /// # Errors
    ///
    /// As [`predict_with`](Self::predict_with).
    pub fn predict(&mut self) -> Result<&[usize], InferenceError>
    where
        A::Control: NoControl,
    {
        self.predict_with(&A::Control::NONE)
    }
}
