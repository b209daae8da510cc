//! Free parameters of the parts of a model, as unbounded coordinates around their present values.
//!
//! A part implements one function, which passes each free parameter through a [`Displacement`] and
//! builds the part from the results; a displacement by nothing counts them. Coordinates are 0 at
//! the part itself, so that an infinitesimal step means the same for each kind of parameter,
//! whatever its unit.

use std::error::Error;

use crate::fixed::Fixed;

/// A part of a model (an operator, a sensor) whose free parameters, those that
/// [learning](crate::Hmm::learn) changes, can be moved: for the standard errors of
/// [wayfix-learn](https://docs.rs/wayfix-learn).
///
/// All operators and sensors that learn implement it; [`Fixed`](crate::Fixed) has no free
/// parameters.
///
/// # Implement it yourself
///
/// Each free parameter is passed through the [`Displacement`], always in the same order:
///
/// ```
/// use std::error::Error;
/// use wayfix::inference::{Displacement, FreeParameters};
///
/// struct Readings {
///     mean: f64,
///     variance: f64,
///     outliers: f64, // their share
/// }
///
/// impl FreeParameters for Readings {
///     fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
///         let (mean, variance) = (by.real(self.mean), by.positive(self.variance));
///         Ok(Self { mean, variance, outliers: by.probability(self.outliers) })
///     }
/// }
///
/// let readings = Readings { mean: -3.0, variance: 4.0, outliers: 0.25 };
/// let moved = readings.displaced(&mut Displacement::new(&[0.5, 2.0_f64.ln(), 3.0_f64.ln()]))?;
/// assert_eq!(moved.mean, -2.5);
/// assert!((moved.variance - 8.0).abs() < 1e-14);
/// assert!((moved.outliers - 0.5).abs() < 1e-15); // three times the odds of 1 to 3
/// # Ok::<(), Box<dyn Error + Send + Sync>>(())
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say which of its parameters are free",
    note = "to take it as known, wrap it in `wayfix::Fixed`"
)]
pub trait FreeParameters: Sized {
    /// Returns the part with each free parameter moved; with a displacement of 0, the part itself
    /// up to rounding. Parameters at a bound, such as probabilities of 0, stay.
    ///
    /// # Errors
    ///
    /// Any error, if the part would not be valid, for instance if a number overflows.
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>>;
}

impl<T: Clone> FreeParameters for Fixed<T> {
    fn displaced(&self, _: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(self.clone())
    }
}

/// A step in the free parameters of a model, one number for each, in coordinates that have no
/// bounds and are 0 at the model itself:
///
/// | method | of | coordinates δ |
/// |---|---|---|
/// | [`real`](Self::real) | any number | x + δ |
/// | [`logarithm`](Self::logarithm) | a logarithm, or log-odds | x + δ |
/// | [`positive`](Self::positive) | a number above 0 | x e^δ |
/// | [`probability`](Self::probability) | a number between 0 and 1 | log-odds of the smaller one of it and its complement |
/// | [`distribution`](Self::distribution) | numbers with a fixed sum | log-odds against the largest |
/// | [`covariance`](Self::covariance) | a symmetric, positive definite matrix L L' | L M M' L', with the lower triangle M = I + δ, of a diagonal e^δ |
/// | [`direction`](Self::direction) | a vector of length 1 | an arc along the sphere |
///
/// Numbers at a bound (a positive number or a probability of 0, a probability of 1) stay, have no
/// coordinate, and are [counted](Self::at_bound).
///
/// It is passed to [`FreeParameters::displaced`], which takes the parameters in turn.
#[derive(Debug, Clone)]
pub struct Displacement<'d> {
    by: &'d [f64],
    at: usize,
    at_bound: usize,
    /// Parameters seen so far, if the displacement is by nothing.
    recorded: Vec<(f64, ParameterScale)>,
}

/// Scale of a coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterScale {
    /// An unbounded number.
    Plain,
    /// A logarithm, or the logarithm of a number whose bound, 0, is at minus infinity.
    Log,
    /// Log-odds against a number that is at least as large.
    Odds,
}

impl<'d> Displacement<'d> {
    /// Creates a displacement by these numbers, in the order of the parameters, and by 0 for all
    /// parameters after them.
    #[must_use]
    pub fn new(by: &'d [f64]) -> Self {
        Self { by, at: 0, at_bound: 0, recorded: Vec::new() }
    }

    /// Number of free parameters seen so far.
    #[must_use]
    pub fn count(&self) -> usize {
        self.at
    }

    /// Number of parameters seen so far that are at a bound.
    #[must_use]
    pub fn at_bound(&self) -> usize {
        self.at_bound
    }

    /// Parameters seen, if the displacement is by nothing.
    #[must_use]
    pub fn into_seen(self) -> Vec<(f64, ParameterScale)> {
        self.recorded
    }

    /// Returns the displacement of the next free parameter.
    fn next(&mut self, value: f64, scale: ParameterScale) -> f64 {
        let by = self.by.get(self.at).copied().unwrap_or(0.0);
        self.at += 1;
        if self.by.is_empty() {
            self.recorded.push((value, scale));
        }
        by
    }

    /// Moves a number that may have any value.
    pub fn real(&mut self, x: f64) -> f64 {
        x + self.next(x, ParameterScale::Plain)
    }

    /// Moves a logarithm, or log-odds.
    pub fn logarithm(&mut self, x: f64) -> f64 {
        x + self.next(x, ParameterScale::Log)
    }

    /// Moves a number above 0; 0 stays.
    pub fn positive(&mut self, x: f64) -> f64 {
        if x > 0.0 {
            return x * self.next(x, ParameterScale::Log).exp();
        }
        self.at_bound += 1;
        x
    }

    /// Moves a number between 0 and 1; 0 and 1 stay.
    pub fn probability(&mut self, p: f64) -> f64 {
        let mut both = [p, 1.0 - p];
        self.distribution(&mut both);
        both[0]
    }

    /// Moves numbers that keep their sum, such as a distribution. Those of 0 stay, each counted as
    /// at a bound. Each of the others except the largest has a coordinate, its log-odds against the
    /// largest.
    pub fn distribution(&mut self, shares: &mut [f64]) {
        // The reference is the first of the largest. Against it, all log-odds are at most 0, and
        // none is extreme only because the reference is rare.
        let ahead = |best: usize, at: usize| if shares[at] > shares[best] { at } else { best };
        let largest = (0..shares.len()).fold(0, ahead);
        let mut by = vec![0.0; shares.len()];
        for (at, (by, share)) in by.iter_mut().zip(shares.iter()).enumerate() {
            if *share == 0.0 {
                self.at_bound += 1;
            } else if at != largest {
                *by = self.next(*share, ParameterScale::Odds);
            }
        }
        // The shares stay as they are, to the bit.
        if by.iter().all(|by| *by == 0.0) {
            return;
        }
        // No factor is above 1, so none overflows.
        let most = by.iter().copied().fold(0.0, f64::max);
        let before: f64 = shares.iter().sum();
        shares.iter_mut().zip(&by).for_each(|(share, by)| *share *= (by - most).exp());
        let scale = before / shares.iter().sum::<f64>();
        shares.iter_mut().for_each(|share| *share *= scale);
    }

    /// Moves a symmetric, positive definite matrix of d × d numbers, row after row. A matrix that
    /// is not positive definite becomes NaN.
    pub fn covariance(&mut self, matrix: &mut [f64], d: usize) {
        let mut lower = matrix.to_vec();
        let factored = cholesky(d, &mut lower, 0.0);
        // The factor of the moved matrix is L M, with L of this matrix and M of the displacements.
        // It is lower triangular, as both are. It is summed column by column: entry (i, j) of M
        // adds column i of L to column j.
        let mut moved = vec![0.0; d * d];
        let mut any = false;
        for i in 0..d {
            for j in 0..=i {
                let value = matrix[i * d + j];
                let by = self
                    .next(value, if i == j { ParameterScale::Log } else { ParameterScale::Plain });
                any |= by != 0.0;
                let factor = if i == j { by.exp() } else { by };
                for row in i..d {
                    moved[row * d + j] += lower[row * d + i] * factor;
                }
            }
        }
        if factored.is_err() {
            matrix.fill(f64::NAN);
        } else if any {
            for i in 0..d {
                for j in 0..=i {
                    let (a, b) = (&moved[i * d..][..=j], &moved[j * d..][..=j]);
                    let entry = a.iter().zip(b).map(|(a, b)| a * b).sum();
                    (matrix[i * d + j], matrix[j * d + i]) = (entry, entry);
                }
            }
        }
    }

    /// Moves a vector of length 1 along the sphere, with a coordinate for each component except the
    /// one of the largest magnitude.
    pub fn direction(&mut self, vector: &mut [f64]) {
        let ahead =
            |best: usize, at: usize| if vector[at].abs() > vector[best].abs() { at } else { best };
        let largest = (0..vector.len()).fold(0, ahead);
        let mut by: Vec<f64> = Vec::with_capacity(vector.len());
        for (at, x) in vector.iter().enumerate() {
            by.push(if at == largest { 0.0 } else { self.next(*x, ParameterScale::Plain) });
        }
        let arc = by.iter().map(|by| by * by).sum::<f64>().sqrt();
        if arc == 0.0 {
            return;
        }
        // A Householder reflection that takes the axis e of the largest component to −s times the
        // vector, where s is the sign of that component, so that nothing cancels: I − w w' / w_e
        // with w = e + s vector. It takes the other axes to an orthonormal basis of the tangents.
        let sign = vector[largest].signum();
        let mut w: Vec<f64> = vector.iter().map(|x| sign * x).collect();
        w[largest] += 1.0;
        let dot = by.iter().zip(&w).map(|(by, w)| by * w).sum::<f64>() / w[largest];
        let tangents = by.iter().zip(&w).map(|(by, w)| by - w * dot);
        let (sin, cos) = arc.sin_cos();
        vector.iter_mut().zip(tangents).for_each(|(x, t)| *x = *x * cos + t * (sin / arc));
    }
}

/// Replaces a symmetric matrix by its Cholesky factor L, with zeros above the diagonal. Only the
/// lower triangle is read.
///
/// # Errors
///
/// The first row whose pivot is at most `least` times its diagonal entry, or not above 0.
pub fn cholesky(size: usize, matrix: &mut [f64], least: f64) -> Result<(), usize> {
    for i in 0..size {
        let (above, row) = matrix.split_at_mut(i * size);
        for j in 0..i {
            let other = &above[j * size..][..=j];
            let dot: f64 = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
            row[j] = (row[j] - dot) / other[j];
        }
        let pivot = row[i] - row[..i].iter().map(|value| value * value).sum::<f64>();
        // Written as a negation, so that a NaN is refused.
        if !(pivot > least * row[i] && pivot > 0.0) {
            return Err(i);
        }
        row[i] = pivot.sqrt();
        row[i + 1..size].fill(0.0);
    }
    Ok(())
}
