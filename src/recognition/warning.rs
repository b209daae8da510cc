//! Reasons to doubt a fit.

use std::fmt;

use super::fit::LabelledPart;
use super::{Recognizer, Recording};
use crate::observation::{ObservationError, nearest};

/// A reason to doubt what was learned, or that it suits a recording.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The right reference is hardly nearer to a labelled query than others: perhaps the
    /// matrix is transposed, similarities were taken for distances, or labels are of other
    /// steps.
    Chance {
        /// The mean share of references that are nearer than the right one; 0.5 by chance.
        rank: f64,
    },
    /// Few steps are labelled.
    Short {
        /// Number of them.
        steps: usize,
    },
    /// The best temperature is the last of those that were tried.
    Edge {
        /// It.
        temperature: f64,
    },
    /// The best scores of a recording are other than those of the labelled part, by more
    /// than is usual for it.
    Unlike {
        /// The mean best score of the labelled part.
        labelled: f64,
        /// That of the recording.
        recording: f64,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Chance { rank } => write!(
                f,
                "{:.0}% of references are nearer to a labelled query than the right one is, and \
                 50% would be by chance: is the matrix transposed, are similarities and distances \
                 mixed up, or labels of other steps?",
                100.0 * rank
            ),
            Self::Short { steps } => {
                write!(f, "{steps} steps are labelled, and {ENOUGH} or more tell how it drives")
            }
            Self::Edge { temperature } => write!(
                f,
                "the best temperature, {temperature}, is the last of those that were tried"
            ),
            Self::Unlike { labelled, recording } => write!(
                f,
                "the best match of a query scores {recording:.2} on average, and {labelled:.2} in \
                 the labelled part: they are unlike"
            ),
        }
    }
}

/// Fewer labelled steps than these are few.
const ENOUGH: usize = 30;
/// A mean rank above this is near to chance.
const CHANCE: f64 = 0.4;
/// Means of best scores that differ by more than so many deviations of one are unlike.
const APART: f64 = 1.0;

impl Recognizer {
    /// Warnings by the scores of labelled queries; and the mean and deviation of the best.
    pub(super) fn examine<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
        rows: &[Vec<Vec<f32>>],
    ) -> Result<(Vec<Warning>, Option<[f64; 2]>), ObservationError> {
        let sensor = self.sensor_of_fit();
        let mut scores = vec![0.0; self.references()];
        let (mut ranks, mut best) = (Vec::new(), Vec::new());
        for (part, rows) in parts.iter().zip(rows) {
            for (places, row) in part.places.iter().zip(rows) {
                let Some(places) = places else { continue };
                sensor.standardizer().scores(row, &mut scores)?;
                let least = |scores: &[f64]| scores.iter().copied().fold(f64::INFINITY, f64::min);
                let right = least(&scores[places.clone()]);
                let nearer = scores.iter().filter(|score| **score < right).count();
                ranks.push(nearer as f64 / scores.len() as f64);
                best.extend(nearest(row));
            }
        }
        let mut warnings = Vec::new();
        let rank = ranks.iter().sum::<f64>() / ranks.len() as f64;
        if rank > CHANCE && self.references() > 2 {
            warnings.push(Warning::Chance { rank });
        }
        if ranks.len() < ENOUGH {
            warnings.push(Warning::Short { steps: ranks.len() });
        }
        Ok((warnings, moments(&best)))
    }
}

impl Recording {
    /// Warns if its queries score other than those that were learned from, by which no
    /// label is needed; `None` if not, or nothing was learned.
    #[must_use]
    pub fn warning(&self) -> Option<Warning> {
        let [labelled, deviation] = self.recognizer().fit().best_scores?;
        let [recording, _] = moments(self.best_scores())?;
        let apart = (recording - labelled).abs() > APART * deviation;
        apart.then_some(Warning::Unlike { labelled, recording })
    }
}

/// The mean and the deviation of some numbers.
fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (count > 0.0).then(|| [mean, square.sqrt()])
}
