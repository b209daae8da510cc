//! Comparing a fit with labels and recordings, to find reasons to doubt it.

use std::ops::RangeInclusive;

use super::labels::LabelledPart;
use super::warning::{ENOUGH, SPAN, Warning};
use super::{Recognizer, Recording};
use crate::motion::OdometryModel;
use crate::observation::{ObservationError, nearest};
use crate::sequence::Sequence;

/// A mean rank above this is near to chance.
const CHANCE: f64 = 0.4;
/// Odometry in references is within these, and a unit that is not has more deviation.
const SCALES: RangeInclusive<f64> = 0.8..=1.25;
const DEVIATION: f64 = 1.0;
/// Share of the log-likelihood of a vehicle that is surely lost, below which it is suspect.
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
