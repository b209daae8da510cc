//! Kinds of models, and observations for their sensors.

use std::sync::Arc;

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use wayfix::emission::Rows;
use wayfix::{DenseTransition, Hmm, LikelihoodVector, SparseTransition, TableLikelihood};

use crate::array::{self, matrix};
use crate::error::invalid;

/// A model with one of the operators and one of the sensors.
#[derive(Debug, Clone)]
pub(crate) enum Model {
    DenseVector(Arc<Hmm<DenseTransition, LikelihoodVector>>),
    DenseTable(Arc<Hmm<DenseTransition, TableLikelihood>>),
    SparseVector(Arc<Hmm<SparseTransition, LikelihoodVector>>),
    SparseTable(Arc<Hmm<SparseTransition, TableLikelihood>>),
}

/// Observations of a sequence.
pub(crate) enum Observed<'py> {
    Rows(PyReadonlyArray2<'py, f64>),
    Symbols(Vec<usize>),
}

/// Calls code with the model, and the sequence for its sensor.
macro_rules! with_sequence {
    ($model:expr, $observed:expr, |$hmm:ident, $ys:ident| $body:expr) => {
        match ($model, $observed) {
            (Model::DenseVector($hmm), Observed::Rows(rows)) => {
                let $ys = $crate::kinds::rows_of(rows, $hmm.states())?;
                let $ys = &$ys;
                $body
            }
            (Model::SparseVector($hmm), Observed::Rows(rows)) => {
                let $ys = $crate::kinds::rows_of(rows, $hmm.states())?;
                let $ys = &$ys;
                $body
            }
            (Model::DenseTable($hmm), Observed::Symbols(symbols)) => {
                let $ys = &symbols[..];
                $body
            }
            (Model::SparseTable($hmm), Observed::Symbols(symbols)) => {
                let $ys = &symbols[..];
                $body
            }
            _ => return Err($crate::error::invalid($crate::kinds::OTHER_SENSOR)),
        }
    };
}

/// The same for many sequences.
macro_rules! with_sequences {
    ($model:expr, $all:expr, |$hmm:ident, $ys:ident| $body:expr) => {
        match $model {
            Model::DenseVector($hmm) => {
                let $ys = &$crate::kinds::all_rows($all, $hmm.states())?[..];
                $body
            }
            Model::SparseVector($hmm) => {
                let $ys = &$crate::kinds::all_rows($all, $hmm.states())?[..];
                $body
            }
            Model::DenseTable($hmm) => {
                let $ys = &$crate::kinds::all_symbols($all)?[..];
                $body
            }
            Model::SparseTable($hmm) => {
                let $ys = &$crate::kinds::all_symbols($all)?[..];
                $body
            }
        }
    };
}

pub(crate) const OTHER_SENSOR: &str = "observations are not those of the model's sensor";

pub(crate) fn all_rows<'a>(all: &'a [Observed<'_>], states: usize) -> PyResult<Vec<Rows<'a>>> {
    let rows = |observed: &'a Observed<'_>| match observed {
        Observed::Rows(rows) => rows_of(rows, states),
        Observed::Symbols(_) => Err(invalid(OTHER_SENSOR)),
    };
    all.iter().map(rows).collect()
}

pub(crate) fn all_symbols<'a>(all: &'a [Observed<'_>]) -> PyResult<Vec<&'a [usize]>> {
    let symbols = |observed: &'a Observed<'_>| match observed {
        Observed::Symbols(symbols) => Ok(&symbols[..]),
        Observed::Rows(_) => Err(invalid(OTHER_SENSOR)),
    };
    all.iter().map(symbols).collect()
}

pub(crate) fn rows_of<'a>(
    rows: &'a PyReadonlyArray2<'_, f64>,
    states: usize,
) -> PyResult<Rows<'a>> {
    Rows::new(matrix(rows, states, "observations")?, states).map_err(invalid)
}

impl Model {
    /// Reads the observations of a sequence.
    pub(crate) fn observed<'py>(&self, ys: &Bound<'py, PyAny>) -> PyResult<Observed<'py>> {
        match self {
            Self::DenseVector(_) | Self::SparseVector(_) => {
                Ok(Observed::Rows(array::rows(ys, "observations")?))
            }
            Self::DenseTable(_) | Self::SparseTable(_) => {
                Ok(Observed::Symbols(array::indices(ys, "symbols")?))
            }
        }
    }

    pub(crate) fn states(&self) -> usize {
        match self {
            Self::DenseVector(hmm) => hmm.states(),
            Self::DenseTable(hmm) => hmm.states(),
            Self::SparseVector(hmm) => hmm.states(),
            Self::SparseTable(hmm) => hmm.states(),
        }
    }
}

pub(crate) use {with_sequence, with_sequences};
