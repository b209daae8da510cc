//! Sparse operators from unnormalised weights: columns of counts or scores, divided by their sums.

use super::SparseTransition;
use super::check_count;
use super::compressed::Compressed;
use crate::error::TransitionError;

impl SparseTransition {
    /// Creates an operator from weights (to, from, weight) in any order, such as counts of
    /// drives, frequencies or scores. O(n + weights).
    ///
    /// Weights of the same move are added, and the weights out of each state are divided by their
    /// sum, so that columns sum to one. The scale of a column does not matter, as in
    /// [`Belief::from_weights`](crate::Belief::from_weights). Missing weights are 0.
    ///
    /// ```
    /// use wayfix::SparseTransition;
    ///
    /// // Observed moves: (to, from, count).
    /// let seen = [(1, 0, 1.0), (1, 0, 1.0), (0, 0, 1.0), (1, 0, 1.0), (0, 1, 2.0)];
    /// let a = SparseTransition::from_weights(2, seen)?;
    /// assert_eq!((a.get(1, 0), a.get(0, 0)), (0.75, 0.25));
    /// assert_eq!((a.get(0, 1), a.get(1, 1)), (1.0, 0.0));
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, an index out of range, a weight that is NaN, negative
    /// or infinite, a state with no outgoing weight above 0, or more than 2^31 − 1 states or 2^32
    /// − 1 weights.
    pub fn from_weights(
        states: usize,
        weights: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TransitionError> {
        let (rows, columns) = Self::compressed_weights(states, weights)?;
        Ok(Self::from_compressed(rows, columns))
    }

    /// Normalised entries, by rows and by columns.
    pub(crate) fn compressed_weights(
        states: usize,
        weights: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<(Compressed, Compressed), TransitionError> {
        let wrong = |(to, from, value)| TransitionError::Weight { to, from, value };
        let given = Self::above_zero(states, weights, wrong)?;
        check_count("weights", given.len())?;
        // Transposing twice sorts the entries, so that weights of the same move are adjacent.
        let columns = Compressed::new(states, given.into_iter()).transposed().transposed();
        let mut moves: Vec<(usize, usize, f64)> = Vec::with_capacity(columns.entries());
        for from in 0..states {
            // Divided by the maximum first, so that no sum overflows.
            let largest = columns.line(from).map(|weight| weight.1).fold(0.0, f64::max);
            if largest == 0.0 {
                return Err(TransitionError::NoWeight { column: from });
            }
            let start = moves.len();
            for (to, weight) in columns.line(from) {
                let weight = weight / largest;
                match moves[start..].last_mut() {
                    Some(last) if last.0 == to => last.2 += weight,
                    _ => moves.push((to, from, weight)),
                }
            }
            let sum: f64 = moves[start..].iter().map(|weight| weight.2).sum();
            moves[start..].iter_mut().for_each(|weight| weight.2 /= sum);
        }
        Self::compressed(states, moves)
    }
}
