//! Vectors of durations or speeds, by mean and spread.

use super::error::EmissionError;
use super::independent::{Independent, check_shape, shape};
use super::univariate;

/// Positive numbers, such as durations and speeds: d independent gamma distributions in each
/// state.
///
/// p(y) = Π_c y_c^{a_c − 1} exp(−y_c / s_c) / (Γ(a_c) s_c^{a_c}), of finite y_c above 0, with shapes a_c and
/// scales s_c: the mean is a s, the variance a s².
///
/// Learning finds the shape that solves ln a − ψ(a) = ln ȳ − mean of ln y, by Newton's method in ln a
/// to the last digits, with the start of Minka (*Estimating a Gamma distribution*, 2002), and the
/// scale ȳ / a; both are exact also for a large shape. Observations that are all alike determine
/// no shape, an [error](EmissionError::TooFew), unless there is a prior: that of c
/// [observations](Independent::with_prior) with shape b and scale t has the density of a and s
/// proportional to exp(c ((a − 1) (ψ(b) + ln t) − b t / s − ln Γ(a) − a ln s)), which is conjugate (Miller, 1980).
///
/// ```
/// use wayfix::emission::Gamma;
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Gamma::new(&[[2.0], [2.0]], &[[1.0], [10.0]])?, // shapes, then scales
/// )?;
/// let waits = [[1.2], [2.7], [1.9], [30.0], [24.0], [41.0], [2.2], [1.4]];
/// let learned = hmm.learn(&[waits], &LearningOptions::default())?;
/// let (shapes, scales) = (learned.model().likelihood().shapes(), learned.model().likelihood().scales());
/// assert!((shapes[1][0] * scales[1][0] - 95.0 / 3.0).abs() < 1e-3); // the mean of the long ones
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Gamma = Independent<univariate::Gamma>;

impl Gamma {
    /// Creates a family from one row for each state, with the shape of each component, and
    /// one with the scales.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// shape, scale or product of them that is not finite and above 0.
    pub fn new<R, S>(shapes: &[R], scales: &[S]) -> Result<Self, EmissionError>
    where
        R: AsRef<[f64]>,
        S: AsRef<[f64]>,
    {
        let shape = shape("list of shapes", shapes)?;
        check_shape("list of scales", scales, shape)?;
        Self::build(shape, |state, c| {
            univariate::Gamma::new(shapes[state].as_ref()[c], scales[state].as_ref()[c])
        })
    }

    /// Returns one row for each state with the shapes, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn shapes(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::Gamma::shape)
    }

    /// Returns one row for each state with the scales.
    #[must_use]
    pub fn scales(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::Gamma::scale)
    }
}
