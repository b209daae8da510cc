//! Distributions of whole sequences, one for each step from 0: α or γ of the
//! [formulas](crate::guide::formulas), in one block of rows.

use std::fmt;

use crate::belief::{Belief, BeliefView};
use crate::inference::engines::lanes::SharedRows;

/// Distributions over n states for the steps k = 0 … T, in one block of
/// n (T + 1) numbers.
///
/// Step 0 is the state before the first transition, X_0. Under
/// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) there is no transition before
/// the first observation, so that X_0 is the same state as X_1.
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
/// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, LikelihoodVector::linear(2))?;
/// let smoothing = hmm.smooth(&[[0.9, 0.2], [0.9, 0.2]])?;
/// let posteriors = smoothing.posteriors();
/// assert_eq!(posteriors.steps(), 2);
/// assert!((posteriors.get(2).unwrap().as_slice()[0] - 0.883_357_041_251_778).abs() < 1e-12);
/// assert_eq!(posteriors.modes(), [0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Posteriors {
    states: usize,
    values: Values,
}

/// Storage of the numbers.
enum Values {
    // Results of many sequences are written to one shared block: copying its parts would take as
    // long as the smoother itself.
    Own { values: Vec<f64>, start: usize },
    Shared(SharedRows),
}

impl Posteriors {
    /// Creates the posteriors from a row for each step from 0.
    pub(crate) fn from_values(states: usize, values: Vec<f64>) -> Self {
        Self { states, values: Values::Own { values, start: 0 } }
    }

    /// Creates the posteriors from a block whose first row is not one of them.
    pub(crate) fn after_a_row(states: usize, values: Vec<f64>) -> Self {
        Self { states, values: Values::Own { values, start: states } }
    }

    /// Creates the posteriors from rows in a shared block.
    pub(crate) fn from_shared(rows: SharedRows) -> Self {
        Self { states: rows.states, values: Values::Shared(rows) }
    }

    /// Number of steps, T.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.as_slice().len() / self.states - 1
    }

    /// Number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states
    }

    /// Returns the distribution of step k, from 0 to T, or `None` beyond.
    #[must_use]
    pub fn get(&self, step: usize) -> Option<BeliefView<'_>> {
        // The step may be any number, so that the product may overflow.
        let start = step.checked_mul(self.states)?;
        let values = self.as_slice().get(start..start.checked_add(self.states)?)?;
        Some(Belief::view(values))
    }

    /// Returns the distributions of the steps with an observation, 1 to T, in order: as many as
    /// there are observations and [modes](Self::modes).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, LikelihoodVector::linear(2))?;
    /// let smoothing = hmm.smooth(&[[0.9, 0.2], [0.9, 0.2]])?;
    /// let posteriors = smoothing.posteriors();
    /// assert_eq!((posteriors.iter().len(), posteriors.with_start().len()), (2, 3));
    /// assert_eq!(posteriors.iter().next(), posteriors.get(1));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.rows(1)
    }

    /// Returns the distributions of steps 0 to T, in order: T + 1 of them, that of X_0 first.
    #[must_use]
    pub fn with_start(
        &self,
    ) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.rows(0)
    }

    fn rows(
        &self,
        first: usize,
    ) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.as_slice()[first * self.states..].chunks_exact(self.states).map(Belief::view)
    }

    /// Returns the most probable state of each step with an observation, 1 to T, so that
    /// `modes()[k - 1]` belongs to `ys[k - 1]`; ties go to the lowest state. O(n T).
    ///
    /// Each is the best estimate for its own step; together they need not form a legal path. For
    /// paths use [`Hmm::viterbi`](crate::Hmm::viterbi).
    #[must_use]
    pub fn modes(&self) -> Vec<usize> {
        self.iter().map(|belief| belief.mode()).collect()
    }

    /// All numbers, step after step: state i of step k at index k n + i.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        match &self.values {
            Values::Own { values, start } => &values[*start..],
            Values::Shared(rows) => rows,
        }
    }

    /// Returns all numbers, in the order of [`as_slice`](Self::as_slice). They are moved, or copied
    /// if results of several sequences share a block.
    #[must_use]
    pub fn into_vec(self) -> Vec<f64> {
        match self.values {
            Values::Own { mut values, start } => {
                values.drain(..start);
                values
            }
            Values::Shared(rows) => rows.to_vec(),
        }
    }
}

impl fmt::Debug for Posteriors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("Posteriors");
        all.field("states", &self.states).field("values", &self.as_slice()).finish()
    }
}

impl Clone for Posteriors {
    /// Copies the numbers into memory of their own.
    fn clone(&self) -> Self {
        Self::from_values(self.states, self.as_slice().to_vec())
    }
}

impl PartialEq for Posteriors {
    fn eq(&self, other: &Self) -> bool {
        self.states == other.states && self.as_slice() == other.as_slice()
    }
}
