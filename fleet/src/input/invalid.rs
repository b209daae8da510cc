//! Drives that are no valid input.

use std::ops::Range;

use serde::Serialize;

use super::Drives;
use super::lists::{Id, Ids};
use crate::error::FleetError;

/// A drive that is no valid input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Invalid {
    /// Row of the input that is at fault, from 0.
    pub row: u64,
    /// Trace id, unless it is at fault itself.
    pub trace_id: Option<Id>,
    /// Column that is at fault.
    pub column: String,
    /// Cause, in words.
    pub reason: String,
}

impl Invalid {
    /// Names the drive of an error of a value; other errors are not those of a drive.
    pub(crate) fn new(error: FleetError, trace_id: Option<Id>) -> Result<Self, FleetError> {
        match error {
            FleetError::Value { column, row, message: reason } => {
                Ok(Self { row, trace_id, column, reason })
            }
            other => Err(other),
        }
    }
}

impl Drives {
    /// Names a drive of an error of a value.
    pub(crate) fn invalid(&self, drive: usize, error: FleetError) -> Result<Invalid, FleetError> {
        Invalid::new(error, Some(Ids::of(&self.ids).get(drive)))
    }
}

/// Applies a function to ranges of so many drives; of a range that it refuses for a value, to its
/// halves, down to the drives that are at fault, which `blame` takes.
///
/// # Errors
///
/// Errors that are not of a value.
pub(crate) fn halves<T>(
    drives: Range<usize>,
    apply: &mut impl FnMut(Range<usize>) -> Result<T, FleetError>,
    take: &mut impl FnMut(Range<usize>, T),
    blame: &mut impl FnMut(usize, FleetError) -> Result<(), FleetError>,
) -> Result<(), FleetError> {
    if drives.is_empty() {
        return Ok(());
    }
    match apply(drives.clone()) {
        Ok(done) => take(drives, done),
        Err(error @ FleetError::Value { .. }) if drives.len() == 1 => blame(drives.start, error)?,
        Err(FleetError::Value { .. }) => {
            let middle = drives.start + drives.len() / 2;
            halves(drives.start..middle, apply, take, blame)?;
            halves(middle..drives.end, apply, take, blame)?;
        }
        Err(error) => return Err(error),
    }
    Ok(())
}

/// Ranges without gaps, of ranges in their order.
pub(super) fn joined(ranges: Vec<Range<usize>>) -> Vec<Range<usize>> {
    let mut joined: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => joined.push(range),
        }
    }
    joined
}
