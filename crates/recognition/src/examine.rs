//! Warnings from the comparison of a fit with labels and recordings. Thresholds are between
//! genuine drives and mistakes that were provoked.

use std::ops::RangeInclusive;

use super::fit::LabelledPart;
use super::views::{EQUAL, STANDS, least, nearest};
use super::warning::{ENOUGH, SPAN, Warning};
use super::{Answer, RecognitionError, Recognizer, Recording};
use crate::motion::{OdometryModel, RouteControl};
use crate::observation::{RowScratch, ViewError, row_scores};
use wayfix::transition::Distraction;

/// Mean rank above which matches are close to chance.
const CHANCE: f64 = 0.4;
/// By how much the nearest image must be right more often than the best score for scores to be
/// wrong: as a share of labelled queries, and in deviations.
const BETTER: f64 = 0.1;
const SURELY: f64 = 3.0;
/// Range of the scale, and largest deviation, of an odometry that is in references.
const SCALES: RangeInclusive<f64> = 0.8..=1.25;
const DEVIATION: f64 = 1.0;
/// Mean log-likelihood of new frames below which a recording is suspect.
const SUSPECT: f64 = 0.15;
/// Number of new frames below which there are too few to say that they match nothing.
const FEWEST: usize = 50;
/// Number of moves below which there are too few to say how fast the vehicle is.
const FEWEST_MOVES: usize = 20;
/// Difference between two means of best scores, in deviations, above which they are unlike. Between
/// thirds of a drive it was 1.6 at most, and between queries of the references' own season and of
/// others at least 2.
const UNLIKE: f64 = 1.8;
/// Least probability of answers that odometry is compared with, and the difference over a stretch
/// of equal readings above which they contradict it, in places and as a share of the way.
const SURE: f64 = 0.9;
const DIFFERENCE: f64 = 6.0;
const DIFFERENCE_SHARE: f64 = 0.25;

/// Numbers of queries for which the nearest image, the best score, or both are right.
#[derive(Default)]
struct NearestComparison {
    queries: f64,
    nearest: f64,
    single: f64,
    both: f64,
}

impl NearestComparison {
    fn record(&mut self, nearest: bool, single: bool) {
        let add = |count: &mut f64, one: bool| *count += f64::from(u8::from(one));
        self.queries += 1.0;
        add(&mut self.nearest, nearest);
        add(&mut self.single, single);
        add(&mut self.both, nearest && single);
    }

    /// Warns if the nearest image is right far more often, and not by chance (McNemar's test).
    fn warning(&self) -> Option<Warning> {
        let Self { queries, nearest, single, both } = *self;
        let least = BETTER * queries;
        // Only queries on which the two disagree count. By chance either is right in half of them,
        // so the variance of the difference is their number.
        let chance = SURELY * f64::sqrt(nearest + single - 2.0 * both);
        (nearest - single > chance.max(least))
            .then(|| Warning::Nearest { nearest: nearest / queries, single: single / queries })
    }
}

impl Recognizer {
    /// Returns warnings from the scores of labelled queries, and the mean and deviation of their
    /// best scores.
    pub(super) fn examine<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
        rows: &[Vec<Vec<f32>>],
    ) -> Result<(Vec<Warning>, Option<[f64; 2]>), ViewError> {
        let mut scores = vec![0.0; self.references()];
        let (mut ranks, mut best) = (Vec::new(), Vec::new());
        let (mut within, mut scratch) = (Vec::new(), RowScratch::default());
        let mut comparison = NearestComparison::default();
        let mut before = Vec::new();
        for (part, rows) in parts.iter().zip(rows) {
            for (places, row) in part.places.iter().zip(rows) {
                let Some(places) = places else { continue };
                self.sensor.standardizer.scores(row, &mut scores)?;
                ranks.push(mean_rank(&scores, places));
                row_scores(row, &mut within, &mut scratch)?;
                best.extend(Some(f64::from(least(&within))).filter(|best| best.is_finite()));
                // Equal rows, of a vehicle that stands, count once.
                if before != *row {
                    let window = self.options().window;
                    let right =
                        |at: usize| at + window >= *places.start() && at <= places.end() + window;
                    let single = (0..scores.len()).min_by(|a, b| scores[*a].total_cmp(&scores[*b]));
                    comparison.record(right(nearest(&within)), single.is_some_and(right));
                    before.clone_from(row);
                }
            }
        }
        let mut warnings = Vec::new();
        let rank = ranks.iter().sum::<f64>() / ranks.len() as f64;
        if rank > CHANCE && self.references() > 2 {
            warnings.push(Warning::Chance { rank });
        }
        warnings.extend(comparison.warning());
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
    /// Returns all warnings about the recording: most views are [unchanged](Warning::Unchanged)
    /// although the vehicle moves, odometry is [stuck](Warning::Stuck), the view is
    /// [still](Warning::Still) while odometry reads that the vehicle moves, the queries are
    /// [unlike](Warning::Unlike) those of the fit, they match [nothing](Warning::Nothing) for a
    /// while although the map is never left, or the vehicle is [faster](Warning::Fast) than the
    /// options let it be. Needs no labels. Costs a pass of the filter if the map is never left,
    /// another if odometry reads the same for long, and [`smoothed`](Self::smoothed) if queries are
    /// unlike and the map may be left.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let own = self.own_warnings.iter().cloned();
        let stuck = own.clone().any(|warning| matches!(warning, Warning::Stuck { .. }));
        let stuck = if stuck { None } else { self.warn_stuck() };
        let fast = self.warn_too_fast();
        own.chain(stuck).chain(self.warn_unlike()).chain(fast).chain(self.warn_no_match()).collect()
    }

    /// Warns if the nearest references, without odometry, agree on a speed that is not modelled.
    fn warn_too_fast(&self) -> Option<Warning> {
        let n = self.recognizer.references();
        let speeds = self.recognizer.options().speeds.values().iter();
        let fastest = speeds.fold(0.0, |most: f64, speed| most.max(speed.abs()));
        let places: Vec<usize> = self.single.iter().map(|belief| belief.mode()).collect();
        // Where there is odometry, answers follow its speed, so only steps without it are examined.
        let steps = places.windows(2).zip(&self.controls[1.min(self.steps())..]);
        let free = steps.filter(|(_, control)| control.control.odometry.is_none());
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

    fn warn_unlike(&self) -> Option<Warning> {
        let [labelled, deviation] = self.recognizer.parameters().best_scores?;
        let unlike = |scores: &[f64]| {
            let [recording, _] = moments(scores)?;
            let unlike = (recording - labelled).abs() > UNLIKE * deviation;
            unlike.then_some(Warning::Unlike { labelled, recording })
        };
        let finite = |best: &f64| best.is_finite();
        let all: Vec<f64> = self.best_scores.iter().copied().filter(finite).collect();
        let warning = unlike(&all)?;
        if self.recognizer.options().off_map.is_none() {
            return Some(warning);
        }
        // Queries off the map match nothing, unlike labelled ones, so only those on the map count.
        // But if most are off it, the camera may be a different one.
        let beliefs = self.smoothed().ok()?;
        let scores = self.best_scores.iter().enumerate();
        let on_map = scores.filter(|(step, _)| beliefs.mass(*step, None) < 0.5);
        let on_map: Vec<f64> = on_map.map(|(_, best)| *best).filter(finite).collect();
        if on_map.len() < all.len() / 2 { Some(warning) } else { unlike(&on_map) }
    }

    /// Warns if odometry reads again and again that the vehicle moves at one speed, while the
    /// images alone say that it moves at another.
    fn warn_stuck(&self) -> Option<Warning> {
        let mut answers = Vec::new();
        let mut start = 0;
        // Each iteration takes one maximal run of equal readings; `max(1)` skips a NaN, which is
        // not even equal to itself.
        while start < self.steps() {
            let reading = self.controls[start].control.odometry;
            let equal =
                self.controls[start..].iter().take_while(|next| next.control.odometry == reading);
            let run = start..start + equal.count().max(1);
            start = run.end;
            let Some(reading) = reading.filter(|reading| reading.abs() > STANDS) else { continue };
            if run.len() <= EQUAL as usize {
                continue;
            }
            if answers.is_empty() {
                answers = self.without_odometry().ok()?;
            }
            if self.contradicted(reading, &answers[run.clone()]) {
                return Some(Warning::Stuck { reading, steps: run.len() as u32 });
            }
        }
        None
    }

    /// True if answers often move on farther than a reading that stays the same says, or less far.
    fn contradicted(&self, reading: f64, answers: &[Answer]) -> bool {
        let OdometryModel { scale, bias, .. } = self.recognizer.options().odometry;
        let driven = f64::from(EQUAL) * (reading - bias) / scale;
        let sure = |answer: &Answer| -> Option<f64> {
            let place = answer.place.filter(|_| answer.probability > SURE)?;
            Some(place as f64)
        };
        let ends: Vec<Option<f64>> = answers.iter().step_by(EQUAL as usize).map(sure).collect();
        let (mut judged, mut against) = (0, 0);
        for pair in ends.windows(2) {
            let [Some(before), Some(after)] = *pair else { continue };
            let difference = (self.recognizer.places_between(before, after) - driven).abs();
            judged += 1;
            against += usize::from(difference > DIFFERENCE.max(DIFFERENCE_SHARE * driven.abs()));
        }
        // A single contradiction may come from a wrong answer.
        against > 1 && 4 * against > judged
    }

    /// Answers of the filter by images alone.
    fn without_odometry(&self) -> Result<Vec<Answer>, RecognitionError> {
        let mut filter = self.recognizer.model.filter();
        let mut places = vec![0.0; self.recognizer.places()];
        let answer = |(control, likelihoods): (&Distraction<RouteControl>, &Vec<f64>)| {
            let route = RouteControl { odometry: None, ..control.control };
            let control = Distraction { control: route, ..*control };
            let log = filter.step_with(&control, likelihoods)?;
            self.recognizer.marginalize_places(filter.belief().as_slice(), &mut places);
            Ok(self.recognizer.answer(&places, log))
        };
        self.controls.iter().zip(&self.likelihoods).map(answer).collect()
    }

    /// Warns if, over a span of new frames, the filter predicts the images hardly better than chance:
    /// the mean of the odds over places is one.
    fn warn_no_match(&self) -> Option<Warning> {
        if self.recognizer.options().off_map.is_some() {
            return None;
        }
        let mut filter = self.recognizer.model.filter();
        let (mut sums, mut steps) = (vec![0.0], Vec::new());
        for (step, (control, likelihoods)) in (1..).zip(self.controls.iter().zip(&self.likelihoods))
        {
            filter.predict_with(control).ok()?;
            let log = filter.update(likelihoods).ok()?;
            if self.attentive[step - 1].is_some() {
                sums.push(sums[steps.len()] + log);
                steps.push(step);
            }
        }
        let frames = steps.len().min(SPAN);
        if frames < FEWEST {
            return None;
        }
        // The mean over each span of `frames` new frames is a difference of running sums.
        let means = sums.iter().zip(&sums[frames..]).map(|(from, to)| (to - from) / frames as f64);
        let spans = means.zip(&steps[frames - 1..]);
        let (mean, step) = spans.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (mean < SUSPECT).then_some(Warning::Nothing { mean, step: *step, frames })
    }
}

/// Mean and standard deviation; `None` for no values.
fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (count > 0.0).then(|| [mean, square.sqrt()])
}
