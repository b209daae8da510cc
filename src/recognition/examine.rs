//! Comparing a fit with labels and recordings, to find reasons to doubt it.

use std::ops::RangeInclusive;

use super::labels::LabelledPart;
use super::sensor::least;
use super::warning::{ENOUGH, SPAN, Warning};
use super::{Recognizer, Recording};
use crate::motion::OdometryModel;
use crate::observation::{ObservationError, RowScratch, row_scores};
use crate::sequence::Sequence;

/// Mean rank above which matches are near to chance.
const CHANCE: f64 = 0.4;
/// Range of the scale and largest deviation of odometry that is in references.
const SCALES: RangeInclusive<f64> = 0.8..=1.25;
const DEVIATION: f64 = 1.0;
/// Share of the log-likelihood of a vehicle that is surely lost, below which a recording is
/// suspect.
const SUSPECT: f64 = 0.5;
/// Difference of two means of best scores, in deviations, above which they are unlike.
const UNLIKE: f64 = 1.0;

impl Recognizer {
    /// Returns warnings from the scores of labelled queries, and the mean and deviation of the
    /// best scores.
    pub(super) fn examine<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
        rows: &[Vec<Vec<f32>>],
    ) -> Result<(Vec<Warning>, Option<[f64; 2]>), ObservationError> {
        let sensor = self.sensor_of_fit();
        let mut scores = vec![0.0; self.references()];
        let (mut ranks, mut best) = (Vec::new(), Vec::new());
        let (mut within, mut scratch) = (Vec::new(), RowScratch::default());
        for (part, rows) in parts.iter().zip(rows) {
            for (places, row) in part.places.iter().zip(rows) {
                let Some(places) = places else { continue };
                sensor.standardizer().scores(row, &mut scores)?;
                ranks.push(mean_rank(&scores, places));
                row_scores(row, &mut within, &mut scratch)?;
                best.push(least(&within));
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

    /// Returns warnings from labels and odometry.
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

/// Mean rank of some places: the share of other references that score less, ties counted
/// half.
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
    /// Returns a warning if the queries differ from those of the fit, or match nothing for a
    /// while though the map is never left. Needs no labels. Costs as much as
    /// [`filtered`](Self::filtered).
    #[must_use]
    pub fn warning(&self) -> Option<Warning> {
        self.unlike().or_else(|| self.nothing())
    }

    fn unlike(&self) -> Option<Warning> {
        let [labelled, deviation] = self.recognizer().fit().best_scores?;
        let [recording, _] = moments(self.best_scores())?;
        let unlike = (recording - labelled).abs() > UNLIKE * deviation;
        unlike.then_some(Warning::Unlike { labelled, recording })
    }

    /// Warns if the filter predicts the images hardly better than for a vehicle that is surely
    /// lost, whose log-likelihood a step is ln `lost_odds`.
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
            // Unchanged frames carry no evidence.
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

/// Mean and standard deviation; `None` for no values.
fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (count > 0.0).then(|| [mean, square.sqrt()])
}
