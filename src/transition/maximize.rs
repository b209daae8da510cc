//! The M-step of stored and switched operators: transition probabilities from expected moves,
//! A\[i, j\] = (count of j → i + pseudo-count) / (the same, summed over the entries of column j).

use super::{
    DenseTransition, LearnFromMoves, LearnTransition, Move, MoveCounts, SparseTransition,
    SwitchedTransition, Transition, TransitionEntries,
};
use crate::error::TransitionError;
use crate::fixed::Fixed;

/// Expected number of each entry above 0: (to, from, weight), column by column. A move
/// without an entry is an error.
pub(super) fn weights<A: TransitionEntries<Control = ()>>(
    transition: &A,
    counts: &MoveCounts,
) -> Result<Vec<(usize, usize, f64)>, TransitionError> {
    // A merge: both counts and entries come sorted by (from, to). So a count
    // without an entry stops the iterator, and is what is left at the end.
    let mut moves = counts.moves().peekable();
    let mut weights = Vec::new();
    for from in 0..transition.states() {
        for (to, _) in transition.outgoing(&(), from) {
            let seen = moves.next_if(|m| (m.from, m.to) == (from, to));
            weights.push((to, from, seen.map_or(0.0, |m| m.weight)));
        }
    }
    match moves.next() {
        Some(Move { from, to, .. }) => Err(TransitionError::Forbidden { to, from }),
        None => Ok(weights),
    }
}

/// Normalises columns of weights. A column whose sum is below the smallest normal double keeps the
/// entries of the operator. A NaN or infinite weight makes its column NaN, which no constructor
/// accepts.
fn normalized<A: TransitionEntries<Control = ()>>(
    transition: &A,
    mut weights: Vec<(usize, usize, f64)>,
) -> Vec<(usize, usize, f64)> {
    for column in weights.chunk_by_mut(|a, b| a.1 == b.1) {
        let from = column[0].1;
        let sum: f64 = column.iter().map(|entry| entry.2).sum();
        // False for a NaN, on purpose.
        if sum < f64::MIN_POSITIVE {
            let old = transition.outgoing(&(), from);
            column.iter_mut().zip(old).for_each(|(entry, old)| entry.2 = old.1);
        } else {
            column.iter_mut().for_each(|entry| entry.2 /= sum);
        }
    }
    weights
}

/// The columns that make the moves most probable, if each entry is a free parameter.
fn free<A: TransitionEntries<Control = ()>>(
    transition: &A,
    counts: &MoveCounts,
) -> Result<Vec<(usize, usize, f64)>, TransitionError> {
    // Maximises Σ count ln p in each column, by Gibbs' inequality.
    Ok(normalized(transition, weights(transition, counts)?))
}

/// Number of entries above 0, less one for each column.
fn free_entries<A: TransitionEntries<Control = ()>>(transition: &A) -> usize {
    // At least one entry a column, since it sums to one.
    let columns = 0..transition.states();
    columns.map(|from| transition.outgoing(&(), from).count() - 1).sum()
}

impl LearnFromMoves for SparseTransition {
    fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError> {
        Self::from_triplets(self.states(), free(self, counts)?)
    }

    fn free_parameters(&self) -> usize {
        free_entries(self)
    }
}

impl LearnFromMoves for DenseTransition {
    fn maximize(&self, counts: &MoveCounts) -> Result<Self, TransitionError> {
        let n = self.states();
        let mut matrix = vec![0.0; n * n];
        for (to, from, p) in free(self, counts)? {
            matrix[to * n + from] = p;
        }
        Self::from_row_major(n, &matrix)
    }

    fn free_parameters(&self) -> usize {
        free_entries(self)
    }
}

impl<A: LearnTransition<Control = ()>> LearnTransition for SwitchedTransition<A> {
    /// Statistics of each operator.
    type Statistics = Vec<A::Statistics>;

    fn statistics(&self) -> Self::Statistics {
        self.operators.iter().map(A::statistics).collect()
    }

    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
        let each = self.operators.iter().zip(statistics.iter_mut().zip(other));
        each.for_each(|(a, (statistics, other))| a.merge(statistics, other));
    }

    fn counts<'s>(
        &self,
        statistics: &'s mut Self::Statistics,
        &control: &usize,
    ) -> Option<&'s mut MoveCounts> {
        self.operators[control].counts(statistics.get_mut(control)?, &())
    }

    fn add_step(
        &self,
        statistics: &mut Self::Statistics,
        &control: &usize,
        before: &[f64],
        after: &[f64],
        scale: f64,
    ) -> Option<f64> {
        let statistics = statistics.get_mut(control)?;
        self.operators[control].add_step(statistics, &(), before, after, scale)
    }

    fn counted(&self, &control: &usize, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.operators[control].counted(&(), from)
    }

    fn counted_log2(&self, &control: &usize, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.operators[control].counted_log2(&(), from)
    }

    fn restart_log2(&self, &control: &usize, to: usize) -> f64 {
        self.operators[control].restart_log2(&(), to)
    }

    fn maximize(
        &self,
        statistics: &Self::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let (found, expected) = (statistics.len(), self.operators.len());
        if found != expected {
            return Err(TransitionError::Statistics { found, expected });
        }
        let learned = self.operators.iter().zip(statistics);
        let learned = learned.map(|(a, statistics)| a.maximize(statistics, pseudo_count));
        Self::new(learned.collect::<Result<_, _>>()?)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        self.operators.iter().map(|a| a.log_prior(pseudo_count)).sum()
    }

    fn free_parameters(&self) -> usize {
        self.operators.iter().map(LearnTransition::free_parameters).sum()
    }
}

impl<A: TransitionEntries + Clone> LearnTransition for Fixed<A> {
    type Statistics = ();

    fn statistics(&self) {}

    fn merge(&self, (): &mut (), (): &()) {}

    fn counts<'s>(&self, (): &'s mut (), _: &A::Control) -> Option<&'s mut MoveCounts> {
        None
    }

    fn maximize(&self, (): &(), _: f64) -> Result<Self, TransitionError> {
        Ok(self.clone())
    }

    fn log_probability(&self, (): &()) -> Option<f64> {
        Some(0.0)
    }

    fn log_prior(&self, _: f64) -> f64 {
        0.0
    }

    fn free_parameters(&self) -> usize {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_weight_that_is_no_number_is_an_error() {
        let a = DenseTransition::from_rows(&[[0.7, 0.4], [0.3, 0.6]]).unwrap();
        for bad in [f64::NAN, f64::INFINITY] {
            let columns = normalized(&a, vec![(0, 0, bad), (1, 0, 1.0), (0, 1, 0.0), (1, 1, 0.0)]);
            assert_eq!(columns[2..], [(0, 1, 0.4), (1, 1, 0.6)]);
            let error = SparseTransition::from_triplets(2, columns).unwrap_err().to_string();
            assert!(error.contains("has probability NaN"), "{error}");
        }
    }
}
