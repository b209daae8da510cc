//! Labelled parts of drives.

use std::ops::RangeInclusive;

use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use wayfix::recognition::LabelledPart;

use crate::array::integers;
use crate::error::invalid;
use crate::typed::{Rows, integer_rows};

/// Places of labelled steps: an integer for each, or the first and last of a range; below 0 is off
/// the map.
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
    Some(usize::try_from(first).ok()?..=usize::try_from(last).ok()?)
}

/// Parts of drives, one after another.
#[derive(Debug)]
pub(super) struct Parts {
    pub(super) queries: Vec<Vec<f32>>,
    pub(super) places: Vec<Option<RangeInclusive<usize>>>,
    pub(super) odometry: Vec<Option<f64>>,
    pub(super) lengths: Vec<usize>,
}

impl Parts {
    pub(super) fn check(&self) -> PyResult<()> {
        let (steps, labels) = (self.queries.len(), self.places.len());
        if labels != steps {
            return Err(invalid(format!(
                "places are {labels}, expected {steps}, one for each query"
            )));
        }
        // Lengths that overflow are too many.
        let sum = self.lengths.iter().try_fold(0_usize, |sum, length| sum.checked_add(*length));
        if sum != Some(steps) {
            let sum = sum.map_or("more".to_owned(), |sum| sum.to_string());
            return Err(invalid(format!("lengths of parts sum to {sum}, expected {steps}")));
        }
        Ok(())
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = LabelledPart<'_, Vec<f32>>> {
        let mut end = 0;
        self.lengths.iter().map(move |length| {
            let steps = end..end + length;
            end = steps.end;
            let odometry = self.odometry.get(steps.clone()).unwrap_or(&[]);
            LabelledPart {
                queries: &self.queries[steps.clone()],
                places: &self.places[steps],
                odometry,
            }
        })
    }
}
