//! Reasons to doubt a fit.

use std::fmt;
use std::ops::RangeInclusive;

use super::labels::LabelledPart;
use super::{Recognizer, Recording};
use crate::motion::OdometryModel;
use crate::observation::{ObservationError, nearest};
use crate::sequence::Sequence;

/// A reason to doubt what was learned, or that it suits a recording.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The right reference is hardly nearer to a labelled query than others: perhaps the
    /// matrix is transposed, similarities were taken for distances, or labels are of other
    /// steps.
    Chance {
        /// The mean share of the other references that are nearer than a right one, those
        /// that are as near counted half; 0.5 by chance.
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
    /// Odometry is far from what the labels say: perhaps it is not in references, or of
    /// other steps.
    Odometry {
        /// The scale that was learned, 1 if a reading is in references.
        scale: f64,
        /// The deviation that was learned, in places.
        deviation: f64,
    },
    /// Steps are labelled as off the map, which the options do not model, so that they were
    /// not learned from: set [`Options::off_map`](super::Options::off_map).
    OffMap {
        /// Number of them.
        steps: usize,
    },
    /// The best scores of a recording are other than those of the labelled part, by more
    /// than is usual for it.
    Unlike {
        /// The mean best score of the labelled part.
        labelled: f64,
        /// That of the recording.
        recording: f64,
    },
    /// For 200 new frames the best explanation is that the vehicle is lost: the images
    /// match nothing, or only here and there. Perhaps it is another route, or leaves it.
    Nothing {
        /// The mean log-likelihood of these frames, given those before; 0 if they say
        /// nothing, and more if they match.
        mean: f64,
        /// The last step of these, from 1, of the worst such ones.
        step: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Chance { rank } => write!(
                f,
                "{:.0}% of references are nearer to a labelled query than a right one is, and \
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
            Self::Odometry { scale, deviation } => write!(
                f,
                "odometry reads {scale:.3} for each reference driven, give or take \
                 {deviation:.2}: is it in references, and of the same steps?"
            ),
            Self::OffMap { steps } => write!(
                f,
                "{steps} labelled steps are off the map and were not learned from: \
                 Options::off_map is None"
            ),
            Self::Unlike { labelled, recording } => write!(
                f,
                "the best match of a query scores {recording:.2} on average, and {labelled:.2} in \
                 the labelled part: they are unlike"
            ),
            Self::Nothing { mean, step } => write!(
                f,
                "the {SPAN} new images until step {step} match nothing: their mean log-likelihood \
                 is {mean:.2}; is it this route, and is Options::off_map None on purpose?"
            ),
        }
    }
}

/// Fewer labelled steps than these are few.
const ENOUGH: usize = 30;
/// A mean rank above this is near to chance.
const CHANCE: f64 = 0.4;
/// Odometry in references is within these, and a unit that is not has more deviation.
const SCALES: RangeInclusive<f64> = 0.8..=1.25;
const DEVIATION: f64 = 1.0;
/// A mean over so many new frames shows that they match nothing: on a railway in two seasons,
/// by pixels and by a network, those of genuine drives were above 0, and those of drives
/// elsewhere and of noise below −0.33, where −0.51 is of a vehicle that is surely lost.
const SPAN: usize = 200;
/// Share of the latter.
const SUSPECT: f64 = 0.5;
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
                ranks.push(mean_rank(&scores, places));
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

    /// Warnings by what labels and odometry say of how it drives.
    pub(super) fn examine_drives<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
        has_odometry: bool,
    ) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let OdometryModel { scale, deviation, .. } = self.options().odometry;
        if has_odometry && !(SCALES.contains(&scale) && deviation <= DEVIATION) {
            warnings.push(Warning::Odometry { scale, deviation });
        }
        let off = parts.iter().flat_map(|part| part.places).filter(|places| places.is_none());
        let steps = off.count();
        if steps > 0 && self.options().off_map.is_none() {
            warnings.push(Warning::OffMap { steps });
        }
        warnings
    }
}

/// The mean over some places of the share of the other references that score less, of
/// equal ones half.
fn mean_rank(scores: &[f64], places: &RangeInclusive<usize>) -> f64 {
    let mut sorted = scores.to_vec();
    sorted.sort_by(f64::total_cmp);
    let others = scores.len().saturating_sub(1).max(1) as f64;
    let right = &scores[places.clone()];
    let rank = |score: &f64| {
        let less = sorted.partition_point(|other| other < score);
        let equal = sorted.partition_point(|other| other <= score) - less;
        (less as f64 + 0.5 * (equal as f64 - 1.0)) / others
    };
    right.iter().map(rank).sum::<f64>() / right.len() as f64
}

impl Recording {
    /// Warns if its queries are other than those that were learned from, or match nothing
    /// for a while though the map is never left; `None` if not. No label is needed. Costs
    /// what [`filtered`](Self::filtered) costs.
    #[must_use]
    pub fn warning(&self) -> Option<Warning> {
        self.unlike().or_else(|| self.nothing())
    }

    fn unlike(&self) -> Option<Warning> {
        let [labelled, deviation] = self.recognizer().fit().best_scores?;
        let [recording, _] = moments(self.best_scores())?;
        let apart = (recording - labelled).abs() > APART * deviation;
        apart.then_some(Warning::Unlike { labelled, recording })
    }

    /// By how well the filter predicts the images: of a vehicle that is surely lost, ln of
    /// the odds of that.
    fn nothing(&self) -> Option<Warning> {
        let options = self.recognizer().options();
        let least = SUSPECT * options.lost_odds.ln();
        if options.off_map.is_some() || least == 0.0 {
            return None;
        }
        let mut filter = self.recognizer().model().filter();
        let (mut logs, mut worst) = (Vec::new(), (least, 0));
        let mut sum = 0.0;
        for step in 1..=self.steps() {
            filter.predict_with(self.control(step)).ok()?;
            let likelihoods = self.observation(step);
            let log = filter.update(likelihoods).ok()?;
            // Frames that have not changed say nothing.
            if likelihoods.iter().all(|likelihood| *likelihood == 1.0) {
                continue;
            }
            logs.push(log);
            sum += log;
            if let Some(before) = logs.len().checked_sub(SPAN + 1) {
                sum -= logs[before];
            }
            let mean = sum / SPAN as f64;
            if logs.len() >= SPAN && mean < worst.0 {
                worst = (mean, step);
            }
        }
        let (mean, step) = worst;
        (step > 0).then_some(Warning::Nothing { mean, step })
    }
}

/// The mean and the deviation of some numbers.
fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (count > 0.0).then(|| [mean, square.sqrt()])
}
