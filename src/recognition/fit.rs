//! Learning from labelled parts of drives.

use super::calibrate::Calibrated;
use super::labels::{LabelledPart, Labels, rates};
use super::warning::Warning;
use super::{Options, RecognitionError, Recognizer};
use crate::motion::OdometryModel;
use crate::observation::{ObservationError, Standardizer, ViewComparison, alike_stretches};

/// Result of learning: the options of a [`Recognizer`], and what it knows of single references.
/// With the feature `serde` it can be stored. Equal if what was learned is, whatever the
/// warnings, which are not stored.
#[derive(Debug, Clone)]
pub struct Fit {
    pub(crate) options: Options,
    pub(crate) standardizer: Option<Standardizer>,
    pub(crate) stretches: Option<Vec<usize>>,
    /// The mean and the deviation of the best score of a query.
    pub(crate) best_scores: Option<[f64; 2]>,
    warnings: Vec<Warning>,
    calibrated: Option<Calibrated>,
}

impl PartialEq for Fit {
    fn eq(&self, other: &Self) -> bool {
        self.options == other.options
            && self.standardizer == other.standardizer
            && self.stretches == other.stretches
            && self.best_scores == other.best_scores
    }
}

impl Fit {
    pub(super) fn new(options: Options) -> Self {
        Self {
            options,
            standardizer: None,
            stretches: None,
            best_scores: None,
            warnings: Vec::new(),
            calibrated: None,
        }
    }

    /// The stored part.
    #[cfg(feature = "serde")]
    pub(crate) fn from_parts(
        options: Options,
        standardizer: Option<Standardizer>,
        stretches: Option<Vec<usize>>,
        best_scores: Option<[f64; 2]>,
    ) -> Result<Self, RecognitionError> {
        options.check()?;
        if let Some([mean, deviation]) = best_scores {
            let named = [
                ("the mean of the best scores", mean, mean.is_finite(), "a finite value"),
                (
                    "the deviation of the best scores",
                    deviation,
                    deviation.is_finite() && deviation >= 0.0,
                    "a finite value of at least 0",
                ),
            ];
            if let Some(&(what, value, _, expected)) = named.iter().find(|named| !named.2) {
                return Err(RecognitionError::Parameter { what, value, expected });
            }
        }
        Ok(Self { standardizer, stretches, best_scores, ..Self::new(options) })
    }

    /// The options, with what was learned.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The same with other options.
    #[must_use]
    pub fn with_options(self, options: Options) -> Self {
        Self { options, ..self }
    }

    /// The same without what it knows of single references: for another map.
    #[must_use]
    pub fn without_references(self) -> Self {
        Self { standardizer: None, stretches: None, best_scores: None, ..self }
    }

    /// Reasons to doubt it. Empty after it was stored.
    #[must_use]
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Choice of the temperature, if there was one; `None` after it was stored.
    #[must_use]
    pub fn calibrated(&self) -> Option<&Calibrated> {
        self.calibrated.as_ref()
    }

    /// The stretch of each reference, if it is known: those of one look alike.
    #[must_use]
    pub fn stretches(&self) -> Option<&[usize]> {
        self.stretches.as_deref()
    }

    pub(super) fn standardizer(&self) -> Option<&Standardizer> {
        self.standardizer.as_ref()
    }

    /// Valid, and for this many references.
    pub(super) fn checked(self, references: usize) -> Result<Self, RecognitionError> {
        self.options.check()?;
        if references == 0 {
            return Err(RecognitionError::Count { what: "references", found: 0, expected: 1 });
        }
        let other = |count: usize| count != references;
        let known = self.standardizer.as_ref().is_some_and(|s| other(s.references()))
            || self.stretches.as_ref().is_some_and(|s| other(s.len()));
        Ok(if known { self.without_references() } else { self })
    }
}

impl Recognizer {
    /// Learns from labelled parts: how speeds are used and change, odometry, how often the
    /// vehicle leaves the map, what counts as a change of view, which references look
    /// alike, and how each compares with queries; and whether another
    /// [temperature](crate::observation::MatchOdds) is better. What was learned before is
    /// replaced, but for the options, which are where learning starts.
    ///
    /// [`Fit::warnings`] tells what should make one doubt it. O(steps n k) time, and a
    /// few times that for the temperature; O(steps n) memory.
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
        let longest = rows.iter().max_by_key(|rows| rows.len());
        let threshold = longest.map_or(Ok(0.0), |rows| ViewComparison::threshold_of(rows))?;
        // Where nothing changes, or labels are too few to tell, what was there before.
        if threshold > 0.0 {
            fit.options.view_threshold = threshold;
        }
        let mut standardizer = self.shared_references().standardizer()?;
        let mut new = Vec::new();
        for part in rows {
            let mut views = ViewComparison::new(fit.options.view_threshold)?;
            for row in part {
                if views.next(row)? == crate::motion::ViewChange::Changed {
                    standardizer.observe(row)?;
                    new.push(row);
                }
            }
        }
        fit.stretches = Some(alike_stretches(&new)?);
        fit.standardizer = fit.options.standardize.then_some(standardizer);
        Ok(())
    }
}
