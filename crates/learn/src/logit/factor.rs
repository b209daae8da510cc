//! Cholesky factors of information matrices, which may be singular.
//!
//! A parameter that the others determine (an input that is a sum of others, a label on all moves
//! out of a state) has a pivot of 0, up to rounding. It is left out: its component of a solution is
//! 0, and the others solve the system without it. (The crate's matrix library is optional, while
//! this operator is not, and does not leave out parameters.)

/// A pivot that is this small a part of its diagonal entry has hardly a digit left: it is 0 up to
/// rounding.
const LEAST_PIVOT: f64 = 1e-12;

/// Lower triangle L of a symmetric matrix M = L L', row after row; a row of M that is left out has
/// a diagonal of 0 in L.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    size: usize,
    lower: Vec<f64>,
}

impl Factor {
    /// Factors a positive semi-definite matrix; only its lower triangle is read. Pivots are
    /// compared with `diagonal`. O(size³).
    pub(super) fn new(mut lower: Vec<f64>, diagonal: &[f64]) -> Self {
        let size = diagonal.len();
        for i in 0..size {
            let (above, row) = lower.split_at_mut(i * size);
            for j in 0..i {
                let other = &above[j * size..=j * size + j];
                let dot: f64 = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
                row[j] = if other[j] > 0.0 { (row[j] - dot) / other[j] } else { 0.0 };
            }
            let squares: f64 = row[..i].iter().map(|value| value * value).sum();
            let pivot = row[i] - squares;
            // A NaN fails the comparison, and is left out, too.
            row[i] = if pivot > LEAST_PIVOT * diagonal[i] { pivot.sqrt() } else { 0.0 };
        }
        Self { size, lower }
    }

    /// Replaces b by L⁻¹ b. O(size²).
    pub(super) fn forward(&self, b: &mut [f64]) {
        for i in 0..self.size {
            let row = &self.lower[i * self.size..=i * self.size + i];
            let dot: f64 = row[..i].iter().zip(&b[..i]).map(|(l, b)| l * b).sum();
            b[i] = if row[i] > 0.0 { (b[i] - dot) / row[i] } else { 0.0 };
        }
    }

    /// Replaces b by L'⁻¹ b. O(size²).
    pub(super) fn backward(&self, b: &mut [f64]) {
        for i in (0..self.size).rev() {
            let column = (i + 1..self.size).map(|k| self.lower[k * self.size + i] * b[k]);
            let dot: f64 = column.sum();
            let pivot = self.lower[i * self.size + i];
            b[i] = if pivot > 0.0 { (b[i] - dot) / pivot } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_leave_out_what_is_determined() {
        // The third row is the sum of the first two.
        let m = [[4.0, 1.0, 5.0], [1.0, 3.0, 4.0], [5.0, 4.0, 9.0]];
        let factor = Factor::new(m.concat(), &[4.0, 3.0, 9.0]);
        let mut x = vec![6.0, 7.0, 13.0];
        factor.forward(&mut x);
        factor.backward(&mut x);
        assert_eq!(x[2], 0.0);
        for (row, b) in m.iter().zip([6.0, 7.0, 13.0]) {
            let product: f64 = row.iter().zip(&x).map(|(m, x)| m * x).sum();
            assert!((product - b).abs() < 1e-14, "{x:?}");
        }
    }
}
