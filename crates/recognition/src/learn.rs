//! Learning how a vehicle drives without labels: the smoother's sure answers stand in for them.

use super::{RecognitionError, Recognizer, Recording};
use crate::motion::OdometryModel;
use wayfix::error::OutOfRange;

/// Smoothed answers with at least this probability are taken to be true.
const SURE: f64 = 0.9;

impl Recognizer {
    /// Learns the shares, the changes and the slack of speeds, odometry, and the usual scores of
    /// each reference from an unlabelled drive.
    ///
    /// Steps where the smoother is sure (0.9 or more within the [window](super::Options::window),
    /// not off the map) count as labelled: one round of hard expectation and maximisation (Celeux
    /// and Govaert 1992). It starts from the present fit, which counts as much as it does in
    /// [`Speeds::fit`](crate::motion::Speeds::fit). The usual scores are those at the end of the
    /// recording, which need no places.
    ///
    /// Costs as much as [`smoothed`](Recording::smoothed).
    ///
    /// ```
    /// use wayfix_recognition::{Options, Recognizer};
    ///
    /// # let row = |place: usize| -> Vec<f32> {
    /// #     (0..200).map(|i| 0.4 + 0.02 * ((i * 7 + place * 3) % 11) as f32 - 0.3 * f32::from(u8::from(i == place))).collect()
    /// # };
    /// // A drive at half the speed of the references', then a stop.
    /// let queries: Vec<Vec<f32>> = (20..200).map(|k| row((k / 2).min(80))).collect();
    /// let recognizer = Recognizer::from_distances(200, Options::default())?;
    /// let learned = recognizer.learn(&recognizer.recording(&queries, &[])?)?;
    /// let speeds = learned.options().speeds();
    /// assert!(speeds.shares()[speeds.nearest(0.5)] > 0.5);
    /// # Ok::<(), wayfix_recognition::RecognitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`RecognitionError::Parameter`] for a recording with a different number of references, or
    /// [`RecognitionError::Inference`] with the step that is impossible.
    pub fn learn(&self, recording: &Recording) -> Result<Self, RecognitionError> {
        let (found, expected) = (recording.recognizer.references(), self.references());
        if found != expected {
            return Err(OutOfRange::count("the number of references", found, expected).into());
        }
        let answers = recording.smoothed()?.answers();
        let sure = |at: usize| answers[at].place.filter(|_| answers[at].probability >= SURE);
        let mut drives: Vec<Vec<f64>> = vec![Vec::new()];
        let mut read = (Vec::new(), Vec::new());
        for at in 1..answers.len() {
            // A move needs two sure ends. A gap starts a new drive: nothing is known of the change
            // of speed across it.
            let (Some(before), Some(after)) = (sure(at - 1), sure(at)) else {
                drives.push(Vec::new());
                continue;
            };
            let moved = self.places_between(before as f64, after as f64);
            if let Some(drive) = drives.last_mut() {
                drive.push(moved);
            }
            if let Some(reading) = recording.readings[at] {
                read.0.push(moved);
                read.1.push(reading);
            }
        }
        let mut options = self.options().clone();
        options.speeds = options.speeds.fit(&drives)?;
        if read.0.len() > 1 {
            options.odometry = OdometryModel::fit(&[read])?;
        }
        let mut fit = self.parameters().clone().with_options(options);
        if self.options().standardize {
            fit.standardizer = Some(recording.standardizer.clone());
        }
        self.with_parameters(fit)
    }

    /// Signed number of places from one to another; around a loop, by the shorter way.
    pub(super) fn places_between(&self, before: f64, after: f64) -> f64 {
        let (n, ahead) = (self.references() as f64, after - before);
        let around = (ahead + 0.5 * n).rem_euclid(n) - 0.5 * n;
        if self.options().closed { around } else { ahead }
    }
}
