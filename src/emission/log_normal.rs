//! Vectors of durations or speeds, by their logarithms.

use super::error::EmissionError;
use super::independent::{Independent, check_shape, shape};
use super::univariate;

/// Positive numbers whose logarithms are Gaussian, such as durations and speeds: d independent
/// log-normal distributions in each state.
///
/// p(y) = Π_c exp(−(ln y_c − μ_c)² / 2σ_c²) / (y_c σ_c √2π), of finite y_c above 0. The median is exp(μ),
/// the mean exp(μ + σ² / 2).
///
/// Learning sets μ and σ² to the weighted mean and variance of the logarithms. Observations that are
/// all alike determine no variance, an [error](EmissionError::TooFew), unless there is a prior:
/// that of c [observations](Independent::with_prior) with parameters m and r has the density of μ and σ
/// proportional to σ^−c exp(−c ((μ − m)² + r²) / 2σ²), which is normal-inverse-gamma.
///
/// ```
/// use wayfix::emission::LogNormal;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let walk_or_ride: [f64; 2] = [1.4, 5.0]; // m/s
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
///     LogNormal::new(&walk_or_ride.map(|speed| [speed.ln()]), &[[0.2], [0.5]])?,
/// )?;
/// assert_eq!(hmm.viterbi(&[[1.3], [1.6], [1.2], [4.0], [6.0]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type LogNormal = Independent<univariate::LogNormal>;

impl LogNormal {
    /// Creates a family from one row for each state, with the mean μ of the logarithm of each
    /// component, and one with the standard deviations σ.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, a
    /// mean that is not from -745 to 710, or a deviation that is not finite and above 0.
    pub fn new<R, S>(means: &[R], deviations: &[S]) -> Result<Self, EmissionError>
    where
        R: AsRef<[f64]>,
        S: AsRef<[f64]>,
    {
        let shape = shape("list of means", means)?;
        check_shape("list of deviations", deviations, shape)?;
        Self::build(shape, |state, c| {
            univariate::LogNormal::new(means[state].as_ref()[c], deviations[state].as_ref()[c])
        })
    }

    /// Returns one row for each state with the means of logarithms, as [`new`](Self::new) takes
    /// them.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::LogNormal::mean)
    }

    /// Returns one row for each state with the standard deviations of logarithms.
    #[must_use]
    pub fn deviations(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::LogNormal::deviation)
    }
}
