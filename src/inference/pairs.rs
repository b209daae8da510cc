//! Pairwise posteriors: the move from one step to the next, given all.

use std::f64::consts::LN_2;
use std::fmt;

use super::held::Held;
use super::step::is_one;
use crate::error::InferenceError;
use crate::transition::{Transition, TransitionEntries};

/// One move between two steps, and how probable it is or how often it is
/// expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// The state that is left.
    pub from: usize,
    /// The state that is reached.
    pub to: usize,
    /// p(from, to), or an expected number.
    pub weight: f64,
}

/// p(X_{k-1} = j, X_k = i | y_1 … y_T) for one k, as a product that is never
/// stored: α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i).
///
/// Handed out by [`SmoothedStep::pairs`](super::SmoothedStep::pairs).
pub struct Pairs<'a, A: Transition> {
    pub(super) transition: &'a A,
    pub(super) control: &'a A::Control,
    pub(super) alpha: Held<'a>,
    /// γ_k / p_k over `scale`, or its logarithm.
    pub(super) ratio: &'a [f64],
    pub(super) in_logs: bool,
    pub(super) scale: f64,
}

impl<A: Transition> fmt::Debug for Pairs<'_, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pairs").field("states", &self.ratio.len()).finish_non_exhaustive()
    }
}

impl<A: TransitionEntries> Pairs<'_, A> {
    /// The moves that the operator of this step allows, out of state 0 first,
    /// in ascending order; they sum to one, but for rounding (and for entries below
    /// 1e-323 that an operator does not list as logarithms either). Moves out of a
    /// state of probability 0 may be left out. O(E) in all.
    pub fn moves(&self) -> impl Iterator<Item = Move> {
        let states = 0..self.ratio.len();
        let (linear, logs) = if self.in_logs { (0..0, states) } else { (states, 0..0) };
        let linear = linear.filter(|&from| self.alpha.linear[from] > 0.0).flat_map(move |from| {
            let outgoing = self.transition.outgoing(self.control, from);
            outgoing.map(move |(to, p)| {
                let weight = self.alpha.linear[from] * (p * self.ratio[to]) * self.scale;
                Move { from, to, weight }
            })
        });
        let logs = logs.flat_map(move |from| {
            let outgoing = self.transition.outgoing_log2(self.control, from);
            outgoing.map(move |(to, log2)| {
                let log = self.alpha.log(from) + log2 * LN_2 + self.ratio[to];
                Move { from, to, weight: log.exp() }
            })
        });
        linear.chain(logs)
    }
}

/// By `from`, then by `to`. Here, since each sort by a closure of its own is code of its own.
pub(super) fn sort(moves: &mut [Move]) {
    moves.sort_by_key(|m| (m.from, m.to));
}

/// The expected number of moves between states.
///
/// A sum of [pairwise posteriors](Pairs), or of the moves of drives whose
/// states are known. Made by [`Hmm::expected_moves`](crate::Hmm::expected_moves)
/// and [`MoveCounts::of_path`].
///
/// ```
/// use wayfix::MoveCounts;
///
/// let mut counts = MoveCounts::of_path(&[0, 1, 1, 2]);
/// counts.merge(&MoveCounts::of_path(&[1, 2]));
/// assert_eq!(counts.get(1, 2), 2.0);
/// assert_eq!(counts.moves().map(|step| step.weight).sum::<f64>(), 4.0);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MoveCounts {
    /// By `from`, then by `to`.
    moves: Vec<Move>,
}

impl MoveCounts {
    /// The moves of a path of known states.
    #[must_use]
    pub fn of_path(states: &[usize]) -> Self {
        let mut moves: Vec<Move> = states
            .windows(2)
            .map(|pair| Move { from: pair[0], to: pair[1], weight: 1.0 })
            .collect();
        sort(&mut moves);
        let mut counts = Self::default();
        counts.add(moves);
        counts
    }

    /// All moves counted, by the state that is left, then by the one reached.
    #[must_use]
    pub fn moves(&self) -> impl ExactSizeIterator<Item = Move> {
        self.moves.iter().copied()
    }

    /// How often a move is expected, 0 if it was never seen. O(log moves).
    #[must_use]
    pub fn get(&self, from: usize, to: usize) -> f64 {
        let found = self.moves.binary_search_by_key(&(from, to), |m| (m.from, m.to));
        found.map_or(0.0, |at| self.moves[at].weight)
    }

    /// Adds the counts of another. O(moves).
    pub fn merge(&mut self, other: &Self) {
        self.add(other.moves());
    }

    /// Adds moves that come in ascending order, and returns their sum. What is
    /// there already costs one comparison.
    pub(super) fn add(&mut self, moves: impl IntoIterator<Item = Move>) -> f64 {
        let known = self.moves.len();
        let (mut at, mut sum) = (0, 0.0);
        for m in moves {
            sum += m.weight;
            let key = (m.from, m.to);
            while at < known && (self.moves[at].from, self.moves[at].to) < key {
                at += 1;
            }
            if at < known && (self.moves[at].from, self.moves[at].to) == key {
                self.moves[at].weight += m.weight;
                continue;
            }
            match self.moves[known..].last_mut() {
                Some(last) if (last.from, last.to) == key => last.weight += m.weight,
                _ => self.moves.push(m),
            }
        }
        if self.moves.len() > known {
            sort(&mut self.moves);
        }
        sum
    }

    /// Adds the moves of one step, which must sum to one: an operator may list
    /// other entries than its product has.
    pub(super) fn add_step<A: TransitionEntries>(
        &mut self,
        step: usize,
        pairs: &Pairs<'_, A>,
    ) -> Result<(), InferenceError> {
        let sum = self.add(pairs.moves());
        if is_one(sum) { Ok(()) } else { Err(InferenceError::PredictedSum { step, sum }) }
    }
}
