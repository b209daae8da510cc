//! Viterbi decoding as a stream: states on which all surviving paths agree are final (Šrámek,
//! Brejová and Vinař 2007).

use std::collections::VecDeque;
use std::mem;
use std::ops::Deref;

use super::filter_snapshot::next_step;
use super::online_viterbi_snapshot::{Node, OnlineViterbiSnapshot};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::scores::{TakenOut, best};
use crate::inference::step::{Step, Workspace};
use crate::likelihood::Likelihood;
use crate::transition::{NoControl, TransitionEntries};

/// Streaming Viterbi decoder: it commits the states of a step as soon as the best paths to all
/// possible present states agree on it, and never revises a committed state.
///
/// Committed and [undecided](Self::undecided) states together are, at any time,
/// the path of [`Hmm::viterbi`]. A step costs one max-product and O(n) on
/// average; memory is 8 n bytes for each undecided step, of which there may be
/// many if two paths stay apart. After an error it is as it was before the
/// call. It has neither `update` nor `relocate`, which would change paths already committed:
/// fuse the sensors of a step in the model, and start another decoder after a relocation.
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
    steps: usize,
    scores: Vec<f64>,
    taken_out: TakenOut,
    /// Undecided steps, the oldest first.
    levels: VecDeque<Level>,
    committed: Vec<usize>,
    next: Vec<f64>,
    from: Vec<u32>,
    work: Workspace,
    spare: Vec<Level>,
    /// Predecessors of those states of the last step that no path extends.
    gone: Vec<u32>,
}

/// States of one step as nodes of the tree of best paths.
#[derive(Debug, Clone)]
struct Level {
    /// Best predecessor of each state.
    from: Vec<u32>,
    /// Number of surviving nodes of the next level that extend each node; at the last level, 1
    /// for a possible state and 0 for others.
    uses: Vec<u32>,
    /// Number of nodes in use.
    alive: usize,
}

impl Level {
    fn new(states: usize) -> Self {
        Self { from: vec![0; states], uses: vec![0; states], alive: 0 }
    }
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
            steps: 0,
            scores: vec![0.0; n],
            taken_out: TakenOut::default(),
            levels: VecDeque::new(),
            committed: Vec::new(),
            next: vec![0.0; n],
            from: vec![0; n],
            work: Workspace::new(n),
            spare: Vec::new(),
            gone: Vec::with_capacity(n),
        }
    }

    /// Takes one step under a control, which drives the transition to it. Returns the states that
    /// it commits, those of the oldest undecided steps; often none, sometimes many.
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
        let mut state = best(&self.scores);
        let mut states = vec![0; self.levels.len()];
        for (out, level) in states.iter_mut().zip(&self.levels).rev() {
            *out = state;
            state = level.from[state] as usize;
        }
        states
    }

    /// Number of steps not yet committed.
    #[must_use]
    pub fn undecided_len(&self) -> usize {
        self.levels.len()
    }

    /// Log-probability ln p(path, y_1 … y_k) of the best path so far; 0 before any step.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.taken_out.log_probability(self.scores[best(&self.scores)])
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns a copy of the decoder's state: of the paths that may still be the best one, not of
    /// the committed states. A decoder that is [restored](Self::restore) from it continues with
    /// identical bits.
    #[must_use]
    pub fn snapshot(&self) -> OnlineViterbiSnapshot {
        let levels = self.levels.iter().enumerate().map(|(at, level)| {
            let nodes = (0..).zip(level.uses.iter().zip(&level.from));
            let alive = nodes.filter(|(_, (uses, _))| **uses > 0);
            // Predecessors of the oldest undecided step have been committed.
            let node = |(state, (_, &from))| Node { state, from: if at == 0 { 0 } else { from } };
            alive.map(node).collect()
        });
        OnlineViterbiSnapshot {
            steps: self.steps,
            scores: self.scores.clone(),
            taken_out: self.taken_out.clone(),
            levels: levels.collect(),
        }
    }

    /// Restores a snapshot, of this decoder or another. Costs O(n) and n for each undecided step.
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states.
    pub fn restore(&mut self, snapshot: &OnlineViterbiSnapshot) -> Result<(), InferenceError> {
        let (found, expected) = (snapshot.scores.len(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "snapshot", found, expected });
        }
        self.steps = snapshot.steps;
        self.taken_out = snapshot.taken_out.clone();
        self.scores.copy_from_slice(&snapshot.scores);
        self.committed.clear();
        self.spare.extend(self.levels.drain(..));
        for nodes in &snapshot.levels {
            let mut level = self.spare.pop().unwrap_or_else(|| Level::new(expected));
            level.from.fill(0);
            level.uses.fill(0);
            level.alive = nodes.len();
            for &Node { state, from } in nodes {
                level.from[state as usize] = from;
                // At the end of the tree, one use marks a possible state.
                level.uses[state as usize] = 1;
            }
            if let Some(before) = self.levels.back_mut() {
                before.uses.fill(0);
                nodes.iter().for_each(|node| before.uses[node.from as usize] += 1);
            }
            self.levels.push_back(level);
        }
        Ok(())
    }

    /// Returns to before the first step.
    pub fn restart(&mut self) {
        self.scores.fill(0.0);
        (self.steps, self.taken_out) = (0, TakenOut::default());
        self.spare.extend(self.levels.drain(..));
    }

    fn advance(
        &mut self,
        control: &A::Control,
        observation: Option<&B::Observation>,
    ) -> Result<&[usize], InferenceError> {
        let number = next_step(self.steps)?;
        let Self { model, scores, next, from, work, taken_out, .. } = self;
        let control = model.prior().moves_at(number).then_some(control);
        let step = Step { hmm: &**model, number, control };
        let mut taken_out = taken_out.clone();
        if number == 1 {
            step.first_scores(next, &mut taken_out)?;
            if let Some(observation) = observation {
                step.observe(observation, work, next, &mut taken_out)?;
            }
            step.settle(next, &mut taken_out)?;
        } else {
            step.decode(scores, observation, (next, from), work, &mut taken_out)?;
        }
        // Nothing fails from here on.
        self.taken_out = taken_out;
        mem::swap(&mut self.scores, &mut self.next);
        self.steps = number;
        self.grow();
        self.commit();
        Ok(&self.committed)
    }

    /// Adds the present step to the tree, and removes the nodes that no path to it uses.
    fn grow(&mut self) {
        let n = self.scores.len();
        let mut level = self.spare.pop().unwrap_or_else(|| Level::new(n));
        level.from.copy_from_slice(&self.from);
        let possible = self.scores.iter().map(|score| u32::from(*score > f64::NEG_INFINITY));
        level.uses.iter_mut().zip(possible).for_each(|(uses, possible)| *uses = possible);
        level.alive = level.uses.iter().filter(|uses| **uses > 0).count();
        if let Some(last) = self.levels.back_mut() {
            // The use that marked a possible state at the end of the tree is removed below.
            for (&from, &uses) in level.from.iter().zip(&level.uses) {
                last.uses[from as usize] += uses;
            }
            self.gone.clear();
            for (uses, &from) in last.uses.iter_mut().zip(&last.from) {
                if *uses > 0 {
                    *uses -= 1;
                    if *uses == 0 {
                        self.gone.push(from);
                    }
                }
            }
            last.alive -= self.gone.len();
            if let Some(before) = self.levels.len().checked_sub(2) {
                for k in 0..self.gone.len() {
                    self.release(before, self.gone[k] as usize);
                }
            }
        }
        self.levels.push_back(level);
    }

    /// Removes one use of a node; a node without uses is removed, and so may be its predecessors.
    fn release(&mut self, mut at: usize, mut state: usize) {
        loop {
            let level = &mut self.levels[at];
            level.uses[state] -= 1;
            if level.uses[state] > 0 {
                return;
            }
            level.alive -= 1;
            state = level.from[state] as usize;
            match at.checked_sub(1) {
                Some(before) => at = before,
                None => return,
            }
        }
    }

    /// Commits the oldest steps that have one node left.
    fn commit(&mut self) {
        self.committed.clear();
        while self.levels.front().is_some_and(|level| level.alive == 1) {
            if let Some(level) = self.levels.pop_front() {
                self.committed.extend(level.uses.iter().position(|uses| *uses > 0));
                self.spare.push(level);
            }
        }
    }
}

impl<M, A, B> OnlineViterbi<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: Likelihood,
{
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
