//! The four kinds of models as one type, and observations for their sensors.
//!
//! The library is generic over operator and sensor, and Python is not: a macro matches on the kind
//! and compiles its body once for each, so that no call within a routine is dynamic.

use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use wayfix::{DenseTransition, Hmm, LikelihoodVector, Prior, SparseTransition, TableLikelihood};
use wayfix_learn::Rows;

use crate::array::{self, matrix};
use crate::error::{invalid, of_several};

/// Model with one of the two operators and one of the two sensors.
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

/// Evaluates an expression with the model and the sequence in the type of its sensor.
macro_rules! with_sequence {
    ($model:expr, $observed:expr, |$hmm:ident, $ys:ident| $body:expr) => {
        match ($model, $observed) {
            (Model::DenseVector($hmm), $crate::kinds::Observed::Rows(rows)) => {
                let $ys = $crate::kinds::rows_of(rows, $hmm.states())?;
                let $ys = &$ys;
                $body
            }
            (Model::SparseVector($hmm), $crate::kinds::Observed::Rows(rows)) => {
                let $ys = $crate::kinds::rows_of(rows, $hmm.states())?;
                let $ys = &$ys;
                $body
            }
            (Model::DenseTable($hmm), $crate::kinds::Observed::Symbols(symbols)) => {
                let $ys = &symbols[..];
                $body
            }
            (Model::SparseTable($hmm), $crate::kinds::Observed::Symbols(symbols)) => {
                let $ys = &symbols[..];
                $body
            }
            // Not reached: `Model::observed` reads by the sensor of this same model.
            _ => return Err($crate::error::invalid($crate::kinds::OTHER_SENSOR)),
        }
    };
}

/// Evaluates an expression with the model and many sequences in the type of its sensor.
macro_rules! with_sequences {
    ($model:expr, $all:expr, |$hmm:ident, $ys:ident| $body:expr) => {
        match $model {
            Model::DenseVector($hmm) => {
                let $ys = $all.rows($hmm.states())?;
                $body
            }
            Model::SparseVector($hmm) => {
                let $ys = $all.rows($hmm.states())?;
                $body
            }
            Model::DenseTable($hmm) => {
                let $ys = $all.symbols()?;
                $body
            }
            Model::SparseTable($hmm) => {
                let $ys = $all.symbols()?;
                $body
            }
        }
    };
}

pub(crate) const OTHER_SENSOR: &str = "observations are not those of the model's sensor";

/// Observations of many sequences: each by itself, or all in one array with their lengths.
pub(crate) enum Many<'py> {
    Each(Vec<Observed<'py>>),
    Joined(Observed<'py>, Vec<usize>),
}

impl Many<'_> {
    pub(crate) fn rows(&self, states: usize) -> PyResult<Vec<Rows<'_>>> {
        let of = |values| Rows::new(values, states).map_err(invalid);
        match self {
            Self::Each(all) => all.iter().map(|observed| of(observed.values(states)?)).collect(),
            Self::Joined(observed, lengths) => {
                split(observed.values(states)?, lengths, states)?.into_iter().map(of).collect()
            }
        }
    }

    pub(crate) fn symbols(&self) -> PyResult<Vec<&[usize]>> {
        match self {
            Self::Each(all) => all.iter().map(Observed::symbols).collect(),
            Self::Joined(observed, lengths) => split(observed.symbols()?, lengths, 1),
        }
    }
}

/// Splits values into parts of these lengths, counted in rows of `width` values.
pub(crate) fn split<'a, T>(
    values: &'a [T],
    lengths: &[usize],
    width: usize,
) -> PyResult<Vec<&'a [T]>> {
    // The divisor is never 0: it is 1 or a number of states, and a prior without states is refused.
    let rows = values.len() / width;
    // Checked before anything is split: lengths come from outside, and their sum may overflow.
    let sum = lengths.iter().try_fold(0_usize, |sum, length| sum.checked_add(*length));
    if sum != Some(rows) {
        let count = lengths.len();
        return Err(invalid(format!("lengths of {count} sequences do not sum to {rows} rows")));
    }
    let mut rest = values;
    let part = |length: &usize| {
        // The lengths sum to the rows, so neither the product overflows nor the split panics.
        let (part, after) = rest.split_at(length * width);
        rest = after;
        part
    };
    Ok(lengths.iter().map(part).collect())
}

impl Observed<'_> {
    fn values(&self, states: usize) -> PyResult<&[f64]> {
        match self {
            Self::Rows(rows) => matrix(rows, states, "observations"),
            Self::Symbols(_) => Err(invalid(OTHER_SENSOR)),
        }
    }

    fn symbols(&self) -> PyResult<&[usize]> {
        match self {
            Self::Symbols(symbols) => Ok(symbols),
            Self::Rows(_) => Err(invalid(OTHER_SENSOR)),
        }
    }

    /// Number of steps.
    pub(crate) fn steps(&self) -> usize {
        match self {
            Self::Rows(rows) => rows.shape()[0],
            Self::Symbols(symbols) => symbols.len(),
        }
    }
}

pub(crate) fn rows_of<'a>(
    rows: &'a PyReadonlyArray2<'_, f64>,
    states: usize,
) -> PyResult<Rows<'a>> {
    Rows::new(matrix(rows, states, "observations")?, states).map_err(invalid)
}

impl Model {
    /// Reads the observations of many sequences: a list of them, or one array with their lengths.
    pub(crate) fn many<'py>(
        &self,
        all: &Bound<'py, PyAny>,
        lengths: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Many<'py>> {
        if let Some(lengths) = lengths {
            let lengths = array::indices(lengths, "lengths")?;
            return Ok(Many::Joined(self.observed_of(all, &lengths)?, lengths));
        }
        let py = all.py();
        let read = |(sequence, ys): (usize, PyResult<Bound<'py, PyAny>>)| {
            self.observed(&ys?).map_err(|error| of_several(py, sequence, &error))
        };
        Ok(Many::Each(all.try_iter()?.enumerate().map(read).collect::<PyResult<_>>()?))
    }

    /// Reads the observations of a sequence.
    pub(crate) fn observed<'py>(&self, ys: &Bound<'py, PyAny>) -> PyResult<Observed<'py>> {
        self.observed_of(ys, &[])
    }

    /// Reads the observations of a sequence, or of several of these lengths.
    fn observed_of<'py>(
        &self,
        ys: &Bound<'py, PyAny>,
        lengths: &[usize],
    ) -> PyResult<Observed<'py>> {
        match self {
            Self::DenseVector(_) | Self::SparseVector(_) => {
                Ok(Observed::Rows(array::rows(ys, "observations")?))
            }
            Self::DenseTable(_) | Self::SparseTable(_) => {
                Ok(Observed::Symbols(array::symbols(ys, lengths)?))
            }
        }
    }

    pub(crate) fn prior(&self) -> &Prior {
        match self {
            Self::DenseVector(hmm) => hmm.prior(),
            Self::DenseTable(hmm) => hmm.prior(),
            Self::SparseVector(hmm) => hmm.prior(),
            Self::SparseTable(hmm) => hmm.prior(),
        }
    }

    pub(crate) fn table(&self) -> Option<&TableLikelihood> {
        match self {
            Self::DenseTable(hmm) => Some(hmm.likelihood()),
            Self::SparseTable(hmm) => Some(hmm.likelihood()),
            Self::DenseVector(_) | Self::SparseVector(_) => None,
        }
    }

    /// Number of moves of a sparse model.
    pub(crate) fn entries(&self) -> Option<usize> {
        match self {
            // Counted in O(entries), for `repr` only.
            Self::SparseVector(hmm) => Some(hmm.transition().triplets().count()),
            Self::SparseTable(hmm) => Some(hmm.transition().triplets().count()),
            Self::DenseVector(_) | Self::DenseTable(_) => None,
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
