//! Many drives, one after another.

use std::ops::ControlFlow;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::matching::{MatchError, MatchedDrive, Matcher, RoadAnswer, Stretch, TracePoint};

use super::answers::Answers;
use crate::error::invalid;
use crate::typed::index;
use crate::watch::Watch;

/// Which answer of a point is wanted.
#[derive(Debug, Clone, Copy)]
pub(super) enum Estimator {
    Smoothed,
    Live,
    Late(usize),
}

impl Estimator {
    pub(super) fn of(name: &str, lag: usize) -> PyResult<Self> {
        match name {
            "smoothed" => Ok(Self::Smoothed),
            "live" => Ok(Self::Live),
            "late" => Ok(Self::Late(lag)),
            _ => Err(invalid(format!(
                "the estimator is {name:?}, expected 'smoothed', 'live' or 'late'"
            ))),
        }
    }

    pub(super) fn answer(self, drive: &MatchedDrive, point: usize) -> RoadAnswer {
        match self {
            Self::Smoothed => drive.smoothed(point),
            Self::Live => drive.live(point),
            Self::Late(lag) => drive.late(point, lag),
        }
    }
}

/// Results of many drives, column by column.
#[derive(Debug, Default)]
pub(super) struct Matched {
    answers: Answers,
    log_normalizers: Vec<f64>,
    /// Drive of each stretch, and its columns.
    drives: Vec<i64>,
    stretches: Vec<Stretch>,
    log_likelihoods: Vec<f64>,
    failed: Vec<(usize, Option<usize>, String)>,
}

/// Matches all drives; the first error ends them unless it is to be skipped.
pub(super) fn match_all(
    matcher: &Matcher,
    points: &[TracePoint],
    offsets: &[usize],
    estimator: Estimator,
    skip: bool,
    watch: &Watch,
) -> Matched {
    let mut all = Matched::default();
    let drives = offsets.windows(2).map(|ends| &points[ends[0]..ends[1]]);
    let _ = matcher.match_map_all(drives, |number, drive| {
        match drive {
            Ok(drive) => all.push(matcher, number, &drive, estimator),
            Err(error) => {
                let point = point_of(&error);
                all.failed.push((number, point, error.to_string()));
                let count = offsets[number + 1] - offsets[number];
                all.answers.push_missing(count);
                all.log_normalizers.resize(all.log_normalizers.len() + count, f64::NAN);
                all.log_likelihoods.push(f64::NAN);
                if !skip {
                    return ControlFlow::Break(());
                }
            }
        }
        if watch.is_stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    all
}

/// Index in its drive of the point that is not valid.
fn point_of(error: &MatchError) -> Option<usize> {
    match error {
        MatchError::Point { point, .. } | MatchError::Time { point, .. } => Some(*point),
        _ => None,
    }
}

impl Matched {
    fn push(&mut self, matcher: &Matcher, number: usize, drive: &MatchedDrive, of: Estimator) {
        for point in 0..drive.points().len() {
            self.answers.push(matcher.network(), &of.answer(drive, point));
            self.log_normalizers.push(drive.log_normalizer(point));
        }
        self.log_likelihoods.push(drive.log_likelihood());
        self.stretches.extend_from_slice(drive.route());
        self.drives.resize(self.stretches.len(), index(Some(number)));
    }

    pub(super) fn into_python(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let columns = PyDict::new(py);
        columns.set_item("answers", Py::new(py, self.answers.into_python(py)?)?)?;
        columns.set_item("log_normalizers", PyArray1::from_vec(py, self.log_normalizers))?;
        columns.set_item("log_likelihoods", PyArray1::from_vec(py, self.log_likelihoods))?;
        let edge = self.stretches.iter().map(|part| index(part.edge)).collect();
        let numbers = |of: fn(&Stretch) -> f64| self.stretches.iter().map(of).collect();
        columns.set_item("route_drive", PyArray1::from_vec(py, self.drives))?;
        columns.set_item("route_edge", PyArray1::from_vec(py, edge))?;
        columns.set_item("route_enter", PyArray1::from_vec(py, numbers(|part| part.enter)))?;
        columns.set_item("route_exit", PyArray1::from_vec(py, numbers(|part| part.exit)))?;
        columns.set_item("failed", self.failed)?;
        Ok(columns)
    }
}
