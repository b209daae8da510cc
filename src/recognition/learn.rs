//! Learning from labelled parts of drives.

use super::fit::Fit;
use super::labels::{LabelledPart, Labels, rates};
use super::{RecognitionError, Recognizer};
use crate::motion::OdometryModel;
use crate::observation::{ObservationError, alike_stretches};

impl Recognizer {
    /// Learns from labelled parts of drives.
    ///
    /// Learned are the use and the changes of speeds, odometry, the rates of leaving the map, the
    /// threshold for changes of the view, the stretches of references that look alike, the usual
    /// scores of each reference, and another [temperature](crate::observation::MatchOdds) if that
    /// is better. Learning starts from the present options; everything else learned before is
    /// replaced.
    ///
    /// [`Fit::doubts`] lists reasons to doubt the result. O(steps n k) time, and a few times
    /// that for the temperature; O(steps n) memory.
    ///
    /// # Errors
    ///
    /// [`RecognitionError`] for queries or labels that are not valid, or fewer than two
    /// steps in a row on the map.
    pub fn fitted<Q: AsRef<[f32]>>(
        &self,
        parts: &[LabelledPart<'_, Q>],
    ) -> Result<Self, RecognitionError> {
        self.check_labels(parts)?;
        let mut rows = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            let invalid =
                |source| RecognitionError::Part { part: number, source: Box::new(source) };
            rows.push(self.compare(*part).map_err(invalid)?);
        }
        let mut fit = Fit::new(self.options().clone());
        let wrong = |source| RecognitionError::Query { step: 0, source };
        self.fit_camera(&rows, &mut fit).map_err(wrong)?;
        let labels: Vec<Labels> = parts.iter().map(|part| self.read(part)).collect();
        let drives: Vec<&[f64]> = labels.iter().map(|part| &part.moves[..]).collect();
        fit.options.speeds = fit.options.speeds.learned(&drives)?;
        let (moves, read): (Vec<f64>, Vec<f64>) =
            labels.iter().flat_map(|part| part.read.iter().copied()).unzip();
        let has_odometry = moves.len() > 1;
        if has_odometry {
            fit.options.odometry = OdometryModel::learned(&[(moves, read)])?;
        }
        fit.options.off_map = fit.options.off_map.map(|before| rates(before, parts));
        let fitted = self.with_fit(fit.clone())?;
        (fit.warnings, fit.best_scores) = fitted.examine(parts, &rows).map_err(wrong)?;
        fit.warnings.extend(fitted.examine_drives(parts, has_odometry));
        let (options, calibrated, edge) = fitted.calibrate(parts)?;
        fit.options = options;
        fit.calibrated = calibrated;
        fit.warnings.extend(edge);
        self.with_fit(fit)
    }

    fn fit_camera(&self, rows: &[Vec<Vec<f32>>], fit: &mut Fit) -> Result<(), ObservationError> {
        let mut new = Vec::new();
        let mut sensor = self
            .with_fit(fit.clone().without_references())
            .map(|r| r.sensor_of_fit())
            .expect("lab");
        for part in rows {
            for row in part {
                if sensor.see(&fit.options, row)? {
                    new.push(row);
                }
            }
            sensor.forget();
        }
        fit.stretches = Some(alike_stretches(&new)?);
        fit.standardizer = fit.options.standardize.then(|| sensor.standardizer().clone());
        Ok(())
    }
}
