//! Learning from labelled parts of drives.

use super::labels::{LabelledPart, Labels, rates};
use super::parameters::Parameters;
use super::sensor::Scratch;
use super::{RecognitionError, Recognizer};
use crate::motion::OdometryModel;

impl Recognizer {
    /// Learns from labelled parts of drives.
    ///
    /// Learned are the use, the changes and the slack of speeds, odometry, the rates of leaving the
    /// map, the usual scores of each reference, and
    /// the [temperature](crate::observation::MatchOdds), by its log score on each half of the parts
    /// with what was learned from the other. Learning starts from the present options; everything
    /// else learned before is replaced.
    ///
    /// [`Parameters::doubts`] lists reasons to doubt the result. O(steps n k) time, and ten times that
    /// for the temperature; O(steps n) memory.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for queries or labels that are not valid, or fewer than two
    /// steps in a row on the map.
    pub fn fit<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Self, RecognitionError> {
        let fitted = self.fit_at_temperature(parts)?;
        let mut fit = fitted.parameters().clone();
        let (options, temperature_scores, warnings) = self.fit_temperature(fit.options, parts)?;
        fit.options = options;
        fit.temperature_scores = temperature_scores;
        fit.warnings.extend(warnings);
        self.with_parameters(fit)
    }

    /// Learns all but the temperature.
    pub(super) fn fit_at_temperature<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Self, RecognitionError> {
        self.check_labels(parts)?;
        let mut rows = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            let invalid = |error: RecognitionError| error.of_part(number);
            rows.push(self.compare(*part).map_err(invalid)?);
        }
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
        (fit.warnings, fit.best_scores) = fitted.examine(parts, &rows).map_err(wrong)?;
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
            sensor.forget();
        }
        fit.standardizer = fit.options.standardize.then_some(sensor.standardizer);
        Ok(())
    }
}
