//! Streaming Viterbi decoding: states on which all surviving paths agree are final (Šrámek, Brejová
//! and Vinař 2007; section 7 of the [formulas](crate::guide::formulas)).
//!
//! A step computes the next scores in separate memory, and swaps them once nothing can fail any
//! more; only then does the [tree](super::tree) of paths grow. It relies on two invariants, for
//! which a stored state is checked: the best score is from 0 to 1, and every node of the tree is on
//! a path to a possible present state.

use std::mem;
use std::ops::Deref;

use super::tree::{Node, Tree};
use crate::error::HmmError;
use crate::hmm::{Hmm, ModelPointer};
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

impl<M> OnlineViterbi<M> {
    /// Creates a decoder before the first step, with any pointer to a model.
    #[must_use]
    pub fn new(model: M) -> Self
    where
        M: ModelPointer,
    {
        let n = model.hmm().states();
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
}

impl<M, A, B> OnlineViterbi<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: Likelihood,
{
    /// Takes one step under a control, which drives the transition to it. Returns the states that
    /// it commits, those of the oldest undecided steps: often none, sometimes many.
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step, as [`Hmm::viterbi`].
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<&[usize], HmmError> {
        self.advance(control, Some(observation))
    }

    /// Takes one step without an observation. Returns the states that it commits.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the control is not valid.
    pub fn predict_with(&mut self, control: &A::Control) -> Result<&[usize], HmmError> {
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
    /// [`HmmError::StateCount`] if the snapshot has another number of states.
    pub fn restore(&mut self, snapshot: &OnlineViterbiSnapshot) -> Result<(), HmmError> {
        let (found, expected) = (snapshot.best.scores.len(), self.model.states());
        if found != expected {
            return Err(HmmError::StateCount { part: "snapshot", found, first: "model", expected });
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
    ) -> Result<&[usize], HmmError> {
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
    pub fn step(&mut self, observation: &B::Observation) -> Result<&[usize], HmmError>
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
    pub fn predict(&mut self) -> Result<&[usize], HmmError>
    where
        A::Control: NoControl,
    {
        self.predict_with(&A::Control::NONE)
    }
}

/// State of an online Viterbi decoder after k steps: plain data that can be kept, compared, sent
/// elsewhere and restored.
///
/// Made by [`OnlineViterbi::snapshot`](crate::OnlineViterbi::snapshot). Memory: 8 n bytes, and 8
/// for each state of an undecided step on a surviving path.
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
/// let mut decoder = hmm.online_viterbi();
/// let mut path = decoder.step(&0)?.to_vec();
/// let snapshot = decoder.snapshot();
///
/// let mut next = hmm.online_viterbi();
/// next.restore(&snapshot)?;
/// path.extend_from_slice(next.step(&1)?);
/// path.extend(next.undecided());
/// assert_eq!(path, hmm.viterbi(&[0, 1])?.states());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct OnlineViterbiSnapshot {
    best: BestScores,
    /// For each undecided step, oldest first, its states on surviving paths in ascending order.
    levels: Vec<Vec<Node>>,
}

/// Scores of the best path to each state.
#[derive(Debug, Clone, PartialEq)]
struct BestScores {
    steps: usize,
    scores: Vec<f64>,
    taken_out: TakenOut,
}

impl BestScores {
    /// Creates the scores before the first step.
    fn start(states: usize) -> Self {
        Self { steps: 0, scores: vec![0.0; states], taken_out: TakenOut::default() }
    }

    /// Returns ln p(path, y_1 … y_k) of the best path.
    fn log_probability(&self) -> f64 {
        self.taken_out.log_probability(self.scores[best(&self.scores)])
    }
}

impl OnlineViterbiSnapshot {
    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.best.steps
    }

    /// Log-probability ln p(path, y_1 … y_k) of the best path so far; 0 before any step.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.best.log_probability()
    }
}

#[cfg(feature = "serde")]
use crate::inference::step::state::{LogSum, MOST_STEPS};
#[cfg(feature = "serde")]
use crate::stored::{finite_logs, logs};

#[cfg(feature = "serde")]
impl OnlineViterbiSnapshot {
    /// Checks that this can be the state of a decoder; the numbers may be damaged.
    fn checked(self) -> Result<Self, String> {
        let Self { best: BestScores { steps, scores, taken_out }, levels } = &self;
        let states = scores.len();
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        let TakenOut { whole, factors } = taken_out;
        // Each step takes a whole number out of the scores and leaves the best from 0 to 1.
        let largest = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if scores.iter().any(|score| score.is_nan()) || !(0.0..=1.0).contains(&largest) {
            return Err(format!("the best score is {largest}, expected one from 0 to 1"));
        }
        let whole_number = whole.is_finite() && whole.fract() == 0.0;
        if !(whole_number && factors.is_finite() && taken_out.log_probability(largest).is_finite())
        {
            return Err(format!(
                "{whole}, {} and {} were taken out of the scores, expected a whole number and \
                 finite values",
                factors.sum, factors.compensation
            ));
        }
        if levels.len() > *steps {
            return Err(format!("{} undecided steps, expected at most {steps}", levels.len()));
        }
        // The tree: every node has a predecessor, and every node before the last level has a
        // successor. Otherwise the counts of uses would go below 0 when a path ends.
        for (at, nodes) in levels.iter().enumerate() {
            let ascending = nodes.is_sorted_by(|a, b| a.state < b.state);
            if !ascending || nodes.last().is_none_or(|last| last.state as usize >= states) {
                return Err(format!(
                    "undecided step {at} does not have states below {states} in ascending order"
                ));
            }
            // Both conditions at once: the set of predecessors equals the previous level. The
            // oldest level has no predecessors, and stores 0 for each.
            let mut used: Vec<u32> = nodes.iter().map(|node| node.from).collect();
            used.sort_unstable();
            used.dedup();
            let linked = match at.checked_sub(1) {
                Some(before) => levels[before].iter().map(|node| node.state).eq(used),
                None => used == [0],
            };
            if !linked {
                return Err(format!(
                    "the predecessors in undecided step {at} are not the states of the step before"
                ));
            }
        }
        // The last level is the present step. Without a level everything is committed, which
        // requires that only one present state is possible.
        let possible = || (0..).zip(scores).filter(|entry| *entry.1 > f64::NEG_INFINITY);
        let ends = match levels.last() {
            Some(last) => possible().map(|entry| entry.0).eq(last.iter().map(|node| node.state)),
            None => *steps == 0 || possible().count() == 1,
        };
        if !ends {
            return Err("the paths do not end in exactly the possible states".to_owned());
        }
        Ok(self)
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] OnlineViterbiSnapshot: [], |state| {
        steps: usize = state.best.steps,
        scores: Vec<Option<f64>> = finite_logs(&state.best.scores),
        taken_out: [f64; 3] = {
            let TakenOut { whole, factors: LogSum { sum, compensation } } = state.best.taken_out;
            [whole, sum, compensation]
        },
        // The states of each undecided step, with their predecessors.
        undecided: Vec<Vec<(u32, u32)>> = {
            let level = |nodes: &Vec<Node>| nodes.iter().map(|node| (node.state, node.from)).collect();
            state.levels.iter().map(level).collect::<Vec<Vec<_>>>()
        },
    } => {
        let [whole, sum, compensation] = taken_out;
        let taken_out = TakenOut { whole, factors: LogSum { sum, compensation } };
        let level = |nodes: Vec<(u32, u32)>| {
            nodes.into_iter().map(|(state, from)| Node { state, from }).collect()
        };
        let levels = undecided.into_iter().map(level).collect();
        let best = BestScores { steps, scores: logs(scores), taken_out };
        self::OnlineViterbiSnapshot { best, levels }.checked()
    };
}
