//! Matrices of faer as sequences.

use faer::{ContiguousFwd, MatRef};

use crate::sequence::Sequence;

/// A d × T matrix of faer as a sequence of its T columns, each an observation of d numbers.
///
/// Borrows the matrix. A T × d matrix with an observation in each row has its values in the
/// wrong order for faer, which stores columns; keep its transpose, or use [`Rows`](super::Rows).
///
/// ```
/// use wayfix::Sequence;
/// use wayfix::emission::Columns;
///
/// let values = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
/// let matrix = faer::MatRef::from_column_major_slice(&values, 2, 3);
/// let columns = Columns::new(matrix).expect("stored by columns");
/// assert_eq!(columns.steps(), 3);
/// assert_eq!(columns.observation(2), [2.0, 20.0]);
/// assert!(Columns::new(matrix.transpose()).is_none());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Columns<'a>(MatRef<'a, f64, usize, usize, ContiguousFwd>);

impl<'a> Columns<'a> {
    /// Takes a matrix, or returns `None` unless the values of each column lie one after another.
    /// O(1).
    #[must_use]
    pub fn new(matrix: MatRef<'a, f64>) -> Option<Self> {
        matrix.try_as_col_major().map(Self)
    }
}

impl Sequence<(), [f64]> for Columns<'_> {
    fn steps(&self) -> usize {
        self.0.ncols()
    }

    fn control(&self, _: usize) -> &() {
        &()
    }

    fn observation(&self, step: usize) -> &[f64] {
        self.0.col(step - 1).as_slice()
    }
}
