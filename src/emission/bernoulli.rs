//! Vectors of events.

use super::error::EmissionError;
use super::independent::{Independent, shape};
use super::univariate;

/// Events that happen or not: d independent Bernoulli distributions in each state.
///
/// p(y) = Π_c p_c^{y_c} (1 − p_c)^{1 − y_c}, where each y_c is 0 or 1. Learning sets each
/// probability to the weighted share of ones.
///
/// The pseudo-count of the [sensor](crate::inference::LearningOptions::likelihood_pseudo_count) is
/// added to the counts of 0 and of 1, as in a [table](crate::TableLikelihood): probabilities of 0
/// and 1 stay as they are. The [prior](Independent::with_prior) of c observations with probability q
/// is the beta density of p with parameters c q + 1 and c (1 − q) + 1.
///
/// ```
/// use wayfix::emission::Bernoulli;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     // Wipers and lights, on a dry day and in the rain.
///     Bernoulli::new(&[[0.01, 0.2], [0.9, 0.7]])?,
/// )?;
/// assert_eq!(hmm.viterbi(&[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]])?.states(), [0, 0, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Bernoulli = Independent<univariate::Bernoulli>;

impl Bernoulli {
    /// Creates a family from one row for each state, with the probability that each component
    /// is 1.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// probability that is not from 0 to 1.
    pub fn new<R: AsRef<[f64]>>(probabilities: &[R]) -> Result<Self, EmissionError> {
        let part =
            |state: usize, c: usize| univariate::Bernoulli::new(probabilities[state].as_ref()[c]);
        Self::build(shape("list of probabilities", probabilities)?, part)
    }

    /// Returns one row for each state, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn probabilities(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::Bernoulli::probability)
    }
}
