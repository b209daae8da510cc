//! [`ReorderStates`]: parts of a model with their states in another order.

/// A part of a model whose states can be put in another order.
///
/// Learning from different starts may find the same states under different numbers. Sorted by a
/// criterion, such as their means, the states of models can be compared. See
/// [`Hmm::reordered`](crate::Hmm::reordered).
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
///
/// let prior = Prior::AtFirstObservation(Belief::new(vec![0.1, 0.9])?);
/// let transition = DenseTransition::from_rows(&[[0.8, 0.3], [0.2, 0.7]])?;
/// let hmm = Hmm::new(prior, transition, TableLikelihood::from_rows(&[[0.9, 0.1], [0.4, 0.6]])?)?;
/// let other = hmm.reordered(&[1, 0])?;
/// assert_eq!(other.likelihood().probability(0, 1), Some(0.6)); // of the former state 1
/// assert_eq!(other.transition().get(0, 1), 0.2); // from the former state 0 to 1
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait ReorderStates: Sized {
    /// Returns the part with the former state `order[i]` as state i.
    ///
    /// `order` holds each state once, which [`Hmm::reordered`](crate::Hmm::reordered) checks. An
    /// implementation may panic if it does not.
    #[must_use]
    fn reordered(&self, order: &[usize]) -> Self;
}

/// New position of each former state, the inverse permutation of `order`.
#[must_use]
pub fn positions(order: &[usize]) -> Vec<usize> {
    let mut positions = vec![0; order.len()];
    order.iter().enumerate().for_each(|(new, &old)| positions[old] = new);
    positions
}
