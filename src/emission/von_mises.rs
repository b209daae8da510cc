//! Vectors of angles.

use super::error::EmissionError;
use super::independent::{Independent, check_shape, shape};
use super::univariate;

/// Angles, such as headings: d independent von Mises distributions in each state.
///
/// p(y) = Π_c exp(κ_c cos(y_c − μ_c)) / (2π I₀(κ_c)), of finite y_c in radians, with mean directions μ_c and
/// concentrations κ_c ≥ 0, of any size: from all directions alike to a variance of 1 / κ.
///
/// Learning sets μ to the direction of the mean vector, and κ to the solution of I₁(κ) / I₀(κ) = its
/// length, by Newton's method to the last digits (Mardia and Jupp, *Directional Statistics*, 2000).
/// Observations that are all alike determine no concentration, an
/// [error](EmissionError::TooFew), unless there is a prior: that of c
/// [observations](Independent::with_prior) with parameters m and k has the density of μ and κ
/// proportional to exp(c κ cos(μ − m) I₁(k) / I₀(k)) I₀(κ)^−c, which is conjugate (Guttorp and
/// Lockhart, 1988).
///
/// ```
/// use wayfix::emission::VonMises;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     VonMises::new(&[[3.1], [0.0]], &[[10.0], [10.0]])?, // south and north
/// )?;
/// // Angles just below π and just above −π are neighbours.
/// assert_eq!(hmm.viterbi(&[[3.0], [-3.0], [3.1], [0.2], [-0.1]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type VonMises = Independent<univariate::VonMises>;

impl VonMises {
    /// Creates a family from one row for each state, with the mean direction of each component
    /// in radians, and one with the concentrations.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, a
    /// mean that is not finite, or a concentration that is not from 0 to 1e300.
    pub fn new<R, S>(means: &[R], concentrations: &[S]) -> Result<Self, EmissionError>
    where
        R: AsRef<[f64]>,
        S: AsRef<[f64]>,
    {
        let shape = shape("list of means", means)?;
        check_shape("list of concentrations", concentrations, shape)?;
        Self::build(shape, |state, c| {
            univariate::VonMises::new(means[state].as_ref()[c], concentrations[state].as_ref()[c])
        })
    }

    /// Returns one row for each state with the mean directions, as [`new`](Self::new) takes them;
    /// learned ones are from −π to π.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::VonMises::mean)
    }

    /// Returns one row for each state with the concentrations.
    #[must_use]
    pub fn concentrations(&self) -> Vec<Vec<f64>> {
        self.rows(univariate::VonMises::concentration)
    }
}
