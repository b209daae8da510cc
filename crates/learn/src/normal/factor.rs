//! Cholesky factors and their inverses, by faer.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::triangular_inverse;
use faer::{Mat, Par};

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
