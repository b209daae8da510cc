//! State of an online decoder as plain data, and its formats.
//!
//! A snapshot from outside is checked for the invariants of the scores (the best is from 0 to 1)
//! and of the tree (every node is on a path to a possible present state), on which the
//! [decoder](super::online_viterbi) relies without checks.

use super::bytes::{Kind, Reader, Writer, contents};
use super::format::{COUNT, Codec, LOGS, in_bytes};
use crate::error::SnapshotError;
use crate::inference::step::scores::{TakenOut, best};
use crate::inference::step::state::{LogSum, MOST_STEPS};

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
    pub(crate) best: BestScores,
    /// For each undecided step, oldest first, its states on surviving paths in ascending order.
    pub(crate) levels: Vec<Vec<Node>>,
}

/// Scores of the best path to each state.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BestScores {
    pub(crate) steps: usize,
    pub(crate) scores: Vec<f64>,
    pub(crate) taken_out: TakenOut,
}

impl BestScores {
    /// Creates the scores before the first step.
    pub(crate) fn start(states: usize) -> Self {
        Self { steps: 0, scores: vec![0.0; states], taken_out: TakenOut::default() }
    }

    /// Returns ln p(path, y_1 … y_k) of the best path.
    pub(crate) fn log_probability(&self) -> f64 {
        self.taken_out.log_probability(self.scores[best(&self.scores)])
    }
}

/// A state on a surviving path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Node {
    pub(crate) state: u32,
    /// Predecessor; 0 at the oldest undecided step.
    pub(crate) from: u32,
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

    /// Returns the state as bytes, in the format of
    /// [`FilterSnapshot`](crate::inference::FilterSnapshot::to_bytes): 8 for each possible state,
    /// and for each state of an undecided step on a surviving path.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        Writer::whole(Kind::OnlineViterbi, |out| self.write(out))
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        Reader::whole(bytes, Kind::OnlineViterbi, Self::read)?.checked().map_err(contents)
    }

    /// Creates an empty state, whose fields are read next.
    pub(crate) fn blank() -> Self {
        Self { best: BestScores::start(0), levels: Vec::new() }
    }

    /// Checks that this can be the state of a decoder; the numbers may be damaged.
    pub(crate) fn checked(self) -> Result<Self, String> {
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
            // Both conditions at once: the set of predecessors equals the level before. The oldest
            // level has no predecessors, and stores 0 for each.
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

pub(crate) const TAKEN_OUT: Codec<TakenOut, [f64; 3]> = Codec {
    write: |v, out| {
        out.double(v.whole);
        out.log_sum(v.factors);
    },
    read: |from| Ok(TakenOut { whole: from.double()?, factors: from.log_sum()? }),
    data: |v| [v.whole, v.factors.sum, v.factors.compensation],
    value: |[whole, sum, compensation]| TakenOut { whole, factors: LogSum { sum, compensation } },
};
/// States and their predecessors, for each undecided step.
type Links = Vec<Vec<(u32, u32)>>;
pub(crate) const LEVELS: Codec<Vec<Vec<Node>>, Links> = Codec {
    // The state is in the lower half of a word, its predecessor in the upper half.
    write: |v, out| {
        out.integer(v.len());
        for nodes in v {
            out.integer(nodes.len());
            let word = |node: &Node| u64::from(node.from) << 32 | u64::from(node.state);
            nodes.iter().for_each(|node| out.word(word(node)));
        }
    },
    read: |from| {
        let mut levels = Vec::new();
        for _ in 0..from.integer()? {
            let count = from.integer()?;
            let node = |word: u64| Node { state: word as u32, from: (word >> 32) as u32 };
            levels.push(from.words(count)?.map(node).collect());
        }
        Ok(levels)
    },
    data: |v| {
        let pairs = |nodes: &Vec<Node>| nodes.iter().map(|node| (node.state, node.from)).collect();
        v.iter().map(pairs).collect()
    },
    value: |data| {
        let node = |(state, from)| Node { state, from };
        data.into_iter().map(|pairs| pairs.into_iter().map(node).collect()).collect()
    },
};

/// The fields of a decoder's state.
macro_rules! online_viterbi_fields {
    ($apply:ident) => {
        $apply! {
            OnlineViterbiSnapshot, {
                steps: usize = COUNT(best.steps),
                scores: Vec<Option<f64>> = LOGS(best.scores),
                taken_out: [f64; 3] = TAKEN_OUT(best.taken_out),
                undecided: Vec<Vec<(u32, u32)>> = LEVELS(levels),
            }
            bytes: steps, taken_out, scores, undecided
        }
    };
}
online_viterbi_fields!(in_bytes);
#[cfg(feature = "serde")]
use crate::inference::streams::format::with_names;
#[cfg(feature = "serde")]
online_viterbi_fields!(with_names);
