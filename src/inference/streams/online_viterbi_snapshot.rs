//! State of an online decoder, as plain data.

use super::filter_snapshot::MOST_STEPS;
use crate::inference::step::scores::{TakenOut, best};

/// State of an online Viterbi decoder after k steps: plain data, to be kept, compared, sent
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
    pub(crate) steps: usize,
    pub(crate) scores: Vec<f64>,
    pub(crate) taken_out: TakenOut,
    /// States of each undecided step on a surviving path, in ascending order; the oldest step
    /// first.
    pub(crate) levels: Vec<Vec<Node>>,
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
        self.steps
    }

    /// Log-probability ln p(path, y_1 … y_k) of the best path so far; 0 before any step.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.taken_out.log_probability(self.scores[best(&self.scores)])
    }

    /// Creates a snapshot from parts that may be damaged, or those of another decoder.
    pub(crate) fn checked(
        steps: usize,
        scores: Vec<f64>,
        taken_out: TakenOut,
        levels: Vec<Vec<Node>>,
    ) -> Result<Self, String> {
        let states = scores.len();
        if steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        let TakenOut { whole, factors } = &taken_out;
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
                factors.sum, factors.lost
            ));
        }
        if levels.len() > steps {
            return Err(format!("{} undecided steps of {steps}", levels.len()));
        }
        for (at, nodes) in levels.iter().enumerate() {
            let ascending = nodes.is_sorted_by(|a, b| a.state < b.state);
            if !ascending || nodes.last().is_none_or(|last| last.state as usize >= states) {
                return Err(format!(
                    "undecided step {at} does not have states below {states} in ascending order"
                ));
            }
            let mut used: Vec<u32> = nodes.iter().map(|node| node.from).collect();
            used.sort_unstable();
            used.dedup();
            let linked = match at.checked_sub(1) {
                Some(before) => levels[before].iter().map(|node| node.state).eq(used),
                None => used == [0],
            };
            if !linked {
                return Err(format!(
                    "undecided step {at} does not go on from all states of the one before"
                ));
            }
        }
        let possible = || (0..).zip(&scores).filter(|entry| *entry.1 > f64::NEG_INFINITY);
        let ends = match levels.last() {
            Some(last) => possible().map(|entry| entry.0).eq(last.iter().map(|node| node.state)),
            None => steps == 0 || possible().count() == 1,
        };
        if !ends {
            return Err("the paths do not end in the possible states".to_owned());
        }
        Ok(Self { steps, scores, taken_out, levels })
    }
}
