//! Vectors of counts.

use super::error::EmissionError;
use super::independent::{Independent, shape};
use super::univariate;

/// Counts of events: d independent Poisson distributions in each state.
///
/// p(y) = Π_c λ_c^{y_c} exp(−λ_c) / y_c!, of whole numbers y_c from 0 to 2^53. A rate of 0 is a
/// component that is always 0. Learning sets each rate to the weighted mean of the counts.
///
/// The [prior](Independent::with_prior) of c observations with mean m is the gamma density of λ
/// with shape c m + 1 and rate c (Gelman et al., *Bayesian Data Analysis*, 2013).
///
/// ```
/// use wayfix::emission::{Poisson, Rows};
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Poisson::new(&[[3.0], [10.0]])?, // one rate for each state and component
/// )?;
/// let events = [2.0, 4.0, 3.0, 11.0, 9.0, 12.0];
/// let path = hmm.viterbi(&Rows::new(&events, 1)?)?;
/// assert_eq!(path.states(), [0, 0, 0, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Poisson = Independent<univariate::Poisson>;

impl Poisson {
    /// Creates a family from one row for each state, with the rate λ of each component.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// rate that is not from 0 to 2^53.
    pub fn new<R: AsRef<[f64]>>(rates: &[R]) -> Result<Self, EmissionError> {
        let rate = |state: usize, c: usize| univariate::Poisson::new(rates[state].as_ref()[c]);
        Self::build(shape("list of rates", rates)?, rate)
    }

    /// Returns one row for each state, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn rates(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::Poisson::rate)
    }
}
