//! A sparse operator with shared parameters.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Deref;

use super::maximize::{normalized, weights};
use super::{LearnTransition, MoveCounts, delegate};
use super::{SparseTransition, Transition, TransitionEntries};
use crate::error::TransitionError;

/// A sparse operator with labelled moves: states whose ways out have the same
/// labels share their probabilities, and ways out of one state with the same
/// label are equally probable.
///
/// So the turning probabilities of a whole town can be learned from a few
/// drives, by the classes of its roads:
/// [`TurningProbabilities::tied`](crate::map::TurningProbabilities::tied). It
/// dereferences to a [`SparseTransition`].
///
/// ```
/// use wayfix::transition::TiedTransition;
/// use wayfix::SparseTransition;
///
/// // On a loop of four places the vehicle stays or moves on, with the same probabilities.
/// let moves = (0..4).flat_map(|j| [(j, j, 0.1 * j as f64), ((j + 1) % 4, j, 1.0 - 0.1 * j as f64)]);
/// let loop_road = SparseTransition::from_triplets(4, moves.filter(|m| m.2 > 0.0))?;
/// let tied = TiedTransition::new(loop_road, |from, to| usize::from(from == to));
/// // State 0 never stays, so that its labels differ from those of 1 to 3.
/// assert_eq!(tied.get(1, 0), 1.0);
/// assert!((tied.get(1, 1) - 0.2).abs() < 1e-15 && (tied.get(3, 3) - 0.2).abs() < 1e-15);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct TiedTransition {
    pub(crate) transition: SparseTransition,
    /// For each entry, column by column, its parameter and the number of entries of its column that
    /// share it.
    pub(crate) parameters: Vec<(u32, u32)>,
}

impl Deref for TiedTransition {
    type Target = SparseTransition;

    fn deref(&self) -> &SparseTransition {
        &self.transition
    }
}

impl TiedTransition {
    /// Ties the moves of an operator by their labels, `label(from, to)`. Tied probabilities become
    /// their mean. O(E log E).
    pub fn new(transition: SparseTransition, mut label: impl FnMut(usize, usize) -> usize) -> Self {
        let mut parameters = Vec::with_capacity(transition.entries());
        let mut known: BTreeMap<(Vec<usize>, usize), u32> = BTreeMap::new();
        for from in 0..transition.states() {
            let labels: Vec<usize> =
                transition.outgoing(&(), from).map(|(to, _)| label(from, to)).collect();
            let mut sorted = labels.clone();
            sorted.sort_unstable();
            for label in labels {
                let times = sorted.iter().filter(|other| **other == label).count();
                let next = known.len() as u32;
                let parameter = *known.entry((sorted.clone(), label)).or_insert(next);
                parameters.push((parameter, times as u32));
            }
        }
        let mut tied = Self { transition, parameters };
        let entries = (0..tied.states())
            .flat_map(|from| tied.transition.outgoing(&(), from).map(move |(to, p)| (to, from, p)));
        let means = tied.shared(entries.collect(), 0.0);
        // Means of distributions are distributions with the same support.
        if let Ok(transition) = SparseTransition::from_triplets(tied.states(), means) {
            tied.transition = transition;
        }
        tied
    }

    /// The number of parameters: labels, counted once for each kind of state.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.parameters.iter().map(|parameter| parameter.0 as usize + 1).max().unwrap_or(0)
    }

    /// Entries, with weights summed over all that share their parameters.
    fn shared(
        &self,
        mut weights: Vec<(usize, usize, f64)>,
        pseudo_count: f64,
    ) -> Vec<(usize, usize, f64)> {
        let mut sums = vec![pseudo_count; self.parameters()];
        for (&(parameter, _), entry) in self.parameters.iter().zip(&weights) {
            sums[parameter as usize] += entry.2;
        }
        for (&(parameter, times), entry) in self.parameters.iter().zip(&mut weights) {
            entry.2 = sums[parameter as usize] / f64::from(times);
        }
        normalized(&self.transition, weights)
    }
}

impl Transition for TiedTransition {
    type Control = ();

    delegate!(a, control => a.transition, control;
        states no_control products blocks evidence needs_logs stored check_control);
}

impl TransitionEntries for TiedTransition {
    delegate!(a, control => a.transition, control; all_entries);
}

impl LearnTransition for TiedTransition {
    fn maximize(&self, counts: &[MoveCounts], pseudo_count: f64) -> Result<Self, TransitionError> {
        let weights = self.shared(weights(&self.transition, &counts[0])?, pseudo_count);
        // An entry that becomes 0 is dropped.
        let kept = self.parameters.iter().zip(&weights).filter(|entry| entry.1.2 > 0.0);
        let mut parameters: Vec<(u32, u32)> = kept.map(|entry| *entry.0).collect();
        // So is a parameter without entries.
        let mut used: Vec<u32> = parameters.iter().map(|parameter| parameter.0).collect();
        used.sort_unstable();
        used.dedup();
        for parameter in &mut parameters {
            parameter.0 = used.partition_point(|number| *number < parameter.0) as u32;
        }
        let transition = SparseTransition::from_triplets(self.states(), weights)?;
        Ok(Self { transition, parameters })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        // Each parameter counts once.
        let mut logs = vec![0.0; self.parameters()];
        let columns = (0..self.states()).flat_map(|from| self.transition.outgoing(&(), from));
        for (&(parameter, times), entry) in self.parameters.iter().zip(columns) {
            logs[parameter as usize] = (entry.1 * f64::from(times)).ln();
        }
        pseudo_count * logs.iter().sum::<f64>()
    }

    /// Returns the number of parameters less one for each kind of state.
    fn free_parameters(&self) -> usize {
        let mut sums: BTreeSet<Vec<u32>> = BTreeSet::new();
        let mut entries = self.parameters.iter();
        for from in 0..self.states() {
            let count = self.transition.outgoing(&(), from).count();
            let mut kind: Vec<u32> = entries.by_ref().take(count).map(|entry| entry.0).collect();
            kind.sort_unstable();
            sums.insert(kind);
        }
        self.parameters() - sums.len()
    }
}
