//! Matrices of faer as sequences: one observation in each column.

use faer::{ContiguousFwd, MatRef};

use crate::sequence::Sequence;

/// The T columns of a d × T matrix, each an observation of d numbers, without copying them.
/// faer's `try_as_col_major` gives this form of a matrix, unless the values of a column are not
/// contiguous.
///
/// A T × d matrix with an observation in each row has its values in the wrong order, as faer stores
/// columns: keep its transpose, or use [`Rows`](super::Rows).
///
/// ```
/// use wayfix::Sequence;
///
/// let values = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
/// let matrix = faer::MatRef::from_column_major_slice(&values, 2, 3);
/// let columns = matrix.try_as_col_major().expect("stored by columns");
/// assert_eq!(columns.steps(), 3);
/// assert_eq!(columns.observation(2), [2.0, 20.0]);
/// assert!(matrix.transpose().try_as_col_major().is_none());
/// ```
impl Sequence<(), [f64]> for MatRef<'_, f64, usize, usize, ContiguousFwd> {
    fn steps(&self) -> usize {
        self.ncols()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &[f64] {
        self.col(step - 1).as_slice()
    }
}
