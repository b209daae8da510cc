//! Changes of the camera's view, measured between rows of distances rather than images.

use super::error::ViewError;
use super::rows::{RowScratch, change, row_scores};
use crate::motion::ViewChange;
use wayfix::error::OutOfRange;

/// Change between two views: Σ (a − b)² / Σ (a² + b²) over the scores a and b within their rows of
/// distances (see [`Standardizer`](super::Standardizer)), each within ±5. 0 for rows that are equal
/// up to scale and offset; about 1 for two places that have nothing in common, and at most 2.
/// Distances that are infinite in either row are left out; if none remains, the change is 1. O(n).
///
/// Rows of distances stand for the images, so this works for descriptors and similarities of any
/// kind.
///
/// # Errors
///
/// [`ViewError`] if the rows differ in length, or for NaN or −∞.
pub fn view_change(before: &[f32], now: &[f32]) -> Result<f64, ViewError> {
    if before.len() != now.len() {
        let (found, expected) = (now.len(), before.len());
        return Err(ViewError::Distances { found, expected });
    }
    let (mut a, mut b, mut scratch) = (Vec::new(), Vec::new(), RowScratch::default());
    row_scores(before, &mut a, &mut scratch)?;
    row_scores(now, &mut b, &mut scratch)?;
    Ok(change(&a, &b))
}

/// Detects changes of the view frame by frame, compared with the last new view, so that slow
/// creeping is noticed.
///
/// A frame that repeats the one before is not fresh evidence on the place: give the filter `None`
/// for it ([`OptionalLikelihood`](wayfix::OptionalLikelihood)). It is evidence on the motion: give
/// it to [`RouteControl`](crate::motion::RouteControl). Otherwise, during a stop at a light, the
/// filter becomes certain of whatever that one image happens to resemble.
///
/// ```
/// use wayfix_recognition::motion::ViewChange;
/// use wayfix_recognition::observation::ViewComparison;
///
/// let mut views = ViewComparison::new(0.1)?;
/// assert_eq!(views.next(&[0.2, 0.8, 0.9])?, ViewChange::Changed); // the first is new
/// assert_eq!(views.next(&[0.2, 0.81, 0.9])?, ViewChange::Unchanged);
/// assert_eq!(views.next(&[0.9, 0.3, 0.8])?, ViewChange::Changed);
/// # Ok::<(), wayfix_recognition::observation::ViewError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ViewComparison {
    threshold: f64,
    /// Scores within the row of the last new view.
    last_new: Option<Vec<f32>>,
    now: Vec<f32>,
    scratch: RowScratch,
}

// Scratch memory does not count.
impl PartialEq for ViewComparison {
    fn eq(&self, other: &Self) -> bool {
        (self.threshold, &self.last_new) == (other.threshold, &other.last_new)
    }
}

impl ViewComparison {
    /// Creates a comparison with a threshold: a [`view_change`] below it does not count.
    ///
    /// # Errors
    ///
    /// [`ViewError::Parameter`] unless it is finite and at least 0; at 0
    /// every view is new.
    pub fn new(threshold: f64) -> Result<Self, ViewError> {
        let (what, expected) = ("the threshold of change", "a finite value of at least 0");
        OutOfRange::check(what, threshold, 0.0..=f64::MAX, expected)?;
        Ok(Self { threshold, last_new: None, now: Vec::new(), scratch: RowScratch::default() })
    }

    /// Estimates a threshold: a tenth of the median change from row to row, over finite changes
    /// above 0. For recordings where the vehicle moves most of the time. O(N log N) for N
    /// distances; 0 without such a change.
    ///
    /// # Errors
    ///
    /// [`ViewError::Distances`] if rows differ in length.
    pub fn threshold_of<R: AsRef<[f32]>>(rows: &[R]) -> Result<f64, ViewError> {
        let changes = rows.windows(2).map(|two| view_change(two[0].as_ref(), two[1].as_ref()));
        let mut changes: Vec<f64> = changes.collect::<Result<_, _>>()?;
        changes.retain(|change| *change > 0.0 && change.is_finite());
        changes.sort_by(f64::total_cmp);
        Ok(changes.get(changes.len() / 2).map_or(0.0, |median| 0.1 * median))
    }

    /// Takes the next row of distances, and returns whether the view has changed. The first row
    /// counts as changed, and so does one that cannot be compared. O(n); allocates nothing after
    /// the first.
    ///
    /// # Errors
    ///
    /// [`ViewError`] for a row of a different length than before, or with NaN or −∞; the
    /// state is then unchanged.
    pub fn next(&mut self, distances: &[f32]) -> Result<ViewChange, ViewError> {
        let Self { threshold, last_new, now, scratch } = self;
        if let Some(last) = last_new
            && last.len() != distances.len()
        {
            let (found, expected) = (distances.len(), last.len());
            return Err(ViewError::Distances { found, expected });
        }
        // A row that is not valid returns here, before the last new view changes.
        row_scores(distances, now, scratch)?;
        match last_new {
            // The last new view stays, so that many small changes add up to a new one.
            Some(last) if change(last, now) < *threshold => return Ok(ViewChange::Unchanged),
            Some(last) => last.copy_from_slice(now),
            None => *last_new = Some(now.clone()),
        }
        Ok(ViewChange::Changed)
    }
}
