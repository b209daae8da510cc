//! Parts of a model from arrays, and back to arrays.
//!
//! Python's moves have a row for the state that is left; the library's operators have a column for
//! it. Every function here that reads or writes moves transposes.

use std::sync::Arc;

use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use wayfix::{
    DenseTransition, Hmm, Likelihood, Prior, SparseTransition, TableLikelihood, Transition,
};

use crate::array::{self, contiguous, matrix};
use crate::error::{invalid, of_moves};
use crate::typed::index;

/// Operator of a model, in the form its moves were given in.
pub(crate) enum Operator {
    Dense(DenseTransition),
    Sparse(Box<SparseTransition>),
}

/// Creates a model that filters share.
pub(crate) fn join<A, B>(prior: Prior, operator: A, sensor: B) -> PyResult<Arc<Hmm<A, B>>>
where
    A: Transition,
    B: Likelihood,
{
    Ok(Arc::new(Hmm::new(prior, operator, sensor).map_err(invalid)?))
}

/// Reads a table with a row for each state.
pub(crate) fn table_of(values: &Bound<'_, PyAny>) -> PyResult<TableLikelihood> {
    let table = array::rows(values, "rows of the table")?;
    let width = table.shape()[1];
    // A table without symbols has no rows here, and is refused by the library.
    let rows: Vec<&[f64]> = matrix(&table, width, "table")?.chunks_exact(width.max(1)).collect();
    TableLikelihood::from_rows(&rows).map_err(invalid)
}

/// Reads moves in any of their forms: a matrix of scipy, three arrays, or a dense array.
pub(crate) fn operator(moves: &Bound<'_, PyAny>, n: usize) -> PyResult<Operator> {
    // All of scipy's sparse classes have this method.
    if moves.hasattr("tocoo")? {
        let shape: (usize, usize) = moves.getattr("shape")?.extract()?;
        if shape != (n, n) {
            return Err(invalid(format!("moves have shape {shape:?}, expected ({n}, {n})")));
        }
        // A copy, since `sum_duplicates` works in place. Scipy's matrices add up entries of one
        // place by definition, while the library refuses them.
        let entries = moves.call_method1("tocoo", (true,))?;
        entries.call_method0("sum_duplicates")?;
        let part = |name: &str| entries.getattr(name);
        return sparse(&part("row")?, &part("col")?, &part("data")?, n);
    }
    if let Ok(parts) = moves.cast::<PyTuple>() {
        let (from, to, values): (Bound<'_, PyAny>, Bound<'_, PyAny>, Bound<'_, PyAny>) = parts
            .extract()
            .map_err(|_| invalid(format!("moves are {} arrays, expected 3", parts.len())))?;
        return sparse(&from, &to, &values, n);
    }
    let moves = array::rows(moves, "moves")?;
    let values = matrix(&moves, n, "moves")?;
    if values.len() != n * n {
        return Err(invalid(format!("moves have {} rows, expected {n}", moves.shape()[0])));
    }
    let dense = DenseTransition::from_fn(n, |to, from| values[from * n + to]);
    Ok(Operator::Dense(dense.map_err(|error| of_moves(&error))?))
}

fn sparse(
    from: &Bound<'_, PyAny>,
    to: &Bound<'_, PyAny>,
    values: &Bound<'_, PyAny>,
    n: usize,
) -> PyResult<Operator> {
    let (from, to) = (array::indices(from, "rows")?, array::indices(to, "columns")?);
    let values = array::doubles(values, "probabilities")?;
    let values = contiguous(values.as_slice(), "probabilities")?;
    // `zip` below would drop the rest of the longer arrays.
    if from.len() != values.len() || to.len() != values.len() {
        let (rows, columns, count) = (from.len(), to.len(), values.len());
        return Err(invalid(format!(
            "moves have {rows} rows, {columns} columns and {count} values"
        )));
    }
    // The library's triplets are (row, column, value), and its rows are the states moved to.
    let triplets = to.into_iter().zip(from).zip(values).map(|((to, from), p)| (to, from, *p));
    let sparse = SparseTransition::from_triplets(n, triplets).map_err(|error| of_moves(&error))?;
    Ok(Operator::Sparse(Box::new(sparse)))
}

/// Returns the moves of a dense operator as an array with a row for each state that is left.
pub(crate) fn dense_moves<'py>(
    py: Python<'py>,
    operator: &DenseTransition,
) -> PyResult<Bound<'py, PyAny>> {
    let n = operator.states();
    // Row-major: `at / n` is the state that is left, `at % n` the one moved to.
    let entries = (0..n * n).map(|at| operator.get(at % n, at / n)).collect();
    Ok(PyArray1::from_vec(py, entries).reshape([n, n])?.into_any())
}

/// Returns the moves of a sparse operator as arrays of rows, columns and probabilities.
pub(crate) fn sparse_moves<'py>(
    py: Python<'py>,
    operator: &SparseTransition,
) -> PyResult<Bound<'py, PyAny>> {
    let (mut from, mut to, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (row, column, p) in operator.triplets() {
        from.push(index(Some(column)));
        to.push(index(Some(row)));
        values.push(p);
    }
    let arrays = (from.to_pyarray(py), to.to_pyarray(py), values.to_pyarray(py));
    Ok(arrays.into_pyobject(py)?.into_any())
}

/// Returns the rows of a table.
pub(crate) fn rows<'py>(py: Python<'py>, table: &TableLikelihood) -> PyResult<Bound<'py, PyAny>> {
    let (n, m) = (table.states(), table.symbols());
    let entries: Option<Vec<f64>> =
        (0..n * m).map(|at| table.probability(at / m, at % m)).collect();
    let entries = entries.ok_or_else(|| invalid("the table is incomplete"))?;
    Ok(PyArray1::from_vec(py, entries).reshape([n, m])?.into_any())
}
