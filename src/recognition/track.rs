//! Following a vehicle live.

use std::sync::Arc;

use super::recognizer::Model;
use super::sensor::{Sensor, SensorState};
use super::{Answer, RecognitionError, Recognizer};
use crate::belief::{Belief, BeliefView};
use crate::inference::{Filter, FilterState};

/// A vehicle that is followed, step by step.
///
/// A step costs O(n k) for n references and k speeds, and the comparison with the
/// references; it allocates nothing after the first two. Sends and clones as any value.
#[derive(Debug, Clone)]
pub struct Track {
    recognizer: Recognizer,
    filter: Filter<Arc<Model>>,
    sensor: Sensor,
    likelihoods: Vec<f64>,
    places: Vec<f64>,
}

/// All that a [`Track`] knows: plain data, to be kept and restored. With the feature
/// `serde` it can be stored, so that a position survives a restart.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackState {
    pub(crate) filter: FilterState,
    pub(crate) sensor: SensorState,
}

impl TrackState {
    /// The number of steps taken.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.filter.steps()
    }

    /// The number of references that it is for.
    #[must_use]
    pub fn references(&self) -> usize {
        self.sensor.standardizer.references()
    }
}

impl Track {
    pub(super) fn new(recognizer: Recognizer) -> Self {
        let filter = Filter::new(Arc::clone(recognizer.model()));
        let sensor = recognizer.sensor_of_fit();
        let mut track = Self {
            filter,
            sensor,
            likelihoods: vec![1.0; recognizer.likelihoods()],
            places: vec![0.0; recognizer.places()],
            recognizer,
        };
        track.add_up();
        track
    }

    /// Takes the next query, a descriptor or a row of distances as the recogniser was made
    /// for, and how far the vehicle has driven by its wheels since the last one, in
    /// references, if that is known.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] if the query or the reading is not valid, or impossible; the
    /// track is then as before.
    pub fn step(
        &mut self,
        query: &[f32],
        odometry: Option<f64>,
    ) -> Result<Answer, RecognitionError> {
        let Self { recognizer, filter, sensor, likelihoods, .. } = self;
        let step = filter.steps() + 1;
        // A step that was sensed is possible: a vehicle may be lost, which rules out nothing.
        let control = sensor.sense(recognizer.seeing(), step, query, odometry, likelihoods)?;
        let log_likelihood = filter.step_with(&control, likelihoods)?;
        self.add_up();
        Ok(self.recognizer.answer(&self.places, log_likelihood))
    }

    /// The belief in places, with one off the map behind them if that is modelled.
    #[must_use]
    pub fn places(&self) -> BeliefView<'_> {
        Belief::view(&self.places)
    }

    /// The number of steps taken.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.filter.steps()
    }

    /// ln p of all that was seen and measured.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.filter.log_likelihood()
    }

    /// The recogniser.
    #[must_use]
    pub fn recognizer(&self) -> &Recognizer {
        &self.recognizer
    }

    /// Returns all that it knows. O(n k).
    #[must_use]
    pub fn snapshot(&self) -> TrackState {
        TrackState { filter: self.filter.snapshot(), sensor: self.sensor.state().clone() }
    }

    /// Continues from what a track knew, of this recogniser or one that was fitted alike:
    /// the next answers are then the same, to the bit.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for a state of another number of references or speeds; the
    /// track is then as before.
    pub fn restore(&mut self, state: &TrackState) -> Result<(), RecognitionError> {
        let TrackState { filter, sensor } = state;
        let expected = self.recognizer.references();
        let rows = sensor.last_view.as_ref().map(Vec::len);
        for found in [Some(state.references()), rows].into_iter().flatten() {
            if found != expected {
                let what = "references of the state of a track";
                return Err(RecognitionError::Count { what, found, expected });
            }
        }
        self.filter.restore(filter)?;
        self.sensor.set_state(sensor.clone());
        self.add_up();
        Ok(())
    }

    /// The same vehicle among more references, the first of which are those of before.
    pub(super) fn among(&self, recognizer: Recognizer) -> Result<Self, RecognitionError> {
        let (before, after) = (self.recognizer.references(), recognizer.references());
        let mut belief = Vec::new();
        for layer in self.filter.belief().as_slice().chunks(before) {
            belief.extend_from_slice(layer);
            belief.resize(belief.len() + after - before, 0.0);
        }
        let mut track = Self::new(recognizer);
        track.filter.relocate(&Belief::known(belief))?;
        track.add_up();
        Ok(track)
    }

    /// Forgets where the vehicle is, but not what was learned of the references.
    pub fn relocate(&mut self) {
        self.filter.restart();
        self.add_up();
    }

    fn add_up(&mut self) {
        let Self { recognizer, filter, places, .. } = self;
        recognizer.add_up(filter.belief().as_slice(), places);
    }
}
