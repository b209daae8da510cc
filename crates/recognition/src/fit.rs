//! Learning from labelled parts of drives: usual scores first, then speeds, odometry and rates from
//! the labels alone. What was learned is kept if it does no harm on steps that it was not learned
//! from.

use std::ops::RangeInclusive;

use super::parameters::Parameters;
use super::recognizer::check_control;
use super::sensor::Scratch;
use super::warning::Warning;
use super::{RecognitionError, Recognizer};
use crate::motion::{OdometryModel, OffMap, RouteControl};
use crate::observation::{RowScratch, ViewError, row_scores};
use wayfix::error::OutOfRange;

/// Consecutive steps of a drive whose places are known.
#[derive(Debug)]
pub struct LabelledPart<'a, Q> {
    /// Queries, as [`Recognizer::recording`] takes them.
    pub queries: &'a [Q],
    /// References that show the place of each query, or `None` if it is off the map.
    pub places: &'a [Option<RangeInclusive<usize>>],
    /// Odometry reading of the way before each query; empty if there are none.
    pub odometry: &'a [Option<f64>],
}

// Derived impls would require `Q: Clone` and `Q: Copy`.
impl<Q> Clone for LabelledPart<'_, Q> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Q> Copy for LabelledPart<'_, Q> {}

impl<Q> LabelledPart<'_, Q> {
    /// Cuts out the steps from `first` to before `end`.
    pub(super) fn cut(&self, first: usize, end: usize) -> Self {
        let odometry = self.odometry.get(first..end).unwrap_or(&[]);
        Self { queries: &self.queries[first..end], places: &self.places[first..end], odometry }
    }
}

/// Number of first steps of a part that are not scored: the filter is not sure at once.
const BURN_IN: usize = 10;
/// Number of labelled steps of a half below which learning is not checked.
const HALF: usize = 30;
/// Least probability of a label that counts, so that a vehicle that is lost decides no comparison.
const LEAST: f64 = 1e-3;
/// Loss of mean log score up to which learning does no harm, in nats: scores of halves differ by as
/// much by chance.
const HARM: f64 = 0.01;
/// Probability of a label below which the filter contradicts it, and share of such labels above
/// which a warning is given. On drives with right labels the share was 0.42 at most.
const UNLIKELY: f64 = 0.1;
const CONTRADICTED_SHARE: f64 = 0.6;

/// Prior counts, in steps, of the present rates of leaving the map and of coming back.
const LEAVE_COUNT: f64 = 333.0;
const BACK_COUNT: f64 = 33.0;

/// Moves and readings by the labels of a part.
pub(super) struct Labels {
    /// Places moved at each step between two steps labelled on the map.
    pub(super) moves: Vec<f64>,
    /// Moves for which odometry has a reading, each with the reading.
    pub(super) read: Vec<(f64, f64)>,
}

impl Recognizer {
    /// Learns from labelled parts of drives.
    ///
    /// Learns the shares, the changes and the slack of speeds, odometry, the rates of leaving the
    /// map, and the usual scores of each reference. Learning starts from the present options;
    /// everything else learned before is replaced.
    ///
    /// What was learned from one half of each part is then compared with the present parameters on
    /// the other half, by the mean log score of the filter. If it is worse there by more than 0.01,
    /// the present parameters stay, with a [`Warning::Harm`]. [`Parameters::warnings`] lists it with other
    /// warnings. O(steps n k) time, O(steps n) memory.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for queries or labels that are not valid, or fewer than two
    /// steps in a row on the map.
    pub fn fit<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Self, RecognitionError> {
        let fitted = self.fit_once(parts)?;
        let Some([present, learned, share]) = self.held_out_scores(parts)? else {
            return Ok(fitted);
        };
        let mut fit = fitted.parameters().clone();
        fit.warnings
            .extend((share > CONTRADICTED_SHARE).then_some(Warning::Contradicted { share }));
        if learned >= present - HARM {
            return self.with_parameters(fit);
        }
        let mut kept = self.parameters().clone();
        kept.warnings = fit.warnings;
        kept.warnings.push(Warning::Harm { present, learned });
        self.with_parameters(kept)
    }

    /// Mean log scores of the filter on each half of the parts, by the present parameters and by
    /// those learned from the other half, and the share of labels to which the latter give less
    /// than 0.1; `None` for too few labels.
    fn held_out_scores<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Option<[f64; 3]>, RecognitionError> {
        let mut halves: [Vec<LabelledPart<'_, Q>>; 2] = [Vec::new(), Vec::new()];
        for part in parts {
            let middle = part.queries.len() / 2;
            let (first, last) = (part.cut(0, middle), part.cut(middle, part.queries.len()));
            halves[0].push(first);
            halves[1].push(last);
        }
        let long = |half: &Vec<LabelledPart<'_, Q>>| {
            let steps = half.iter().map(|part| part.places.len().saturating_sub(BURN_IN));
            steps.sum::<usize>() >= HALF && self.check_labels(half).is_ok()
        };
        if !halves.iter().all(long) {
            return Ok(None);
        }
        let (mut sums, mut steps, mut unlikely) = ([0.0; 2], 0.0, 0.0);
        for (half, other) in [(0, 1), (1, 0)] {
            let learned = self.fit_once(&halves[other])?;
            let present = self.label_masses(&halves[half])?;
            let learned = learned.label_masses(&halves[half])?;
            for (present, learned) in present.into_iter().zip(learned) {
                sums[0] += present.max(LEAST).ln();
                sums[1] += learned.max(LEAST).ln();
                unlikely += f64::from(u8::from(learned < UNLIKELY));
                steps += 1.0;
            }
        }
        Ok(Some([sums[0] / steps, sums[1] / steps, unlikely / steps]))
    }

    /// Probabilities that the filter gives to labels, without the first steps of each part.
    fn label_masses<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Vec<f64>, RecognitionError> {
        let mut masses = Vec::new();
        for part in parts {
            let beliefs = self.recording(part.queries, part.odometry)?.filtered();
            for (at, places) in part.places.iter().enumerate().skip(BURN_IN) {
                let beside = |range: &RangeInclusive<usize>| {
                    range.start().saturating_sub(1)..=range.end().saturating_add(1)
                };
                masses.push(beliefs.mass(at, places.as_ref().map(beside).as_ref()));
            }
        }
        Ok(masses)
    }

    /// Learns from all labels, without a comparison.
    fn fit_once<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Self, RecognitionError> {
        self.check_labels(parts)?;
        let mut rows = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            let invalid = |error: RecognitionError| error.of_part(number);
            rows.push(self.compare(*part).map_err(invalid)?);
        }
        // Usual scores come first, since the warnings below examine scores with them.
        let mut fit = Parameters::new(self.options().clone());
        self.fit_camera(&rows, &mut fit)?;
        let labels: Vec<Labels> = parts.iter().map(|part| self.read(part)).collect();
        let drives: Vec<&[f64]> = labels.iter().map(|part| &part.moves[..]).collect();
        fit.options.speeds = fit.options.speeds.fit(&drives)?;
        let (moves, read): (Vec<f64>, Vec<f64>) =
            labels.iter().flat_map(|part| part.read.iter().copied()).unzip();
        let has_odometry = moves.len() > 1;
        if has_odometry {
            fit.options.odometry = OdometryModel::fit(&[(moves, read)])?;
        }
        fit.options.off_map = fit.options.off_map.map(|before| rates(before, parts));
        let fitted = self.with_parameters(fit.clone())?;
        let wrong = |cause| RecognitionError::query(0, cause);
        fit.warnings = fitted.examine(parts, &rows).map_err(wrong)?;
        fit.warnings.extend(fitted.examine_drives(parts, has_odometry));
        self.with_parameters(fit)
    }

    fn fit_camera(
        &self,
        rows: &[Vec<Vec<f32>>],
        fit: &mut Parameters,
    ) -> Result<(), RecognitionError> {
        let wrong = |cause| RecognitionError::query(0, cause);
        let mut sensor = self.with_parameters(fit.clone())?.sensor;
        let mut scratch = Scratch::default();
        for part in rows {
            for row in part {
                sensor.learn_row(&fit.options, row, &mut scratch).map_err(wrong)?;
            }
            // Parts are separate drives: the first view of one does not continue the last of
            // another.
            sensor.forget();
        }
        fit.standardizer = fit.options.standardize.then_some(sensor.standardizer);
        Ok(())
    }

    pub(super) fn check_labels<Q>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<(), RecognitionError> {
        let references = self.references();
        let (mut found, mut pairs) = (0, 0);
        for (number, part) in parts.iter().enumerate() {
            let expected = part.queries.len();
            let counts = [
                ("the number of labels", part.places.len(), true),
                ("the number of odometry readings", part.odometry.len(), !part.odometry.is_empty()),
            ];
            for (what, count, needed) in counts {
                if needed && count != expected {
                    return Err(OutOfRange::count(what, count, expected).into());
                }
            }
            for (step, places) in part.places.iter().enumerate() {
                let Some(places) = places else { continue };
                let place = *places.end();
                if place >= references || places.is_empty() {
                    let part = number;
                    return Err(RecognitionError::Label { part, step, place, references });
                }
                found += 1;
                pairs += usize::from(step > 0 && part.places[step - 1].is_some());
            }
        }
        if pairs == 0 { Err(RecognitionError::FewLabels { found }) } else { Ok(()) }
    }

    /// Returns the distances of each query to each reference. Checks all queries and readings,
    /// since learning uses only some of them.
    pub(super) fn compare<Q: AsRef<[f32]>>(
        &self,
        part: LabelledPart<'_, Q>,
    ) -> Result<Vec<Vec<f32>>, RecognitionError> {
        let (mut rows, mut more, mut scores) = (Vec::new(), Vec::new(), Vec::new());
        let mut scratch = RowScratch::default();
        for (at, query) in part.queries.iter().enumerate() {
            let (step, mut row) = (at + 1, Vec::new());
            self.references.distances(step, query.as_ref(), &mut row, &mut more)?;
            let invalid = |cause| RecognitionError::query(step, cause);
            self.sensor.standardizer.check(&row).map_err(invalid)?;
            let compared = row_scores(&row, &mut scores, &mut scratch).map_err(invalid)?;
            if compared == 0 && self.options().off_map.is_none() {
                return Err(invalid(ViewError::NoMatch));
            }
            let odometry = part.odometry.get(at).copied().flatten();
            let control = RouteControl { odometry, ..RouteControl::default() };
            check_control(self.motion(), step, &control)?;
            rows.push(row);
        }
        Ok(rows)
    }

    pub(super) fn read<Q>(&self, part: &LabelledPart<'_, Q>) -> Labels {
        // A label that spans several references stands for their middle, so moves may be
        // half-integers.
        let middle = |at: usize| {
            let places = part.places[at].as_ref()?;
            Some(0.5 * (*places.start() as f64 + *places.end() as f64))
        };
        let mut labels = Labels { moves: Vec::new(), read: Vec::new() };
        for at in 1..part.places.len() {
            let (Some(before), Some(after)) = (middle(at - 1), middle(at)) else { continue };
            let moved = self.places_between(before, after);
            labels.moves.push(moved);
            if let Some(reading) = part.odometry.get(at).copied().flatten() {
                labels.read.push((moved, reading));
            }
        }
        labels
    }
}

/// Rates of leaving the map and coming back, learned if a label is off the map: posterior means
/// with the present rates as prior counts.
pub(super) fn rates<Q>(before: OffMap, parts: &[LabelledPart<'_, Q>]) -> OffMap {
    let (mut left, mut on) = (before.leave * LEAVE_COUNT, LEAVE_COUNT);
    let (mut returned, mut off) = (before.back * BACK_COUNT, BACK_COUNT);
    for part in parts {
        for pair in part.places.windows(2) {
            match (&pair[0], &pair[1]) {
                (Some(_), after) => {
                    on += 1.0;
                    left += f64::from(u8::from(after.is_none()));
                }
                (None, after) => {
                    off += 1.0;
                    returned += f64::from(u8::from(after.is_some()));
                }
            }
        }
    }
    // Without a label off the map the rates stay: one drive does not show that the vehicle never
    // leaves.
    let off_map = parts.iter().any(|part| part.places.iter().any(Option::is_none));
    if off_map { OffMap { leave: left / on, back: returned / off, ..before } } else { before }
}
