//! Expected moves in the form of the M-step: by origin, with inputs scaled to at most 1 and
//! centred, so that their units cost no digits, and in parts that have no slopes in common, each of
//! which is maximised by itself.

use super::newton::{Part, Seen};
use super::{InputCounts, LogitTransition};
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::transition::MoveCounts;

/// Smallest size at which an input is scaled, so that its square is in the range of doubles.
const LEAST_SCALE: f64 = 1e-150;

/// Rows of inputs at which a state was left, and for each row the weights of the state's moves.
type Left = (Vec<usize>, Vec<f64>);

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
    // Halves the path on the way (Tarjan and van Leeuwen 1984), so that later searches are short.
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
    ) -> Result<(Rows, Vec<Left>), TransitionError> {
        let p = self.inputs;
        let mut values = Vec::new();
        let mut left: Vec<Left> = vec![(Vec::new(), Vec::new()); self.states()];
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
        left: &mut [Left],
    ) -> Result<(), TransitionError> {
        for m in moves.moves() {
            let at = self.legal(m.from, m.to)?;
            if !(m.weight >= 0.0 && m.weight.is_finite()) {
                return Err(TransitionError::Weight { to: m.to, from: m.from, value: m.weight });
            }
            if m.weight == 0.0 {
                continue;
            }
            // Moves are sorted by origin, so that those of one origin and row follow each other.
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
    fn centre(&self, values: &mut [f64], left: &[Left]) -> Vec<f64> {
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
    pub(super) fn sets(&self, with_none: bool) -> Vec<usize> {
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
    pub(super) fn parts<'a>(&self, rows: &'a Rows, left: Vec<Left>) -> Vec<Part<'a>> {
        let sets = self.sets(false);
        let part = || Part {
            inputs: self.inputs,
            inputs_of_rows: &rows.values,
            ridge: &rows.ridge,
            origins: Vec::new(),
            groups: Vec::new(),
        };
        let mut parts: Vec<Part<'a>> = Vec::new();
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
            // All groups of an origin are in one set, so that any of them names the part.
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

    fn seen(&self, from: usize, (rows, weights): Left, group_of: Vec<Option<usize>>) -> Seen {
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
        Seen { first, groups, group_of, reference, rows, weights }
    }
}
