//! Live tracking: a filter, the sensor's state, the place that a distracted camera follows, and the
//! belief over places after the last step. A step that fails changes none of them.

use std::sync::Arc;

use super::recognizer::{Model, Phantom, check_control};
use super::sensor::{Positions, Scratch, Sensor, Sighting};
use super::warning::{FEWEST, UNSURE, Warning};
use super::{Answer, RecognitionError, Recognizer};
use crate::motion::RouteControl;
use wayfix::HmmError;
use wayfix::error::OutOfRange;
use wayfix::inference::FilterSnapshot;
use wayfix::internal::MOST_STEPS;
use wayfix::transition::Distraction;
use wayfix::{Belief, BeliefView, Filter};

/// A vehicle tracked step by step.
///
/// A step costs O(n k) for n references and k speeds, plus the comparison with the references; it
/// allocates nothing after the first two steps. `Send` and `Clone`.
#[derive(Debug, Clone)]
pub struct Track {
    recognizer: Recognizer,
    filter: Filter<Arc<Model>>,
    sensor: Sensor,
    phantom: Phantom,
    confidence: Confidence,
    scratch: Scratch,
    places: Vec<f64>,
    /// Probabilities of an attentive camera at each place, and of a distracted one.
    attentive: Vec<f64>,
    distracted: Vec<f64>,
    /// Probabilities of the phantom at each place, scratch memory for learning.
    followed: Vec<f64>,
}

/// Mean probability of the last answers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub(crate) struct Confidence {
    mean: f64,
    /// Number of answers, at most `FEWEST`: the mean fades over as many.
    answers: u32,
}

/// State of a [`Track`], as plain data to restore it from. With the feature `serde` it can be
/// stored, so that a position survives a restart.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackSnapshot {
    pub(crate) filter: FilterSnapshot,
    pub(crate) sensor: Sensor,
    pub(crate) phantom: Belief,
    pub(crate) confidence: Confidence,
}

impl Recognizer {
    /// Starts to track a vehicle, which may be anywhere at first.
    #[must_use]
    pub fn track(&self) -> Track {
        let mut track = Track {
            filter: Filter::new(Arc::clone(&self.model)),
            sensor: self.sensor.clone(),
            phantom: self.phantom.clone(),
            confidence: Confidence::default(),
            scratch: Scratch::default(),
            places: vec![0.0; self.places()],
            attentive: vec![0.0; self.references()],
            distracted: vec![0.0; self.references()],
            followed: vec![0.0; self.references()],
            recognizer: self.clone(),
        };
        track.marginalize_places();
        track
    }
}

impl TrackSnapshot {
    /// Number of steps taken.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.filter.steps()
    }

    /// Number of references of the track.
    #[must_use]
    pub fn references(&self) -> usize {
        self.sensor.standardizer.references()
    }
}

impl Track {
    /// Takes the next query, a descriptor or a row of distances as the recogniser was made for. For a
    /// lost frame, call [`predict`](Self::predict).
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if the query is not valid, or impossible; the track is then as before.
    pub fn step(&mut self, query: &[f32]) -> Result<Answer, RecognitionError> {
        self.step_with(None::<f64>, query)
    }

    /// Takes the distance driven since the last step by odometry, in references, and the next query,
    /// as [`step`](Self::step) does. The distance is a number, or `None` without a reading.
    ///
    /// A wheel slip does little harm, and equal readings in a row (wheels that are stuck, a unit that
    /// stopped counting) count less and less; those of a vehicle that stands do only while its views
    /// change. Still, give `None` while odometry is known to be wrong.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if the query or the reading is not valid, or impossible; the
    /// track is then as before.
    pub fn step_with(
        &mut self,
        odometry: impl Into<Option<f64>>,
        query: &[f32],
    ) -> Result<Answer, RecognitionError> {
        let sighting = self.observe(odometry.into(), query)?;
        let log_likelihood = self.advance(&sighting.control)?;
        self.learn(&sighting);
        Ok(self.answer(log_likelihood))
    }

    /// Answer from the present belief, with a log-likelihood of 0.
    pub(super) fn present(&self) -> Answer {
        self.recognizer.answer(&self.places, 0.0)
    }

    /// Answers from the belief over places.
    fn answer(&mut self, log_likelihood: f64) -> Answer {
        let answer = self.recognizer.answer(&self.places, log_likelihood);
        let Confidence { mean, answers } = &mut self.confidence;
        *answers = (*answers + 1).min(FEWEST);
        *mean += (answer.probability - *mean) / f64::from(*answers);
        answer
    }

    /// Compares a query with the references; changes scratch memory and the phantom's proposal alone.
    pub(super) fn observe(
        &mut self,
        odometry: Option<f64>,
        query: &[f32],
    ) -> Result<Sighting, RecognitionError> {
        let (step, attentive) = (self.filter.steps().saturating_add(1), self.attentive());
        let Self { recognizer, sensor, phantom, scratch, .. } = self;
        sensor.observe(recognizer, step, (query, odometry), attentive, phantom, scratch)
    }

    /// Learns from a query after the filter has taken the step.
    pub(super) fn learn(&mut self, sighting: &Sighting) {
        self.phantom.accept();
        if sighting.is_new() {
            let Self { phantom, distracted, followed, .. } = self;
            let distracted: f64 = distracted.iter().sum();
            phantom.transition().marginalize_places(phantom.belief().as_slice(), followed);
            followed.iter_mut().for_each(|p| *p *= distracted);
        }
        let Self { recognizer, sensor, scratch, attentive, followed, .. } = self;
        sensor.learn(recognizer, sighting, Positions { attentive, phantom: followed }, scratch);
    }

    /// Probability of an attentive camera on the map.
    pub(super) fn attentive(&self) -> f64 {
        self.attentive.iter().sum::<f64>().clamp(0.0, 1.0)
    }

    /// State of the sensor.
    pub(super) fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// What the last step left in the scratch memory of the sensor.
    pub(super) fn scratch(&self) -> &Scratch {
        &self.scratch
    }

    /// Takes a step without a query, for a lost frame: the motion alone. The next view then counts as
    /// the first after a gap: its change is not evidence of moving or standing.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] beyond the largest number of steps; the track is then as before.
    pub fn predict(&mut self) -> Result<Answer, RecognitionError> {
        self.predict_with(None::<f64>)
    }

    /// Takes a step without a query, as [`predict`](Self::predict), with the distance driven since the
    /// last step by odometry, in references.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if the reading is not valid; the track is then as before.
    pub fn predict_with(
        &mut self,
        odometry: impl Into<Option<f64>>,
    ) -> Result<Answer, RecognitionError> {
        let odometry = odometry.into();
        let control = Distraction::none(self.sensor.control(None, odometry));
        // The filter checks all controls but the first, since no move leads to the first step.
        check_control(self.recognizer.motion(), self.steps() + 1, &control.control)?;
        // A likelihood of 1 everywhere: an update that changes nothing.
        self.scratch.fill(self.recognizer.references());
        let distracted = 1.0 - self.attentive();
        let is_first = self.steps() == 0;
        let log_likelihood = self.advance(&control)?;
        if !is_first {
            // The filter has accepted the control, so this does not fail.
            self.phantom.predict(&control.control, distracted)?;
        }
        let Self { recognizer, sensor, .. } = self;
        sensor.skip(recognizer.motion(), recognizer.options(), &control.control, odometry);
        Ok(self.answer(log_likelihood))
    }

    /// Takes a step of the filter with the likelihoods in the scratch memory.
    pub(super) fn advance(
        &mut self,
        control: &Distraction<RouteControl>,
    ) -> Result<f64, RecognitionError> {
        let log_likelihood = self.filter.step_with(control, &self.scratch.likelihoods)?;
        self.marginalize_places();
        Ok(log_likelihood)
    }

    /// Belief over places, with a last entry for off the map if that is modelled.
    #[must_use]
    pub fn places(&self) -> BeliefView<'_> {
        Belief::view(&self.places)
    }

    /// Number of steps taken.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.filter.steps()
    }

    /// Log-likelihood of all queries and measurements.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.filter.log_likelihood()
    }

    /// Recogniser of the track.
    #[must_use]
    pub fn recognizer(&self) -> &Recognizer {
        &self.recognizer
    }

    /// Returns warnings about the last steps: odometry that is [stuck](Warning::Stuck) while the views
    /// change, and answers that are [unsure](Warning::Unsure). Cheap enough for each step.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let Confidence { mean, answers: steps } = self.confidence;
        let unsure = Warning::Unsure { mean, step: self.steps(), steps: steps as usize };
        let unsure = (steps >= FEWEST && mean < UNSURE).then_some(unsure);
        self.sensor.readings.warning().into_iter().chain(unsure).collect()
    }

    /// Returns the state of the track. O(n k).
    #[must_use]
    pub fn snapshot(&self) -> TrackSnapshot {
        TrackSnapshot {
            filter: self.filter.snapshot(),
            sensor: self.sensor.clone(),
            phantom: self.phantom.belief().to_owned(),
            confidence: self.confidence,
        }
    }

    /// Restores a state, from a track of this recogniser or one with an equal fit: the next
    /// answers are then the same, to the bit.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a state with a different number of references or speeds, or at the
    /// largest number of steps; the track is then as before.
    pub fn restore(&mut self, state: &TrackSnapshot) -> Result<(), RecognitionError> {
        let TrackSnapshot { filter, sensor, phantom, confidence } = state;
        let expected = self.recognizer.references();
        let rows = sensor.last_view.as_ref().map(Vec::len);
        for found in [Some(state.references()), rows].into_iter().flatten() {
            if found != expected {
                let what = "the number of references of the state of a track";
                return Err(OutOfRange::count(what, found, expected).into());
            }
        }
        // The last step that may be taken is `MOST_STEPS`: a restored track must be able to go on.
        if filter.steps() >= MOST_STEPS {
            return Err(HmmError::TooMany { steps: filter.steps() }.into());
        }
        let mut restored = self.filter.clone();
        restored.restore(filter)?;
        self.phantom = self.recognizer.phantom.clone().with_belief(phantom.clone())?;
        self.filter = restored;
        self.sensor.clone_from(sensor);
        self.confidence = *confidence;
        self.marginalize_places();
        Ok(())
    }

    /// Extends the track to more references, which start with the present ones.
    pub(super) fn extended(&self, recognizer: &Recognizer) -> Result<Self, RecognitionError> {
        let (before, after) = (self.recognizer.references(), recognizer.references());
        let extended = |values: &[f64], nothing: f64| -> Vec<f64> {
            let new = std::iter::repeat_n(nothing, after - before);
            // A layer for each speed, and one for off the map, twice: each grows at its end. New
            // places have no mass until the motion leads there.
            let layers = values.chunks(before);
            layers.flat_map(|layer| layer.iter().copied().chain(new.clone())).collect()
        };
        // Without logarithms the list is empty, and stays empty.
        let filter = self.filter.snapshot();
        let filter = filter.remade(filter.steps(), extended);
        let sensor = self.sensor.extended(&recognizer.sensor);
        let phantom = Belief::from_weights(extended(self.phantom.belief().as_slice(), 0.0))?;
        let mut track = recognizer.track();
        let confidence = self.confidence;
        track.restore(&TrackSnapshot { filter, sensor, phantom, confidence })?;
        Ok(track)
    }

    /// Sets the number of steps taken, without evidence on them.
    pub(super) fn after(mut self, steps: usize) -> Result<Self, RecognitionError> {
        let mut state = self.snapshot();
        state.filter = state.filter.remade(steps, |values, _| values.to_vec());
        self.restore(&state)?;
        Ok(self)
    }

    /// Forgets the position and the last view, but nothing learned of the references.
    pub fn relocate(&mut self) {
        self.filter.restart();
        self.sensor.forget();
        self.phantom.restart();
        self.confidence = Confidence::default();
        self.marginalize_places();
    }

    fn marginalize_places(&mut self) {
        let Self { recognizer, filter, places, attentive, distracted, .. } = self;
        let belief = filter.belief();
        let off =
            recognizer.marginalize_modes(belief.as_slice(), [&mut *attentive, &mut *distracted]);
        recognizer.combine_modes([attentive, distracted], off, places);
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] TrackSnapshot: [], |state| {
        filter: FilterSnapshot = state.filter,
        standardizer: crate::observation::Standardizer = state.sensor.standardizer,
        last_view: Option<Vec<Option<f32>>> =
            state.sensor.last_view.as_ref().map(|row| row.iter().map(finite).collect::<Vec<_>>()),
        run: Option<(Option<crate::motion::ViewChange>, u32)> = state.sensor.run,
        still: f64 = state.sensor.still,
        lingering: f64 = state.sensor.lingering,
        driven: Option<crate::motion::Driven> = state.sensor.driven,
        readings: crate::readings::Readings = state.sensor.readings,
        kinds: [[f64; 3]; 2] = state.sensor.kinds,
        advantage: crate::advantage::Advantage = state.sensor.advantage,
        phantom: Belief = state.phantom,
        confidence: Confidence = state.confidence,
    } => Self::from_parts(
        filter,
        Sensor {
            standardizer,
            last_view: last_view.map(|row| row.into_iter().map(infinite).collect()),
            run,
            still,
            lingering,
            driven,
            readings,
            kinds,
            advantage,
        },
        phantom,
        confidence,
    );
}

/// A finite score, or `None`, since JSON has no infinity.
#[cfg(feature = "serde")]
#[expect(clippy::trivially_copy_pass_by_ref, reason = "an iterator gives it so")]
fn finite(distance: &f32) -> Option<f32> {
    Some(*distance).filter(|distance| distance.is_finite())
}

#[cfg(feature = "serde")]
fn infinite(distance: Option<f32>) -> f32 {
    distance.unwrap_or(f32::INFINITY)
}

#[cfg(feature = "serde")]
impl TrackSnapshot {
    /// Creates a snapshot from parts read from storage, which it checks.
    fn from_parts(
        filter: FilterSnapshot,
        sensor: Sensor,
        phantom: Belief,
        confidence: Confidence,
    ) -> Result<Self, String> {
        let Sensor { still, lingering, run, last_view, kinds, .. } = &sensor;
        if !(0.0..=2.0).contains(still) {
            return Err(format!("an unchanged view by up to {still}, expected from 0 to 2"));
        }
        if !(0.0..=1.0).contains(lingering) {
            return Err(format!("a share of lingering views of {lingering}, expected from 0 to 1"));
        }
        if run.is_some_and(|(_, count)| count == 0) {
            return Err("a run of 0 views, expected at least 1".into());
        }
        for value in last_view.iter().flatten() {
            if value.is_nan() || *value == f32::NEG_INFINITY {
                return Err(format!(
                    "a score of {value} in the last view, expected a number or null"
                ));
            }
        }
        for kinds in kinds {
            // Below this share, 32-bit floats lose the views that say nothing.
            let least = 1e-30 * kinds.iter().sum::<f64>();
            if !(kinds.iter().all(|kind| (0.0..=1e15).contains(kind)) && kinds[0] > least) {
                return Err(format!(
                    "{kinds:?} views of each kind, expected counts, the first above 0"
                ));
            }
        }
        if let Some(driven) = sensor.driven {
            driven.check().map_err(|error| error.to_string())?;
        }
        let (readings, advantage) = (sensor.readings.checked()?, sensor.advantage.checked()?);
        let sensor = Sensor { readings, advantage, ..sensor };
        if !(0.0..=1.0).contains(&confidence.mean) || confidence.answers > FEWEST {
            return Err(format!(
                "{confidence:?}, expected a mean of at most {FEWEST} probabilities"
            ));
        }
        Ok(Self { filter, sensor, phantom, confidence })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;
    use crate::observation::Distance;

    #[test]
    fn more_references_take_nothing_away() {
        let image = |place: usize| -> Vec<f32> {
            (1..17).map(|k| ((place * 16 + k).pow(2) as f32 * 0.37).sin()).collect()
        };
        let images: Vec<Vec<f32>> = (0..80).map(image).collect();
        let of = |count: usize| {
            Recognizer::from_descriptors(&images[..count], Distance::Cosine, Options::default())
        };
        let mut track = of(60).unwrap().track().after(7).unwrap();
        for image in &images[10..30] {
            track.step_with(1.0, image).unwrap();
        }
        let mut more = track.extended(&of(80).unwrap()).unwrap();
        assert_eq!((more.steps(), more.log_likelihood()), (27, track.log_likelihood()));
        let places = more.places().as_slice().iter().zip(track.places().as_slice());
        // But for a lost vehicle, which may be at any of more places.
        assert!(places.map(|(a, b)| (a - b).abs()).all(|apart| apart < 1e-5));
        let (before, after) = (&track.sensor, &more.sensor);
        assert_eq!(before.run, after.run);
        assert_eq!(before.readings, after.readings);
        let view = |sensor: &Sensor| sensor.last_view.clone().unwrap();
        assert_eq!(view(before)[..], view(after)[..60]);
        assert_eq!(after.standardizer.references(), 80);
        // A repeated view is not new.
        let last = view(after);
        let answer = more.step_with(0.0, &images[29]).unwrap();
        assert!(answer.place.is_some_and(|place| place.abs_diff(29) <= 1));
        assert_eq!(view(&more.sensor), last);
        let error = more.step(&[f32::NAN; 16]).unwrap_err().to_string();
        assert!(error.starts_with("the descriptor of the query of step 29 "), "{error}");
    }
}
