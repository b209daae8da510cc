//! Operators and tables from faer matrices, and back.

use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, mat};
use wayfix::{DenseTransition, SparseTransition, TableLikelihood, TransitionError};

fn matrix() -> Mat<f64> {
    mat![[0.7, 0.0, 0.2], [0.3, 1.0, 0.3], [0.0, 0.0, 0.5]]
}

#[test]
fn dense_and_sparse_operators_take_faer_views() {
    let a = matrix();
    let dense = DenseTransition::from_faer(a.as_ref()).unwrap();
    let sparse = SparseTransition::from_faer(a.as_ref()).unwrap();
    let entries = [(0, 0, 0.7), (1, 0, 0.3), (1, 1, 1.0), (0, 2, 0.2), (1, 2, 0.3), (2, 2, 0.5)];
    let triplets = entries.map(|(row, col, val)| Triplet { row, col, val });
    let columns = SparseColMat::<usize, f64>::try_new_from_triplets(3, 3, &triplets).unwrap();
    let from_sparse = SparseTransition::from_faer_sparse(columns.as_ref()).unwrap();
    assert_eq!(sparse.entries(), 6);
    for i in 0..3 {
        for j in 0..3 {
            assert_eq!(dense.get(i, j), a[(i, j)]);
            assert_eq!(sparse.get(i, j), a[(i, j)]);
            assert_eq!(from_sparse.get(i, j), a[(i, j)]);
            assert_eq!(dense.as_faer()[(i, j)], a[(i, j)]);
        }
    }
    // A transposed view has different strides, and is a different matrix.
    let error = DenseTransition::from_faer(a.transpose()).unwrap_err();
    assert!(matches!(error, TransitionError::RowsSumToOne { column: 0, .. }));
}

#[test]
fn matrices_that_are_not_square_are_refused() {
    let wide = Mat::<f64>::zeros(2, 3);
    let text = "the transition matrix has 2 rows and 3 columns, expected a square one";
    assert_eq!(DenseTransition::from_faer(wide.as_ref()).unwrap_err().to_string(), text);
    assert_eq!(SparseTransition::from_faer(wide.as_ref()).unwrap_err().to_string(), text);
}

#[test]
fn tables_take_faer_views() {
    let table = TableLikelihood::from_faer(mat![[0.9, 0.1], [0.2, 0.8]].as_ref()).unwrap();
    assert_eq!(table.probability(0, 1), Some(0.1));
    assert_eq!(table.probability(1, 0), Some(0.2));
}
