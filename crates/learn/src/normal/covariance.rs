//! Types of covariances, and the layout of their entries.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::triangular_inverse;
use faer::{Mat, Par};

use super::prior::SYMMETRY;
use crate::EmissionError;
use crate::error::flatten;

/// Form of the covariances of a Gaussian family.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CovarianceType {
    /// One variance for all components, for each state.
    Spherical,
    /// One variance for each component and state.
    Diagonal,
    /// A symmetric matrix for each state.
    Full,
    /// One symmetric matrix shared by all states; in a mixture, by all parts of a state.
    Tied,
}

impl CovarianceType {
    /// Number of stored values of a covariance in d dimensions.
    pub(crate) fn values(self, d: usize) -> usize {
        match self {
            Self::Spherical => 1,
            Self::Diagonal => d,
            Self::Full | Self::Tied => d * d,
        }
    }

    /// Number of free parameters of a covariance in d dimensions.
    pub(crate) fn free(self, d: usize) -> usize {
        match self {
            Self::Full | Self::Tied => d * (d + 1) / 2,
            other => other.values(d),
        }
    }

    pub(super) fn shape(self) -> Shape {
        match self {
            Self::Spherical | Self::Diagonal => Shape::Diagonal,
            Self::Full | Self::Tied => Shape::Triangular,
        }
    }

    /// Name of a covariance's value in error messages.
    pub(super) fn name(self) -> &'static str {
        if self.shape() == Shape::Diagonal { "variance" } else { "covariance" }
    }
}

/// Entries of a matrix that are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Diagonal,
    Triangular,
}

impl Shape {
    /// Number of entries in d dimensions.
    #[inline(always)]
    pub(crate) fn entries(self, d: usize) -> usize {
        match self {
            Self::Diagonal => d,
            Self::Triangular => d * (d + 1) / 2,
        }
    }

    /// Position of an entry; for a diagonal shape i = j is assumed.
    pub(crate) fn entry(self, i: usize, j: usize) -> usize {
        match self {
            Self::Diagonal => i,
            Self::Triangular => packed(i, j),
        }
    }
}

/// Position of an entry of a symmetric matrix in its lower triangle, packed row after row.
#[inline(always)]
pub(super) fn packed(i: usize, j: usize) -> usize {
    // Rows before this one hold 1 + 2 + … + row entries.
    let (row, column) = if i >= j { (i, j) } else { (j, i) };
    row * (row + 1) / 2 + column
}

// Checks of covariances: finite, symmetric and, if diagonal, positive. Definiteness is left to the
// Cholesky factor.

/// Checks covariances as users give them, and returns them one after the other.
pub(crate) fn flatten_covariances<V: AsRef<[f64]>>(
    kind: CovarianceType,
    covariances: &[V],
    d: usize,
) -> Result<Vec<f64>, EmissionError> {
    let flat = flatten("covariance", covariances, kind.values(d))?;
    check_covariances(kind, d, &flat)?;
    Ok(flat)
}

/// Checks covariances in their stored form: one for each density, or one for all that share it.
pub(super) fn check_covariances(
    kind: CovarianceType,
    d: usize,
    covariances: &[f64],
) -> Result<(), EmissionError> {
    let what = kind.name();
    for (at, covariance) in covariances.chunks_exact(kind.values(d)).enumerate() {
        // A covariance tied across all states belongs to none; one tied across the parts of a
        // mixture has its state's number.
        let single = covariances.len() == kind.values(d);
        let state = (kind != CovarianceType::Tied || !single).then_some(at);
        let wrong = |component: usize, value, expected| {
            let component = (kind != CovarianceType::Spherical).then_some(component);
            Err(EmissionError::Parameter { what, state, component, value, expected })
        };
        for (position, &value) in covariance.iter().enumerate() {
            if kind.shape() == Shape::Diagonal {
                if !(value >= f64::MIN_POSITIVE && value.is_finite()) {
                    return wrong(position, value, "a finite value above 2.2e-308");
                }
                continue;
            }
            // Relative to √(Σ_ii Σ_jj), the largest that |Σ_ij| can be.
            let (i, j) = (position / d, position % d);
            let (other, scale) = (covariance[j * d + i], covariance[i * d + i].abs().sqrt());
            if !value.is_finite() {
                return wrong(i, value, "a finite value");
            }
            if (value - other).abs() > SYMMETRY * scale * covariance[j * d + j].abs().sqrt() {
                return wrong(i, value, "a symmetric matrix");
            }
        }
    }
    Ok(())
}

// Cholesky factors and their inverses, by faer.

/// Cholesky factor L of a symmetric matrix given row by row, whose lower triangle alone is read.
///
/// # Errors
///
/// The row at which the matrix is not positive definite to working precision: elimination leaves at
/// most 1e-12 of its diagonal entry, so that only a few digits of a distance would be right.
fn cholesky(d: usize, matrix: &[f64]) -> Result<Mat<f64>, usize> {
    let mut lower = Mat::from_fn(d, d, |i, j| matrix[i * d + j]);
    let scratch = factor::cholesky_in_place_scratch::<f64>(d, Par::Seq, <_>::default());
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    let (none, parameters) = (<_>::default(), <_>::default());
    factor::cholesky_in_place(lower.as_mut(), none, Par::Seq, stack, parameters)
        .map_err(|factor::LltError::NonPositivePivot { index }| index.min(d - 1))?;
    // L_ii² is what elimination leaves of the diagonal entry. faer only rejects pivots of 0 or
    // less.
    let holds = |i: &usize| lower[(*i, *i)].powi(2) > 1e-12 * matrix[i * d + i];
    (0..d).find(|i| !holds(i)).map_or(Ok(lower), Err)
}

/// Lower triangle of W = L⁻¹, packed row after row, for a symmetric matrix L L': then
/// x' (L L')⁻¹ x = ‖W x‖², and ln det = −2 Σ ln W_rr.
///
/// # Errors
///
/// The row at which the matrix is not positive definite to working precision.
pub(crate) fn inverse_factor(d: usize, matrix: &[f64]) -> Result<Vec<f64>, usize> {
    // The inverse is taken once for each set of parameters. A step then multiplies by W, which the
    // lanes do in parallel, instead of solving with L row after row.
    let lower = cholesky(d, matrix)?;
    let mut inverse = Mat::zeros(d, d);
    triangular_inverse::invert_lower_triangular(inverse.as_mut(), lower.as_ref(), Par::Seq);
    Ok((0..d).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|at| inverse[at]).collect())
}

/// True if a symmetric matrix is positive semi-definite to within 1e-9 of its largest diagonal
/// entry.
pub(crate) fn is_semidefinite(d: usize, matrix: &[f64]) -> bool {
    let largest = (0..d).map(|i| matrix[i * d + i]).fold(0.0, f64::max);
    if largest == 0.0 {
        return matrix.iter().all(|value| *value == 0.0);
    }
    // Cholesky needs a definite matrix: 1e-9 on a diagonal of at most 1 makes a semi-definite one
    // pass the test, and a matrix with an eigenvalue below −1e-9 fails it.
    let mut lifted = matrix.iter().map(|value| value / largest).collect::<Vec<f64>>();
    (0..d).for_each(|i| lifted[i * d + i] += 1e-9);
    cholesky(d, &lifted).is_ok()
}
