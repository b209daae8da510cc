//! Intercepts and slopes of the moves: setting and reading them. Every change ends in `settle`,
//! which checks all coefficients and computes the bounds on scores anew.

use super::LogitTransition;
use super::build::reference;
use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::{SparseTransition, Transition};

impl LogitTransition {
    /// Name of a move in errors.
    pub(super) fn name(&self, at: usize) -> String {
        // The last column that starts at or before the move.
        let from = self.starts.partition_point(|start| *start as usize <= at) - 1;
        format!("the move from state {from} to state {}", self.to[at])
    }

    /// Number of a move among all moves, column by column.
    pub(super) fn find(&self, from: usize, to: usize) -> Option<usize> {
        if from >= self.states() {
            return None;
        }
        let column = self.column(from);
        let found = self.to[column.clone()].binary_search_by_key(&to, |to| *to as usize);
        found.ok().map(|at| column.start + at)
    }

    pub(super) fn legal(&self, from: usize, to: usize) -> Result<usize, TransitionError> {
        self.find(from, to).ok_or(TransitionError::Forbidden { to, from })
    }

    /// Sets the intercept of a move. O(E p), since the bounds on all coefficients are computed
    /// anew.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that is not legal, or
    /// [`TransitionError::Parameter`] for a value beyond ±1e300.
    pub fn with_intercept(
        mut self,
        from: usize,
        to: usize,
        intercept: f64,
    ) -> Result<Self, TransitionError> {
        let at = self.legal(from, to)?;
        self.intercepts[at] = intercept;
        self.settle()?;
        Ok(self)
    }

    /// Sets the slopes of a move, and of all moves that share them. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Forbidden`] for a move that is not legal, or
    /// [`TransitionError::Parameter`] for a move without slopes, a number of slopes other than that
    /// of inputs, or a value beyond ±1e300.
    pub fn with_slopes(
        mut self,
        from: usize,
        to: usize,
        slopes: &[f64],
    ) -> Result<Self, TransitionError> {
        let at = self.legal(from, to)?;
        let held = self.slopes_at(at).len();
        if slopes.len() != held {
            let what = format!("the number of slopes given for {}", self.name(at));
            let expected =
                if held == 0 { "0, as the move has none" } else { "the number of inputs" };
            return Err(Parameter::new(what, slopes.len() as f64, expected).into());
        }
        if held > 0 {
            let first = (self.groups[at] as usize - 1) * self.inputs;
            self.slopes[first..first + held].copy_from_slice(slopes);
        }
        self.settle()?;
        Ok(self)
    }

    /// Sets the precision λ of a Gaussian prior on the slopes, with mean 0 and variance 1 / λ; 0,
    /// the default, for no prior. Intercepts have no prior. It is part of the objective of
    /// learning.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a value that is NaN, negative or infinite.
    pub fn with_ridge(mut self, precision: f64) -> Result<Self, TransitionError> {
        if !(precision >= 0.0 && precision.is_finite()) {
            let expected = "a finite value of at least 0";
            return Err(Parameter::new("the precision of the ridge", precision, expected).into());
        }
        self.ridge = precision;
        Ok(self)
    }

    /// Number of inputs, p.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Precision of the prior on slopes.
    #[must_use]
    pub fn ridge(&self) -> f64 {
        self.ridge
    }

    /// Legal moves (from, to), column by column.
    pub fn moves(&self) -> impl Iterator<Item = (usize, usize)> {
        let states = 0..self.states();
        states
            .flat_map(|from| self.to[self.column(from)].iter().map(move |to| (from, *to as usize)))
    }

    /// Intercept of a move; `None` if it is not legal.
    #[must_use]
    pub fn intercept(&self, from: usize, to: usize) -> Option<f64> {
        self.find(from, to).map(|at| self.intercepts[at])
    }

    /// Slopes of a move, empty if it has none; `None` if the move is not legal.
    #[must_use]
    pub fn slopes(&self, from: usize, to: usize) -> Option<&[f64]> {
        self.find(from, to).map(|at| self.slopes_at(at))
    }

    /// Index of the slopes of a move, from 0, the same for all moves that share them; `None` if the
    /// move has none, or is not legal.
    #[must_use]
    pub fn slope_group(&self, from: usize, to: usize) -> Option<usize> {
        self.find(from, to).and_then(|at| (self.groups[at] as usize).checked_sub(1))
    }

    /// The reference of a state, the move whose intercept learning keeps: the stay if it is legal,
    /// else the move to the lowest state; `None` for a state that does not exist.
    #[must_use]
    pub fn reference(&self, from: usize) -> Option<usize> {
        let exists = from < self.states();
        exists
            .then(|| self.to[self.column(from)].iter().map(|to| *to as usize))
            .and_then(|ways| reference(from, ways))
    }

    /// Intercepts of all moves, column by column.
    #[cfg(feature = "serde")]
    pub(crate) fn intercepts(&self) -> &[f64] {
        &self.intercepts
    }

    /// Slopes of each group.
    #[cfg(feature = "serde")]
    pub(crate) fn groups(&self) -> impl Iterator<Item = Vec<f64>> {
        self.slopes.chunks_exact(self.inputs).map(<[f64]>::to_vec)
    }

    /// The matrix at inputs u. O(E p).
    ///
    /// # Errors
    ///
    /// [`TransitionError::Control`] for inputs that are not valid.
    pub fn at(&self, inputs: &[f64]) -> Result<SparseTransition, TransitionError> {
        self.check_inputs(inputs)?;
        let columns = (0..self.states()).map(|from| (from, self.list(inputs, from)));
        let entries = columns.flat_map(|(from, column)| column.map(move |(to, p)| (to, from, p)));
        SparseTransition::from_triplets(self.states(), entries)
    }
}
