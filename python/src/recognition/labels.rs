//! Labels of drives: the true places of steps, in one or several parts.

use std::ops::RangeInclusive;

use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use wayfix_recognition::LabelledPart;

use crate::array::integers;
use crate::error::invalid;
use crate::typed::{Rows, integer_rows};

/// Reads the places of labelled steps: an integer for each, or the first and last of a range. A
/// negative number is off the map, which is `None`.
pub(crate) fn places(values: &Bound<'_, PyAny>) -> PyResult<Vec<Option<RangeInclusive<usize>>>> {
    let axes = values.py().import("numpy")?.call_method1("ndim", (values,))?;
    if axes.extract::<usize>()? == 2 {
        let array = integer_rows(values, "places")?;
        let width = array.shape()[1];
        if width != 2 {
            return Err(invalid(format!(
                "places have {width} columns, expected 2: first and last"
            )));
        }
        let rows = Rows::of(&array)?;
        return Ok(rows.iter().map(|row| range(row[0], row[1])).collect());
    }
    let array = integers(values, "places")?;
    let values = array.as_slice().map_err(invalid)?;
    Ok(values.iter().map(|&place| range(place, place)).collect())
}

fn range(first: i64, last: i64) -> Option<RangeInclusive<usize>> {
    // Off the map if either is negative. The library refuses an empty range, with its step.
    Some(usize::try_from(first).ok()?..=usize::try_from(last).ok()?)
}

/// Labels of parts of drives, one after another.
#[derive(Debug)]
pub(super) struct Parts {
    pub(super) places: Vec<Option<RangeInclusive<usize>>>,
    pub(super) odometry: Vec<Option<f64>>,
    pub(super) lengths: Vec<usize>,
}

impl Parts {
    pub(super) fn check(&self, steps: usize) -> PyResult<()> {
        let labels = self.places.len();
        if labels != steps {
            return Err(invalid(format!(
                "found {labels} places, expected {steps}, one for each query"
            )));
        }
        // `with` slices by these lengths, so they must sum to the steps. A sum that overflows
        // cannot.
        let sum = self.lengths.iter().try_fold(0_usize, |sum, length| sum.checked_add(*length));
        if sum != Some(steps) {
            let sum = sum.map_or("more".to_owned(), |sum| sum.to_string());
            return Err(invalid(format!("lengths of parts sum to {sum}, expected {steps}")));
        }
        Ok(())
    }

    /// Returns the parts with their queries, which [`check`](Self::check) found to be as many.
    pub(super) fn with<'a, Q>(&'a self, queries: &'a [Q]) -> Vec<LabelledPart<'a, Q>> {
        let mut end = 0;
        let part = |length: &usize| {
            let steps = end..end + length;
            end = steps.end;
            // There is a reading for each step, or none at all.
            let odometry = self.odometry.get(steps.clone()).unwrap_or(&[]);
            LabelledPart { queries: &queries[steps.clone()], places: &self.places[steps], odometry }
        };
        self.lengths.iter().map(part).collect()
    }
}
