//! Warnings from the comparison of a fit with labels and recordings. Thresholds are between
//! genuine drives and mistakes that were provoked.

use std::ops::RangeInclusive;

use super::fit::LabelledPart;
use super::warning::{ENOUGH, FEWEST, UNSURE, Warning};
use super::{Recognizer, Recording};
use crate::motion::OdometryModel;
use crate::observation::ViewError;

/// Mean rank above which matches are close to chance.
const CHANCE: f64 = 0.4;
/// Range of the scale, and largest deviation, of an odometry that is in references.
const SCALES: RangeInclusive<f64> = 0.8..=1.25;
const DEVIATION: f64 = 1.0;
/// Number of parts of a drive, each of the length of those whose answers may be unsure.
const PART: usize = 4;
/// Number of moves below which there are too few to say how fast the vehicle is.
const FEWEST_MOVES: usize = 20;
impl Recognizer {
    /// Returns warnings from the scores of labelled queries.
    pub(super) fn examine<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
        rows: &[Vec<Vec<f32>>],
    ) -> Result<Vec<Warning>, ViewError> {
        let (mut scores, mut ranks) = (vec![0.0; self.references()], Vec::new());
        for (part, rows) in parts.iter().zip(rows) {
            for (places, row) in part.places.iter().zip(rows) {
                let Some(places) = places else { continue };
                self.sensor.standardizer.scores(row, &mut scores)?;
                ranks.push(mean_rank(&scores, places));
            }
        }
        let rank = ranks.iter().sum::<f64>() / ranks.len() as f64;
        let chance = rank > CHANCE && self.references() > 2;
        let short = ranks.len() < ENOUGH;
        let chance = chance.then_some(Warning::Chance { rank });
        let short = short.then_some(Warning::Short { steps: ranks.len() });
        Ok(chance.into_iter().chain(short).collect())
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

/// Mean rank of some places: the share of other references that score less, with ties counted half.
fn mean_rank(scores: &[f64], places: &RangeInclusive<usize>) -> f64 {
    let mut sorted = scores.to_vec();
    sorted.sort_by(f64::total_cmp);
    let others = scores.len().saturating_sub(1).max(1) as f64;
    let right = &scores[places.clone()];
    let rank = |score: &f64| {
        let less = sorted.partition_point(|other| other < score);
        let equal = sorted.partition_point(|other| other <= score) - less;
        // The score itself is among the equal ones and does not count.
        (less as f64 + 0.5 * (equal as f64 - 1.0)) / others
    };
    right.iter().map(rank).sum::<f64>() / right.len() as f64
}

impl Recording {
    /// Returns all warnings about the recording: odometry that is [stuck](Warning::Stuck) while the
    /// views change, a vehicle that is [faster](Warning::Fast) than the options let it be, and a part
    /// of the drive where answers are [unsure](Warning::Unsure). No labels are needed. O(n) a step.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let all = [self.stuck.warning(), self.warn_too_fast(), self.warn_unsure()];
        all.into_iter().flatten().collect()
    }

    /// Warns if the nearest references, without odometry, agree on a speed that is not modelled.
    fn warn_too_fast(&self) -> Option<Warning> {
        let n = self.recognizer.references();
        let speeds = self.recognizer.options().speeds.values().iter();
        let fastest = speeds.fold(0.0, |most: f64, speed| most.max(speed.abs()));
        let places: Vec<usize> = self.single.iter().map(|belief| belief.mode()).collect();
        // Where there is odometry, answers follow its speed, so only steps without it are examined.
        let steps = places.windows(2).zip(&self.readings[1.min(self.steps())..]);
        let free = steps.filter(|(_, reading)| reading.is_none());
        let moved = free.map(|(pair, _)| {
            let way = pair[0].abs_diff(pair[1]);
            (if self.recognizer.options().closed { way.min(n - way) } else { way }) as f64
        });
        let mut moved: Vec<f64> = moved.collect();
        moved.sort_unstable_by(f64::total_cmp);
        let median = *moved.get(moved.len() / 2)?;
        // Frames that match nothing jump anywhere. Most moves must be alike, so that such frames do
        // not decide.
        let alike = |way: &&f64| (**way - median).abs() <= 1.0 + 0.25 * median;
        let agreed = 2 * moved.iter().filter(alike).count() > moved.len();
        (moved.len() >= FEWEST_MOVES && agreed && median > fastest + 0.5)
            .then_some(Warning::Fast { moved: median, fastest })
    }

    /// Warns if the filter's answers have a low mean probability over a part of the drive.
    fn warn_unsure(&self) -> Option<Warning> {
        let mut sums = vec![0.0];
        for answer in self.filtered.answers() {
            sums.push(sums[sums.len() - 1] + answer.probability);
        }
        let steps = (self.steps() / PART).max(FEWEST as usize);
        // The sum over a part is a difference of running sums.
        let parts = sums.iter().zip(sums.iter().skip(steps));
        let means = parts.map(|(from, to)| (to - from) / steps as f64).zip(steps..);
        let (mean, step) = means.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (mean < UNSURE).then_some(Warning::Unsure { mean, step, steps })
    }
}
