//! The M-step: coefficients that make the expected moves most probable (section 9 of the
//! [formulas](wayfix::guide::formulas)). Here coefficients are converted between the operator, whose
//! inputs have units, and the search in `newton.rs`, whose inputs are scaled and centred.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::error::Error;

use wayfix::inference::{Displacement, FreeParameters};
use wayfix::transition::{LearnTransition, MoveCounts};
use wayfix::{Transition, TransitionError};

use super::newton::{Component, OriginCounts, Point};
use super::{LogitTransition, newton};

impl LogitTransition {
    /// Returns the moves whose probabilities run to 0 at some of these inputs, as pairs (from, to):
    /// moves that were never seen, or that the inputs separate from the others. Their coefficients
    /// have no finite maximum: learning ends where the remaining gain is rounding. A
    /// [ridge](Self::with_ridge) (or pseudo-counts, for moves never seen) makes the maximum finite.
    /// Call it on a learned model, with its own expected moves as counted by
    /// [`Hmm::expectations`](wayfix::Hmm::expectations).
    ///
    /// ```
    /// use wayfix_learn::{InputCounts, LogitTransition};
    /// use wayfix::transition::{LearnTransition, MoveCounts};
    /// use wayfix::SparseTransition;
    ///
    /// // It moves whenever the input is positive.
    /// let mut counts = InputCounts::default();
    /// for (input, to) in [(-2.0, 0), (-0.5, 0), (0.5, 1), (2.0, 1)] {
    ///     counts.add(&[input], &MoveCounts::of_path(&[0, to]));
    /// }
    /// let still = SparseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]])?;
    /// let start = LogitTransition::new(&still, 1)?;
    /// let learned = start.maximize(&counts, 0.0)?;
    /// assert_eq!(learned.separated(&counts, 0.0)?, [(0, 0), (0, 1)]);
    /// assert!(learned.at(&[0.5])?.get(1, 0) > 0.999_999);
    ///
    /// let learned = start.with_ridge(1.0)?.maximize(&counts, 0.0)?;
    /// assert_eq!(learned.separated(&counts, 0.0)?, []);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for counts that [`maximize`](LearnTransition::maximize) refuses.
    pub fn separated(
        &self,
        counts: &InputCounts,
        pseudo_count: f64,
    ) -> Result<Vec<(usize, usize)>, TransitionError> {
        let (rows, left) = self.data(counts, pseudo_count)?;
        let mut found = Vec::new();
        for part in self.parts(&rows, left) {
            for (origin, at) in newton::diverging_moves(&part, &self.point(&part, &rows)) {
                let at = part.origins[origin].first + at;
                let from = self.starts.partition_point(|start| *start as usize <= at) - 1;
                found.push((from, self.to[at] as usize));
            }
        }
        found.sort_unstable();
        Ok(found)
    }

    /// Coefficients of a part, for scaled and centred inputs.
    fn point(&self, part: &Component<'_>, rows: &Rows) -> Point {
        // a + b · u with u = scale (x + centre): the slope on x is b scale, and the intercept is
        // the score at the centre.
        let p = self.inputs;
        let slope = |(at, scale): (usize, &f64)| self.slopes[at] * scale;
        let slopes = part.groups.iter().flat_map(|g| (g * p..(g + 1) * p).zip(&rows.scales));
        let slopes: Vec<f64> = slopes.map(slope).collect();
        let intercepts = part.origins.iter().map(|seen| {
            let moves = 0..seen.group_of.len();
            let own = &self.intercepts[seen.first..];
            moves.map(|at| seen.score(at, own, &slopes, &rows.centres)).collect()
        });
        Point { intercepts: intercepts.collect(), slopes }
    }

    /// Sets the coefficients of a part. The intercept of the reference of each state stays, as do
    /// all intercepts of a state that was never left.
    fn set(&mut self, part: &Component<'_>, point: &Point, rows: &Rows) {
        let p = self.inputs;
        let slopes = part.groups.iter().flat_map(|g| (g * p..(g + 1) * p).zip(&rows.scales));
        for ((at, scale), slope) in slopes.zip(&point.slopes) {
            self.slopes[at] = slope / scale;
        }
        let back: Vec<f64> = rows.centres.iter().map(|centre| -centre).collect();
        let left = part.origins.iter().zip(&point.intercepts);
        for (seen, intercepts) in left.filter(|origin| !origin.0.rows.is_empty()) {
            let score = |at: usize| seen.score(at, intercepts, &point.slopes, &back);
            let range = seen.first..seen.first + intercepts.len();
            let from = self.starts.partition_point(|start| *start as usize <= seen.first) - 1;
            // Adding a constant to all scores of a state changes no probability: it is chosen such
            // that the operator's reference, not that of the search, has its old intercept.
            let reference = self.reference(from).and_then(|to| self.find(from, to));
            let reference = reference.unwrap_or(seen.first);
            let shift = self.intercepts[reference] - score(reference - seen.first);
            for at in range.filter(|at| *at != reference) {
                self.intercepts[at] = score(at - seen.first) + shift;
            }
        }
    }
}

impl LearnTransition for LogitTransition {
    type Statistics = InputCounts;

    fn statistics(&self) -> InputCounts {
        InputCounts::default()
    }

    fn merge(&self, counts: &mut InputCounts, other: &InputCounts) {
        counts.merge(other);
    }

    fn counts<'s>(
        &self,
        counts: &'s mut InputCounts,
        inputs: &Vec<f64>,
    ) -> Option<&'s mut MoveCounts> {
        Some(counts.at(inputs))
    }

    /// Maximises Σ counts ln A\[i, j\](u) + ln p(coefficients), by Newton's method. With m moves
    /// out of a state and R distinct rows of inputs, an iteration is O(R n (m² + m² p²)); the first
    /// M-step takes about ten, later ones fewer.
    ///
    /// Pseudo-counts act as moves at inputs of 0: `pseudo_count` for each legal move.
    fn maximize(&self, counts: &InputCounts, pseudo_count: f64) -> Result<Self, TransitionError> {
        let (rows, left) = self.data(counts, pseudo_count)?;
        let mut learned = self.clone();
        for part in self.parts(&rows, left) {
            let start = self.point(&part, &rows);
            if let Some(point) = newton::climb(&part, &start) {
                learned.set(&part, &point, &rows);
            }
        }
        learned.check_and_bound()?;
        Ok(learned)
    }

    /// Returns `pseudo_count` Σ ln A\[i, j\](0), less λ / 2 times the sum of the squared slopes.
    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let mut log_prior = 0.0;
        if pseudo_count > 0.0 {
            let mut logs = vec![0.0; self.widest];
            for from in 0..self.states() {
                let logs = &mut logs[..self.column(from).len()];
                self.logs(&[], from, logs); // no terms of inputs
                log_prior += pseudo_count * logs.iter().sum::<f64>();
            }
        }
        let squares: f64 = self.slopes.iter().map(|slope| slope * slope).sum();
        log_prior - if self.ridge > 0.0 { 0.5 * self.ridge * squares } else { 0.0 }
    }

    /// Returns the number of moves less one for each state, plus p for each group of slopes, less
    /// the groups that are determined by others, since only differences matter.
    fn free_parameters(&self) -> usize {
        // One group of each connected set is fixed: the same slopes added to all moves out of the
        // states that it connects change nothing.
        let sets = self.connected_groups(true);
        let joined = (0..sets.len()).filter(|group| sets[*group] != *group).count();
        self.to.len() - self.states() + joined * self.inputs
    }
}

/// Intercepts, except those of the references, then the slopes of each group. Without a ridge, only
/// differences matter within a connected set of groups, and the slopes of one group of it stay.
impl FreeParameters for LogitTransition {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut moved = self.clone();
        for from in 0..self.states() {
            let reference = self.reference(from);
            for at in self.column(from) {
                if reference != Some(self.to[at] as usize) {
                    moved.intercepts[at] = by.logarithm(self.intercepts[at]);
                }
            }
        }
        let sets = self.connected_groups(true);
        // The first group of each set stays. This is group 0, of moves without slopes, if the set
        // contains it.
        let first = |group: usize| sets.iter().position(|set| *set == sets[group]);
        for group in 1..sets.len() {
            if self.ridge > 0.0 || first(group) != Some(group) {
                let own = (group - 1) * self.inputs..group * self.inputs;
                moved.slopes[own].iter_mut().for_each(|slope| *slope = by.real(*slope));
            }
        }
        moved.check_and_bound()?;
        Ok(moved)
    }
}

// [`InputCounts`]: expected moves by the inputs of their steps.

/// Expected number of moves for each distinct row of inputs: the statistics of a
/// [`LogitTransition`](crate::logit::LogitTransition).
///
/// Rows are compared by their bits, and listed in ascending order. So the cost of a category, or of
/// a time of day by the hour, is that of its distinct values; inputs that never repeat cost the
/// moves of every step.
///
/// ```
/// use wayfix_learn::InputCounts;
/// use wayfix::transition::MoveCounts;
///
/// let mut counts = InputCounts::default();
/// counts.add(&[1.0, 0.0], &MoveCounts::of_path(&[0, 1]));
/// counts.add(&[0.0, 0.0], &MoveCounts::of_path(&[1, 1]));
/// counts.add(&[1.0, 0.0], &MoveCounts::of_path(&[0, 1]));
/// let all: Vec<_> = counts.rows().map(|(inputs, moves)| (inputs[0], moves.get(0, 1))).collect();
/// assert_eq!(all, [(0.0, 0.0), (1.0, 2.0)]);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InputCounts {
    rows: BTreeMap<Row, MoveCounts>,
}

/// A row of inputs as a key.
#[derive(Debug, Clone)]
struct Row(Vec<f64>);

impl Ord for Row {
    fn cmp(&self, other: &Self) -> Ordering {
        // Lexicographic in the total order of doubles, where −0 and 0 differ, and a NaN equals
        // itself, as a key must.
        let pairs = self.0.iter().zip(&other.0);
        let mut different = pairs.map(|(a, b)| a.total_cmp(b)).filter(|order| order.is_ne());
        different.next().unwrap_or_else(|| self.0.len().cmp(&other.0.len()))
    }
}

impl PartialOrd for Row {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Row {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Row {}

impl InputCounts {
    /// The rows of inputs with the moves of their steps, in ascending order.
    #[must_use]
    pub fn rows(&self) -> impl ExactSizeIterator<Item = (&[f64], &MoveCounts)> {
        self.rows.iter().map(|(row, counts)| (&row.0[..], counts))
    }

    /// Adds moves made at these inputs. O(log rows + moves).
    pub fn add(&mut self, inputs: &[f64], counts: &MoveCounts) {
        self.at(inputs).merge(counts);
    }

    /// Adds other counts. O(rows log rows + moves).
    pub fn merge(&mut self, other: &Self) {
        other.rows().for_each(|(inputs, counts)| self.add(inputs, counts));
    }

    /// Counts at these inputs.
    pub(super) fn at(&mut self, inputs: &[f64]) -> &mut MoveCounts {
        self.rows.entry(Row(inputs.to_vec())).or_default()
    }
}

// Expected moves in the form of the M-step: by origin, with inputs scaled to at most 1 and
// centred, so that their units cost no digits, and in parts without common slopes, each maximised
// by itself.

/// Smallest size at which an input is scaled, so that its square is in the range of doubles.
const LEAST_SCALE: f64 = 1e-150;

/// Rows of inputs at which a state was left, and for each row the weights of the state's moves.
type OriginRows = (Vec<usize>, Vec<f64>);

/// Rows of inputs in the form of learning.
#[derive(Debug)]
pub(super) struct Rows {
    /// Scaled and centred, one after another.
    values: Vec<f64>,
    pub(super) scales: Vec<f64>,
    /// Mean of the scaled inputs.
    pub(super) centres: Vec<f64>,
    /// Precision of the prior on the slope of each scaled input.
    ridge: Vec<f64>,
}

/// Root of a set in a forest of disjoint sets.
fn root(parents: &mut [usize], mut set: usize) -> usize {
    // Halves the path on the way, so that later searches are short (Tarjan and van Leeuwen 1984).
    while parents[set] != set {
        parents[set] = parents[parents[set]];
        set = parents[set];
    }
    set
}

impl LogitTransition {
    /// Rows of inputs, and the weights of moves out of each state. A `pseudo_count` is added for
    /// each legal move, at inputs of 0.
    pub(super) fn data(
        &self,
        counts: &InputCounts,
        pseudo_count: f64,
    ) -> Result<(Rows, Vec<OriginRows>), TransitionError> {
        let p = self.inputs;
        let mut values = Vec::new();
        let mut left: Vec<OriginRows> = vec![(Vec::new(), Vec::new()); self.states()];
        for (row, (inputs, moves)) in counts.rows().enumerate() {
            self.check_inputs(inputs)?;
            self.add_row(row, moves, &mut left)?;
            values.extend_from_slice(inputs);
        }
        if pseudo_count > 0.0 {
            for (from, left) in left.iter_mut().enumerate() {
                left.0.push(values.len() / p);
                left.1.extend(self.column(from).map(|_| pseudo_count));
            }
            values.extend((0..p).map(|_| 0.0));
        }
        let mut scales = vec![0.0_f64; p];
        for row in values.chunks_exact(p) {
            scales.iter_mut().zip(row).for_each(|(scale, u)| *scale = scale.max(u.abs()));
        }
        scales.iter_mut().filter(|scale| **scale < LEAST_SCALE).for_each(|scale| *scale = 1.0);
        for row in values.chunks_exact_mut(p) {
            row.iter_mut().zip(&scales).for_each(|(u, scale)| *u /= scale);
        }
        // With u = scale · (x + centre), a slope on x is scale times that on u: its prior has the
        // precision λ / scale².
        let centres = self.centre(&mut values, &left);
        let ridge = scales.iter().map(|scale| self.ridge / scale / scale).collect();
        Ok((Rows { values, scales, centres, ridge }, left))
    }

    /// Adds the moves of a row to those of their origins.
    fn add_row(
        &self,
        row: usize,
        moves: &MoveCounts,
        left: &mut [OriginRows],
    ) -> Result<(), TransitionError> {
        for m in moves.moves() {
            let at = self.legal(m.from, m.to)?;
            if !(m.weight >= 0.0 && m.weight.is_finite()) {
                return Err(TransitionError::Weight { to: m.to, from: m.from, value: m.weight });
            }
            if m.weight == 0.0 {
                continue;
            }
            // Moves are sorted by origin, so those of one origin and row follow each other.
            let column = self.column(m.from);
            let (rows, weights) = &mut left[m.from];
            if rows.last() != Some(&row) {
                rows.push(row);
                weights.resize(rows.len() * column.len(), 0.0);
            }
            let last = weights.len() - column.len();
            weights[last + at - column.start] += m.weight;
        }
        Ok(())
    }

    /// Subtracts the mean over all moves from each input, and returns it.
    fn centre(&self, values: &mut [f64], left: &[OriginRows]) -> Vec<f64> {
        let p = self.inputs;
        let mut of_rows = vec![0.0; values.len() / p];
        for (from, (rows, weights)) in left.iter().enumerate() {
            for (&row, weights) in rows.iter().zip(weights.chunks_exact(self.column(from).len())) {
                of_rows[row] += weights.iter().sum::<f64>();
            }
        }
        let total: f64 = of_rows.iter().sum();
        let mut centres = vec![0.0; p];
        if total > 0.0 && total.is_finite() {
            for (row, weight) in values.chunks_exact(p).zip(&of_rows) {
                centres.iter_mut().zip(row).for_each(|(mean, u)| *mean += weight / total * u);
            }
        }
        for row in values.chunks_exact_mut(p) {
            row.iter_mut().zip(&centres).for_each(|(u, mean)| *u -= mean);
        }
        centres
    }

    /// The connected set of each group of slopes, named by one of its groups. Two groups are
    /// connected if moves of both leave some state, directly or through other groups. Groups are
    /// counted from 1; group 0, that of moves without slopes, joins others only if `with_none`.
    pub(super) fn connected_groups(&self, with_none: bool) -> Vec<usize> {
        let groups = self.slopes.len() / self.inputs;
        let mut parents: Vec<usize> = (0..=groups).collect();
        for from in 0..self.states() {
            let groups = self.groups[self.column(from)].iter().map(|group| *group as usize);
            let mut groups = groups.filter(|group| with_none || *group > 0);
            let Some(first) = groups.next() else { continue };
            for group in groups {
                let (first, other) = (root(&mut parents, first), root(&mut parents, group));
                parents[other] = first;
            }
        }
        (0..=groups).map(|group| root(&mut parents, group)).collect()
    }

    /// Divides origins into parts: those that share slopes together, those without slopes one by
    /// one.
    pub(super) fn parts<'a>(&self, rows: &'a Rows, left: Vec<OriginRows>) -> Vec<Component<'a>> {
        let sets = self.connected_groups(false);
        let part = || Component {
            inputs: self.inputs,
            inputs_of_rows: &rows.values,
            ridge: &rows.ridge,
            origins: Vec::new(),
            groups: Vec::new(),
        };
        let mut parts: Vec<Component<'a>> = Vec::new();
        let mut part_of: Vec<Option<usize>> = vec![None; sets.len()];
        // Number of each group within its part.
        let mut local = vec![0; sets.len()];
        for group in 1..sets.len() {
            let at = *part_of[sets[group]].get_or_insert(parts.len());
            if at == parts.len() {
                parts.push(part());
            }
            local[group] = parts[at].groups.len();
            parts[at].groups.push(group - 1);
        }
        for (from, left) in left.into_iter().enumerate() {
            let groups = self.groups[self.column(from)].iter();
            // All groups of an origin are in one set, so any of them names the part.
            let shared = groups.clone().find(|group| **group > 0);
            let known = shared.and_then(|group| part_of[sets[*group as usize]]);
            let at = known.unwrap_or(parts.len());
            if at == parts.len() {
                parts.push(part());
            }
            let group_of: Vec<Option<usize>> =
                groups.map(|group| (*group > 0).then(|| local[*group as usize])).collect();
            parts[at].origins.push(self.seen(from, left, group_of));
        }
        parts
    }

    fn seen(
        &self,
        from: usize,
        (rows, weights): OriginRows,
        group_of: Vec<Option<usize>>,
    ) -> OriginCounts {
        let moves = group_of.len();
        let mut sums = vec![0.0; moves];
        for weights in weights.chunks_exact(moves) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
        }
        // The reference of learning is the move seen most often, whichever is that of the operator:
        // log-odds against a rare move are ill-conditioned. `set` converts back.
        let most = (0..moves).max_by(|a, b| sums[*a].total_cmp(&sums[*b]));
        let mut groups: Vec<usize> = group_of.iter().copied().flatten().collect();
        groups.sort_unstable();
        groups.dedup();
        let (first, reference) = (self.column(from).start, most.unwrap_or(0));
        OriginCounts { first, groups, group_of, reference, rows, weights }
    }
}
