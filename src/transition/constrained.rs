//! [`ConstrainedTransition`], a sparse operator whose entries are free, fixed, tied, or have prior
//! counts of their own.
//!
//! Each entry names a parameter. Invariant: two columns share either all of their free parameters
//! or none (states of one kind), and a column's parameters, each times its number of entries there,
//! are one distribution of what its fixed entries leave. So parameters are re-estimated by summing
//! the counts of their entries, as if all states of a kind were one.

use std::collections::{BTreeMap, BTreeSet};

use super::learn::log_probability;
use super::maximize::weights;
use super::{
    LearnTransition, MoveCounts, SparseTransition, Transition, TransitionEntries, delegate,
};
use crate::error::TransitionError;

/// Parameter number that marks an entry which learning keeps.
pub(crate) const FIXED: u32 = u32::MAX;

/// A sparse operator with a description of how its entries are learned.
///
/// Each entry above 0 is a parameter of its own, but entries may have:
///
/// - [Fixed values](Self::with_fixed): they stay as they are; the others of their column share the
///   rest.
/// - [Ties](Self::with_ties): states whose ways out have the same labels share their
///   probabilities, and ways out of one state with the same label are equally probable. So the
///   turning probabilities of a whole town can be learned from a few drives, by the classes of its
///   roads: [`TurningProbabilities::tied`](crate::map::TurningProbabilities::tied).
/// - [Pseudo-counts](Self::with_pseudo_counts) of their own: a Dirichlet prior for each column,
///   such as one for staying (a sticky model).
///
/// ```
/// use wayfix::transition::ConstrainedTransition;
/// use wayfix::SparseTransition;
///
/// // On a loop of four places the vehicle stays or moves on, with the same probabilities.
/// let moves = (0..4).flat_map(|j| [(j, j, 0.1 * j as f64), ((j + 1) % 4, j, 1.0 - 0.1 * j as f64)]);
/// let loop_road = SparseTransition::from_triplets(4, moves.filter(|m| m.2 > 0.0))?;
/// let loop_road = ConstrainedTransition::new(loop_road);
/// let tied = loop_road.with_ties(|from, to| usize::from(from == to));
/// // State 0 never stays, so that its labels differ from those of 1 to 3.
/// let a = tied.inner();
/// assert_eq!(a.get(1, 0), 1.0);
/// assert!((a.get(1, 1) - 0.2).abs() < 1e-15 && (a.get(3, 3) - 0.2).abs() < 1e-15);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
///
/// A machine that is repaired at a known rate, and probably stays as it is:
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix::transition::ConstrainedTransition;
/// use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// let states = SparseTransition::from_rows(&[[0.8, 0.1, 0.25], [0.1, 0.8, 0.0], [0.1, 0.1, 0.75]])?;
/// let states = ConstrainedTransition::new(states)
///     .with_fixed(|from, to| (from, to) == (2, 0))
///     .with_pseudo_counts(|from, to| if from == to { 10.0 } else { 0.0 })?;
/// let sensor = TableLikelihood::from_rows(&[[0.8, 0.2, 0.0], [0.3, 0.7, 0.0], [0.0, 0.2, 0.8]])?;
/// let hmm = Hmm::new(Prior::AtFirstObservation(Belief::certain(3, 0)?), states, sensor)?;
/// let learned = hmm.learn(&[[0, 0, 1, 1, 2, 0, 0, 0, 1, 2, 2]], &LearningOptions::default())?;
/// let states = learned.model().transition().inner();
/// assert!(states.get(0, 2) == 0.25 && states.get(1, 1) > 0.7);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct ConstrainedTransition {
    pub(crate) transition: SparseTransition,
    /// For each entry, column by column, its parameter and the number of entries of its column that
    /// share it.
    pub(crate) parameters: Vec<(u32, u32)>,
    /// Pseudo-count of each entry; empty if all are 0.
    pub(crate) pseudo_counts: Vec<f64>,
}

impl ConstrainedTransition {
    /// Creates an operator where each entry is a parameter of its own. O(E).
    #[must_use]
    pub fn new(transition: SparseTransition) -> Self {
        let parameters = (0..transition.entries() as u32).map(|entry| (entry, 1)).collect();
        Self { transition, parameters, pseudo_counts: Vec::new() }
    }

    /// The operator without the description.
    #[must_use]
    pub fn inner(&self) -> &SparseTransition {
        &self.transition
    }

    /// Keeps the entries of these moves, `is_fixed(from, to)`, as they are. O(E log E).
    #[must_use]
    pub fn with_fixed(self, mut is_fixed: impl FnMut(usize, usize) -> bool) -> Self {
        self.relabelled(|from, to, known| if is_fixed(from, to) { FIXED as usize } else { known })
    }

    /// Ties the moves that are not fixed by their labels, `label(from, to)`, in place of earlier
    /// ties. Tied probabilities become their mean; beside fixed entries, the mean of their shares
    /// in the rest of the column. O(E log E).
    #[must_use]
    pub fn with_ties(self, mut label: impl FnMut(usize, usize) -> usize) -> Self {
        let mut tied = self.relabelled(|from, to, known| {
            if known == FIXED as usize { known } else { label(from, to).min(FIXED as usize - 1) }
        });
        let shares = tied.map_free_columns(|column, rest| {
            column.iter_mut().for_each(|entry| entry.2 /= rest);
        });
        let means = tied.tied_entries(shares, 0.0);
        // Means of distributions are distributions with the same support.
        if let Ok(transition) = SparseTransition::from_triplets(tied.states(), means) {
            tied.transition = transition;
        }
        tied
    }

    /// Sets numbers of moves, `count(from, to)`, that learning counts in addition to those seen,
    /// beside the [pseudo-count](crate::inference::LearningOptions::transition_pseudo_count) of
    /// each parameter; those of fixed entries have no influence. O(E).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Weight`] for a count that is NaN, negative or infinite.
    pub fn with_pseudo_counts(
        mut self,
        mut count: impl FnMut(usize, usize) -> f64,
    ) -> Result<Self, TransitionError> {
        let mut pseudo_counts = Vec::with_capacity(self.transition.entries());
        for (to, from, _) in self.by_columns() {
            let value = count(from, to);
            if !(value >= 0.0 && value.is_finite()) {
                return Err(TransitionError::Weight { to, from, value });
            }
            pseudo_counts.push(value);
        }
        self.pseudo_counts = pseudo_counts;
        Ok(self)
    }

    /// Number of parameters: entries that are neither fixed nor tied, and the labels of tied ones,
    /// counted once for each kind of state.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.free().map(|parameter| parameter.0 as usize + 1).max().unwrap_or(0)
    }

    /// Parameters of the entries that are not fixed.
    fn free(&self) -> impl Iterator<Item = (u32, u32)> {
        self.parameters.iter().copied().filter(|parameter| parameter.0 != FIXED)
    }

    /// Entries (to, from, p), column by column.
    fn by_columns(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let column = |from| self.transition.outgoing(&(), from).map(move |(to, p)| (to, from, p));
        (0..self.states()).flat_map(column)
    }

    /// Renumbers the parameters by their labels, `label(from, to, present parameter)`.
    fn relabelled(mut self, mut label: impl FnMut(usize, usize, usize) -> usize) -> Self {
        // A kind of state is the sorted list of the labels of its free ways out, with repetitions;
        // a parameter is a kind and one of its labels.
        let mut parameter_numbers: BTreeMap<(Vec<usize>, usize), u32> = BTreeMap::new();
        let mut parameters = Vec::with_capacity(self.parameters.len());
        for from in 0..self.states() {
            let present = &self.parameters[parameters.len()..];
            let column = self.transition.outgoing(&(), from).zip(present);
            let labels: Vec<usize> =
                column.map(|((to, _), known)| label(from, to, known.0 as usize)).collect();
            let is_free = |label: &&usize| **label != FIXED as usize;
            let mut sorted: Vec<usize> = labels.iter().filter(is_free).copied().collect();
            sorted.sort_unstable();
            for label in labels {
                if !is_free(&&label) {
                    parameters.push((FIXED, 1));
                    continue;
                }
                let times = sorted.iter().filter(|other| **other == label).count();
                let next = parameter_numbers.len() as u32;
                let parameter = *parameter_numbers.entry((sorted.clone(), label)).or_insert(next);
                parameters.push((parameter, times as u32));
            }
        }
        self.parameters = parameters;
        self
    }

    /// Entries (to, from, p) after `change(free entries, their sum)` has been called for each
    /// column.
    pub(super) fn map_free_columns(
        &self,
        mut change: impl FnMut(&mut [(usize, usize, f64)], f64),
    ) -> Vec<(usize, usize, f64)> {
        let mut entries: Vec<(usize, usize, f64)> = self.by_columns().collect();
        let mut free = Vec::new();
        let mut at = 0;
        for column in entries.chunk_by_mut(|a, b| a.1 == b.1) {
            let parameters = &self.parameters[at..][..column.len()];
            at += column.len();
            let is_free = |k: &usize| parameters[*k].0 != FIXED;
            free.clear();
            free.extend((0..column.len()).filter(is_free).map(|k| column[k]));
            let rest = free.iter().map(|entry| entry.2).sum();
            change(&mut free, rest);
            let places = (0..column.len()).filter(is_free);
            places.zip(&free).for_each(|(k, entry)| column[k] = *entry);
        }
        entries
    }

    /// Entries from weights, which are summed over all entries that share a parameter, and then
    /// normalised over the free entries of each column. A column without weights stays.
    fn tied_entries(
        &self,
        weights: Vec<(usize, usize, f64)>,
        pseudo_count: f64,
    ) -> Vec<(usize, usize, f64)> {
        let mut sums = vec![pseudo_count; self.parameters()];
        let free = |entry: &(&(u32, u32), (usize, usize, f64))| entry.0.0 != FIXED;
        let all = self.parameters.iter().zip(weights).filter(free);
        all.clone().for_each(|(parameter, entry)| sums[parameter.0 as usize] += entry.2);
        // For each free entry in order; `map_free_columns` asks for them column by column, in that
        // order.
        let mut each =
            all.map(|(parameter, _)| sums[parameter.0 as usize] / f64::from(parameter.1));
        let mut shares = Vec::new();
        self.map_free_columns(|column, rest| {
            shares.clear();
            shares.extend(each.by_ref().take(column.len()));
            let sum: f64 = shares.iter().sum();
            // A NaN or infinite weight makes its column NaN, which no constructor accepts.
            if sum.is_nan() || sum >= f64::MIN_POSITIVE {
                let of = column.iter_mut().zip(&shares);
                of.for_each(|(entry, share)| entry.2 = share / sum * rest);
            }
        })
    }
}

impl Transition for ConstrainedTransition {
    type Control = ();

    delegate!(a, control => a.transition, control;
        states products blocks evidence needs_logs stored check_control);
}

impl TransitionEntries for ConstrainedTransition {
    delegate!(a, control => a.transition, control; all_entries);
}

impl LearnTransition for ConstrainedTransition {
    type Statistics = MoveCounts;

    fn statistics(&self) -> MoveCounts {
        MoveCounts::default()
    }

    fn merge(&self, counts: &mut MoveCounts, other: &MoveCounts) {
        counts.merge(other);
    }

    fn counts<'s>(&self, counts: &'s mut MoveCounts, (): &()) -> Option<&'s mut MoveCounts> {
        Some(counts)
    }

    fn log_probability(&self, counts: &MoveCounts) -> Option<f64> {
        Some(log_probability(self, counts))
    }

    // A pseudo-count belongs to a parameter, however many entries share it: hence not by
    // `LearnFromMoves`, which adds one to each entry.
    fn maximize(&self, counts: &MoveCounts, pseudo_count: f64) -> Result<Self, TransitionError> {
        let mut weights = weights(&self.transition, counts)?;
        weights.iter_mut().zip(&self.pseudo_counts).for_each(|(entry, count)| entry.2 += count);
        let entries = self.tied_entries(weights, pseudo_count);
        // A sparse matrix drops an entry that becomes 0, and parameters are matched by position.
        let kept = (0..entries.len()).filter(|at| entries[*at].2 > 0.0);
        let kept: Vec<usize> = kept.collect();
        let mut parameters: Vec<(u32, u32)> = kept.iter().map(|at| self.parameters[*at]).collect();
        let pseudo_counts = kept.iter().filter_map(|at| self.pseudo_counts.get(*at)).copied();
        let pseudo_counts = pseudo_counts.collect();
        // Parameters without entries are also dropped, and the others renumbered. FIXED is the
        // largest number, so it is last in the list and shifts no other.
        let mut used: Vec<u32> = parameters.iter().map(|parameter| parameter.0).collect();
        used.sort_unstable();
        used.dedup();
        for parameter in parameters.iter_mut().filter(|parameter| parameter.0 != FIXED) {
            parameter.0 = used.partition_point(|number| *number < parameter.0) as u32;
        }
        let transition = SparseTransition::from_triplets(self.states(), entries)?;
        Ok(Self { transition, parameters, pseudo_counts })
    }

    /// Counts each parameter once, and adds the pseudo-counts of the entries.
    fn log_prior(&self, pseudo_count: f64) -> f64 {
        // A parameter has the same share in each of its columns; the last column's is kept. In a
        // column with fixed entries p also has a constant factor: what these leave of the column.
        let mut logs = vec![0.0; self.parameters()];
        let mut sum = 0.0;
        for (at, (&(parameter, times), (.., p))) in
            self.parameters.iter().zip(self.by_columns()).enumerate()
        {
            let count = self.pseudo_counts.get(at).copied().unwrap_or(0.0);
            if parameter != FIXED {
                logs[parameter as usize] = (p * f64::from(times)).ln();
                sum += if count > 0.0 { count * p.ln() } else { 0.0 };
            }
        }
        sum + if pseudo_count > 0.0 { pseudo_count * logs.iter().sum::<f64>() } else { 0.0 }
    }

    /// Returns the number of parameters, less one for each kind of state.
    fn free_parameters(&self) -> usize {
        // A column of a kind lists all of its parameters, and no other kind has any of them.
        let mut kinds: BTreeSet<Vec<u32>> = BTreeSet::new();
        let mut entries = self.parameters.iter();
        for from in 0..self.states() {
            let count = self.transition.outgoing(&(), from).count();
            let column = entries.by_ref().take(count).map(|entry| entry.0);
            let mut kind: Vec<u32> = column.filter(|parameter| *parameter != FIXED).collect();
            kind.sort_unstable();
            kinds.insert(kind);
        }
        self.parameters() - kinds.iter().filter(|kind| !kind.is_empty()).count()
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] ConstrainedTransition: [], |a| {
        transition: SparseTransition = a.transition,
        parameters: Vec<Option<u32>> = {
            let number = |parameter: &(u32, u32)| (parameter.0 != FIXED).then_some(parameter.0);
            a.parameters.iter().map(number).collect::<Vec<_>>()
        },
        pseudo_counts: Vec<f64> = a.pseudo_counts,
    } => constrained(transition, &parameters, &pseudo_counts);
}

/// Checks parameters for the invariants of [`ConstrainedTransition`]: they are numbered without
/// gaps, have equal shares of what is not fixed up to rounding, and two states share all of theirs
/// or none.
#[cfg(feature = "serde")]
fn constrained(
    transition: SparseTransition,
    numbers: &[Option<u32>],
    pseudo_counts: &[f64],
) -> Result<ConstrainedTransition, String> {
    let (found, expected) = (numbers.len(), transition.entries());
    if found != expected {
        return Err(format!("{found} parameters for {expected} entries, expected one each"));
    }
    let mut used: Vec<u32> = numbers.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    if let Some((gap, _)) =
        used.iter().enumerate().find(|(number, used)| **used as usize != *number)
    {
        return Err(format!("no entry has parameter {gap}, though one has a higher one"));
    }
    let mut kinds = BTreeMap::new();
    let mut known: Vec<Option<(usize, f64)>> = vec![None; used.len()];
    let mut parameters = Vec::with_capacity(found);
    for from in 0..transition.states() {
        let column = &numbers[parameters.len()..];
        let column = &column[..transition.outgoing(&(), from).count()];
        let mut sorted: Vec<u32> = column.iter().flatten().copied().collect();
        sorted.sort_unstable();
        let next = kinds.len();
        let kind = *kinds.entry(sorted.clone()).or_insert(next);
        let entries = || column.iter().zip(transition.outgoing(&(), from));
        let rest: f64 = entries().filter(|entry| entry.0.is_some()).map(|entry| entry.1.1).sum();
        for (number, (to, p)) in entries() {
            let Some(number) = *number else {
                parameters.push((FIXED, 1));
                continue;
            };
            let share = p / rest;
            let (its_kind, value) = *known[number as usize].get_or_insert((kind, share));
            if its_kind != kind || (share - value).abs() > crate::belief::SUM_TOLERANCE {
                return Err(format!(
                    "the transition from state {from} to state {to} has parameter {number}, which another state has with other parameters or another probability"
                ));
            }
            let after = sorted.partition_point(|other| *other <= number);
            let times = after - sorted.partition_point(|other| *other < number);
            parameters.push((number, times as u32));
        }
    }
    let constrained = ConstrainedTransition { transition, parameters, pseudo_counts: Vec::new() };
    if pseudo_counts.is_empty() {
        return Ok(constrained);
    }
    if pseudo_counts.len() != found {
        let given = pseudo_counts.len();
        return Err(format!("{given} pseudo-counts for {found} entries, expected one each"));
    }
    let mut counts = pseudo_counts.iter().copied();
    let counted = constrained.with_pseudo_counts(|_, _| counts.next().unwrap_or_default());
    counted.map_err(|error| error.to_string())
}
