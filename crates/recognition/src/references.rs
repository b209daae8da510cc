//! References of a route, and the distance of a query to each: of several traverses, the smallest
//! to each place. Before any drive, their usual scores are learned from the references themselves.

use std::ops::Range;

use super::RecognitionError;
use crate::observation::{
    Distance, ReferenceDescriptors, RowScratch, Standardizer, ViewError, row_scores,
};
use wayfix::error::OutOfRange;

/// Number of evenly spaced references that are compared with all others, to learn the usual scores
/// of each.
const SAMPLE: usize = 64;
/// Distance along the route within which references always count as alike because they are near,
/// and the score below which farther ones also do.
const NEAR: usize = 10;
const FAR_SCORE: f32 = -1.0;

/// A view that teaches the usual scores of references.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exemplar<'a> {
    pub(super) descriptor: &'a [f32],
    /// The reference that shows the same view, if there is one: those around it say nothing about
    /// usual scores.
    pub(super) reference: Option<usize>,
    /// Weight, in queries.
    pub(super) weight: f64,
}

/// Scratch memory for [`References::observe`].
#[derive(Debug, Default)]
pub(super) struct ExemplarScratch {
    row: Vec<f32>,
    more: Vec<f32>,
    scores: Vec<f32>,
    rows: RowScratch,
}

/// References around a given one that look like it because they are near.
fn alike_around(
    row: &[f32],
    at: usize,
    scores: &mut Vec<f32>,
    scratch: &mut RowScratch,
) -> Result<Range<usize>, ViewError> {
    row_scores(row, scores, scratch)?;
    let alike = |score: &&f32| **score < FAR_SCORE;
    let before = scores[..at].iter().rev().take_while(alike).count().max(NEAR);
    let after = scores[at + 1..].iter().take_while(alike).count().max(NEAR);
    Ok(at.saturating_sub(before)..(at + after + 1).min(row.len()))
}

/// References of a route: descriptors of one traverse or of several, or only their number if
/// queries come as distances.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum References {
    /// Number of references; a query is a row of that many distances.
    Compared(usize),
    /// Descriptors of each traverse, in the form of queries; reference i of each shows place i.
    Descriptors(Vec<ReferenceDescriptors>),
}

impl References {
    /// Checks the descriptors of several traverses of the same places.
    pub(super) fn from_traverses<R: AsRef<[f32]>>(
        traverses: &[&[R]],
        distance: Distance,
    ) -> Result<Self, RecognitionError> {
        let mut all = Vec::new();
        for (traverse, rows) in traverses.iter().enumerate() {
            let failed = |cause| RecognitionError::references(traverse, cause);
            all.push(ReferenceDescriptors::from_rows(rows, distance).map_err(failed)?);
        }
        let Some(first) = all.first() else {
            return Err(OutOfRange::none("the number of traverses").into());
        };
        for other in &all[1..] {
            let counts = [
                ("the number of references of a traverse", other.count(), first.count()),
                ("the number of numbers of a descriptor", other.dimension(), first.dimension()),
            ];
            if let Some(&(what, found, expected)) = counts.iter().find(|(_, a, b)| a != b) {
                return Err(OutOfRange::count(what, found, expected).into());
            }
        }
        Ok(Self::Descriptors(all))
    }

    /// Estimates the usual scores of each reference from the other references: one that looks like
    /// many of them looks like many queries, too (on one recording in two seasons, means correlate
    /// by 0.7 and deviations by 0.8).
    pub(super) fn standardizer(&self) -> Result<Standardizer, ViewError> {
        let count = self.count();
        let mut standardizer = Standardizer::new(count)?;
        let Self::Descriptors(traverses) = self else { return Ok(standardizer) };
        let sample = SAMPLE.min(count);
        let mut scratch = ExemplarScratch::default();
        for at in (0..sample).map(|at| at * count / sample) {
            let Some(descriptor) = traverses[0].descriptor(at) else { continue };
            let view = Exemplar { descriptor: &descriptor, reference: Some(at), weight: 1.0 };
            self.observe(view, &mut standardizer, &mut scratch)?;
        }
        Ok(standardizer)
    }

    /// Learns the usual scores of each reference from a view.
    pub(super) fn observe(
        &self,
        view: Exemplar<'_>,
        standardizer: &mut Standardizer,
        scratch: &mut ExemplarScratch,
    ) -> Result<(), ViewError> {
        let ExemplarScratch { row, more, scores, rows } = scratch;
        // A view that cannot be compared, such as a zero descriptor, teaches nothing.
        if self.distances(0, view.descriptor, row, more).is_err() {
            return Ok(());
        }
        if let Some(at) = view.reference.filter(|at| *at < row.len()) {
            let near = alike_around(row, at, scores, rows)?;
            // The standardizer leaves out infinite distances.
            row[near].fill(f32::INFINITY);
        }
        row_scores(row, scores, rows)?;
        standardizer.add_scores(standardizer.spread(), scores, view.weight);
        Ok(())
    }

    pub(super) fn count(&self) -> usize {
        match self {
            Self::Compared(count) => *count,
            Self::Descriptors(traverses) => traverses[0].count(),
        }
    }

    /// Computes the distance of a query to each place: the smallest over the traverses, since a
    /// place that looks right in one season is right. `more` is scratch memory.
    pub(super) fn distances(
        &self,
        step: usize,
        query: &[f32],
        out: &mut Vec<f32>,
        more: &mut Vec<f32>,
    ) -> Result<(), RecognitionError> {
        let failed = |cause| RecognitionError::descriptor(step, cause);
        match self {
            Self::Compared(_) => {
                out.clear();
                out.extend_from_slice(query);
            }
            Self::Descriptors(traverses) => {
                out.resize(self.count(), 0.0);
                traverses[0].distances_into(query, out).map_err(failed)?;
                for traverse in &traverses[1..] {
                    more.resize(out.len(), 0.0);
                    traverse.distances_into(query, more).map_err(failed)?;
                    out.iter_mut().zip(&*more).for_each(|(a, b)| *a = a.min(*b));
                }
            }
        }
        Ok(())
    }
}
