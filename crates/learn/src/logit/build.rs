//! Construction from another operator, or from parts.

use std::collections::BTreeMap;

use super::LogitTransition;
use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::internal::{check_count, refuse_evidence, validate_with};
use wayfix::{Transition, TransitionEntries};
use wayfix_kernels::limits;

/// A move as it is stored: from, to, intercept, and the number of its group of slopes, from 1, or 0
/// for none.
pub(super) type Stored = (u32, u32, f64, u32);

impl LogitTransition {
    /// Creates an operator with the moves of another one, and its probabilities at inputs of 0:
    /// slopes are 0. Each legal move but the reference gets p slopes of its own. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no inputs, an operator that is not stochastic or has evidence on
    /// moves, or more than 2^32 − 1 moves.
    pub fn new<A>(moves: &A, inputs: usize) -> Result<Self, TransitionError>
    where
        A: TransitionEntries<Control = ()>,
    {
        validate_with(moves, &())?;
        refuse_evidence(moves, &(), "LogitTransition")?;
        let (mut stored, mut groups) = (Vec::new(), 0);
        for from in 0..moves.states() {
            let reference = reference(from, moves.outgoing(&(), from).map(|entry| entry.0));
            // Intercepts are log-odds against the reference, whose own is 0.
            let at_reference = |entry: &(usize, f64)| Some(entry.0) == reference;
            let base = moves.outgoing(&(), from).find(at_reference).map_or(1.0, |entry| entry.1);
            for (to, p) in moves.outgoing(&(), from) {
                let group = if Some(to) == reference { 0 } else { groups + 1 };
                groups = groups.max(group);
                // A difference of logarithms: a quotient may leave the range of doubles.
                let odds = if group == 0 { 0.0 } else { p.ln() - base.ln() };
                stored.push((from as u32, to as u32, odds, group));
            }
            check_count("moves", stored.len())?;
        }
        let slopes = vec![0.0; groups as usize * inputs];
        Self::from_parts(moves.states(), &stored, slopes, inputs, 0.0)
    }

    /// Creates an operator from moves, column by column, and checks coefficients.
    pub(crate) fn from_parts(
        states: usize,
        moves: &[Stored],
        slopes: Vec<f64>,
        inputs: usize,
        ridge: f64,
    ) -> Result<Self, TransitionError> {
        if inputs == 0 {
            return Err(Parameter::new("the number of inputs", 0.0, "at least 1").into());
        }
        let mut starts = vec![0_u32; states + 1];
        let mut row_starts = starts.clone();
        for &(from, to, ..) in moves {
            starts[from as usize + 1] += 1;
            row_starts[to as usize + 1] += 1;
        }
        // `starts` still holds the lengths of columns, one place late; then sums of them.
        let widest = starts.iter().copied().max().unwrap_or(0) as usize;
        for starts in [&mut starts, &mut row_starts] {
            (1..=states).for_each(|state| starts[state] += starts[state - 1]);
        }
        // Moves come by ascending origin, so that those into each state do, too.
        let (mut rows, mut next) = (vec![(0, 0); moves.len()], row_starts.clone());
        for (at, &(from, to, ..)) in (0..).zip(moves) {
            let slot = &mut next[to as usize];
            rows[*slot as usize] = (from, at);
            *slot += 1;
        }
        let mut a = Self {
            starts,
            to: moves.iter().map(|m| m.1).collect(),
            row_starts,
            rows,
            intercepts: moves.iter().map(|m| m.2).collect(),
            groups: moves.iter().map(|m| m.3).collect(),
            slopes,
            inputs,
            ridge: 0.0,
            largest_intercept: 0.0,
            largest_slopes: Vec::new(),
            widest,
        };
        a.settle()?;
        a.with_ridge(ridge)
    }

    /// Checks coefficients, and computes their bounds.
    pub(super) fn settle(&mut self) -> Result<(), TransitionError> {
        let wrong = |value: &f64| !limits::is_log(*value);
        let expected = "a value from -1e300 to 1e300";
        if let Some(at) = self.intercepts.iter().position(wrong) {
            let what = format!("the intercept of {}", self.name(at));
            return Err(Parameter::new(what, self.intercepts[at], expected).into());
        }
        if let Some(at) = self.slopes.iter().position(wrong) {
            let group = (at / self.inputs + 1) as u32;
            let first = self.groups.iter().position(|other| *other == group);
            let name = first.map_or_else(|| "no move".to_owned(), |first| self.name(first));
            let what = format!("the slope of {name} on input {}", at % self.inputs);
            return Err(Parameter::new(what, self.slopes[at], expected).into());
        }
        let largest = |a: f64, b: &f64| a.max(b.abs());
        self.largest_intercept = self.intercepts.iter().fold(0.0, largest);
        let column = |k: usize| self.slopes.iter().skip(k).step_by(self.inputs);
        let with_slopes = if self.slopes.is_empty() { 0 } else { self.inputs };
        self.largest_slopes = (0..with_slopes).map(|k| column(k).fold(0.0, largest)).collect();
        Ok(())
    }

    /// Shares slopes by labels, `label(from, to)`: moves with the same label have the same slopes,
    /// and those with `None` have none. Each move keeps its own intercept. All slopes become 0.
    /// O(E log E).
    ///
    /// Only differences within a state matter: give one of its moves, such as the stay, no slopes,
    /// unless you want a [ridge](Self::with_ridge) to decide.
    ///
    /// ```
    /// use wayfix_learn::LogitTransition;
    /// use wayfix::SparseTransition;
    ///
    /// // A loop of three places: rain changes how readily a vehicle moves on, in all alike.
    /// let moves = (0..3).flat_map(|j| [(j, j, 0.5), ((j + 1) % 3, j, 0.5)]);
    /// let road = SparseTransition::from_triplets(3, moves)?;
    /// let road = LogitTransition::new(&road, 1)?
    ///     .with_shared_slopes(|from, to| (from != to).then_some(0))
    ///     .with_slopes(0, 1, &[-1.0])?;
    /// assert_eq!(road.slopes(1, 2), Some(&[-1.0][..]));
    /// assert!(road.at(&[1.0])?.get(0, 2) < 0.27);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    #[must_use]
    pub fn with_shared_slopes(
        mut self,
        mut label: impl FnMut(usize, usize) -> Option<usize>,
    ) -> Self {
        let mut known = BTreeMap::new();
        for from in 0..self.states() {
            for at in self.column(from) {
                let next = known.len() as u32 + 1;
                let label = label(from, self.to[at] as usize);
                self.groups[at] = label.map_or(0, |label| *known.entry(label).or_insert(next));
            }
        }
        self.slopes = vec![0.0; known.len() * self.inputs];
        self.largest_slopes = vec![0.0; if known.is_empty() { 0 } else { self.inputs }];
        self
    }
}

/// The stay if it is among the moves out of a state, else the first of them.
pub(super) fn reference(from: usize, mut ways: impl Iterator<Item = usize>) -> Option<usize> {
    let first = ways.next()?;
    Some(if first == from || ways.any(|to| to == from) { from } else { first })
}
