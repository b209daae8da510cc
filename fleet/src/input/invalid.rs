//! Invalid drives, and the search for them.

use std::ops::Range;

use serde::Serialize;

use super::Drives;
use super::lists::{Id, Ids};
use crate::error::FleetError;

/// An invalid drive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Invalid {
    /// Input row at fault, from 0.
    pub row: u64,
    /// Trace id, unless that is itself at fault.
    pub trace_id: Option<Id>,
    /// Column at fault.
    pub column: String,
    /// Cause, in words.
    pub reason: String,
}

impl Invalid {
    /// Turns the error of a value into an invalid drive; other errors do not concern a single drive
    /// and are returned.
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
    /// Turns the error of a value into an invalid drive of this batch.
    pub(crate) fn invalid(&self, drive: usize, error: FleetError) -> Result<Invalid, FleetError> {
        Invalid::new(error, Some(Ids::of(&self.ids).get(drive)))
    }
}

/// Applies a function to a range of drives. If it refuses the range because of a value, applies it
/// to each half, and so on down to single drives, which go to `blame`. Accepted ranges go to
/// `take`, in order.
///
/// # Errors
///
/// Errors other than those of a value.
pub(crate) fn halves<T>(
    drives: Range<usize>,
    apply: &mut impl FnMut(Range<usize>) -> Result<T, FleetError>,
    take: &mut impl FnMut(Range<usize>, T),
    blame: &mut impl FnMut(usize, FleetError) -> Result<(), FleetError>,
) -> Result<(), FleetError> {
    if drives.is_empty() {
        return Ok(());
    }
    // f drives at fault among n cost O(f log n) calls. The depth is log2 n, so recursion is safe.
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

/// Joins adjacent ranges of an ordered sequence.
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
