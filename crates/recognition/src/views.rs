//! Views compared with the last new one: changed or not, and how new.

use super::Options;
use crate::motion::ViewChange;
use crate::observation::change;

/// Least score of a row without NaN.
pub(super) fn least(rows: &[f32]) -> f32 {
    // Sixteen independent minima, which the compiler turns into vectors.
    let mut lanes = [f32::INFINITY; 16];
    let (whole, rest) = rows.as_chunks::<16>();
    let take = |least: &mut f32, score: f32| *least = if score < *least { score } else { *least };
    for chunk in whole {
        lanes.iter_mut().zip(chunk).for_each(|(least, score)| take(least, *score));
    }
    lanes.iter_mut().zip(rest).for_each(|(least, score)| take(least, *score));
    lanes.into_iter().fold(f32::INFINITY, f32::min)
}

/// Index of the least score of a row that is not empty; the first if several are equal.
pub(super) fn nearest(rows: &[f32]) -> usize {
    let least = least(rows);
    rows.iter().position(|score| *score == least).unwrap_or(0)
}

/// Comparison of a view with the last new one.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Changed or not, if that is clear.
    pub(super) change: Option<ViewChange>,
    /// Share of the view that is new, 1 − r for a correlation of r with the last new one; 0 for a
    /// view that is not new.
    pub(super) fresh: f64,
}

impl View {
    /// The first view, which is new.
    pub(super) const FIRST: Self = Self { change: Some(ViewChange::Changed), fresh: 1.0 };

    /// Compares the scores within a row with those of the last new view; a view that changes by at
    /// most `still` counts as unchanged.
    pub(super) fn beside(last: &[f32], still: f64, scores: &[f32], options: &Options) -> Self {
        let changed = change(last, scores);
        // The unit is the change from reference to reference in the same row, so that neither scale
        // nor density of the references matters.
        let unit = change(&scores[1..], &scores[..scores.len() - 1]);
        if changed <= still {
            return Self { change: Some(ViewChange::Unchanged), fresh: 0.0 };
        }
        // Below the threshold but above `still`, the view carries evidence neither on the place nor
        // of standing.
        if changed < options.view_threshold * unit {
            return Self { change: None, fresh: 0.0 };
        }
        Self { fresh: changed.min(1.0), ..Self::FIRST }
    }
}
