//! The M-step: coefficients that make the expected moves most probable (section 9 of the
//! [formulas](wayfix::guide::formulas)). Here coefficients are converted between the operator, whose
//! inputs have units, and the search in `newton.rs`, whose inputs are scaled and centred.

use std::error::Error;

use super::data::Rows;
use super::newton::{self, Part, Point};
use super::{InputCounts, LogitTransition};
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::transition::{LearnTransition, MoveCounts};

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
            for (origin, at) in newton::running(&part, &self.point(&part, &rows)) {
                let at = part.origins[origin].first + at;
                let from = self.starts.partition_point(|start| *start as usize <= at) - 1;
                found.push((from, self.to[at] as usize));
            }
        }
        found.sort_unstable();
        Ok(found)
    }

    /// Coefficients of a part, for scaled and centred inputs.
    fn point(&self, part: &Part<'_>, rows: &Rows) -> Point {
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
    fn set(&mut self, part: &Part<'_>, point: &Point, rows: &Rows) {
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
        learned.settle()?;
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
        let sets = self.sets(true);
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
        let sets = self.sets(true);
        // The first group of each set stays: group 0, of moves without slopes, if it is in it.
        let first = |group: usize| sets.iter().position(|set| *set == sets[group]);
        for group in 1..sets.len() {
            if self.ridge > 0.0 || first(group) != Some(group) {
                let own = (group - 1) * self.inputs..group * self.inputs;
                moved.slopes[own].iter_mut().for_each(|slope| *slope = by.real(*slope));
            }
        }
        moved.settle()?;
        Ok(moved)
    }
}
