//! Many drives on several threads, with results as columns.
//!
//! Threads take parts of consecutive drives from one counter. Their results are put in order at the
//! end, so that the output does not depend on the number of threads.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix_roads::matching::{MatchError, MatchedDrive, Matcher, RoadAnswer, Stretch, TracePoint};

use super::answers::Answers;
use crate::error::invalid;
use crate::typed::index;
use crate::watch::Watch;

/// Points that the answer for a point is given.
#[derive(Debug, Clone, Copy)]
pub(super) enum Estimator {
    Smoothed,
    Live,
    Late(usize),
}

impl Estimator {
    pub(super) fn of(name: &str, lag: Option<usize>) -> PyResult<Self> {
        match (name, lag) {
            ("smoothed", _) => Ok(Self::Smoothed),
            ("live", _) => Ok(Self::Live),
            ("late", Some(lag)) => Ok(Self::Late(lag)),
            ("late", None) => {
                Err(invalid("late answers need a lag, the number of points that they wait for"))
            }
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
    /// Drive of each stretch.
    drives: Vec<i64>,
    stretches: Vec<Stretch>,
    log_likelihoods: Vec<f64>,
    failed: Vec<(usize, Option<usize>, String)>,
}

/// Drives of a data frame, and the answers that are wanted.
pub(super) struct Drives {
    pub(super) points: Vec<TracePoint>,
    /// Start of each drive in `points`, and the end of the last.
    pub(super) offsets: Vec<usize>,
    pub(super) estimator: Estimator,
    /// True to go on after a drive that cannot be matched.
    pub(super) skip: bool,
}

/// Largest number of drives that a thread takes at a time.
const AT_ONCE: usize = 16;
/// Average number of parts for each thread, so that threads with short drives take more parts.
const PARTS: usize = 8;

impl Drives {
    /// Matches all drives on `jobs` threads. The first error ends them, unless errors are skipped.
    /// `done` counts the drives as they are matched.
    pub(super) fn match_all(
        &self,
        matcher: &Matcher,
        jobs: usize,
        watch: &Watch,
        done: &AtomicUsize,
    ) -> Matched {
        let count = self.offsets.len().saturating_sub(1);
        let at_once = (count / (jobs * PARTS)).clamp(1, AT_ONCE);
        let (next, ended) = (AtomicUsize::new(0), AtomicBool::new(false));
        let found = Mutex::new(Vec::new());
        // Parts are begun in order, and a part that is begun is finished. So when a drive fails,
        // all earlier drives are also matched, and the first error does not depend on threads.
        let work = || {
            while !ended.load(Ordering::Relaxed) && !watch.is_stopped() {
                let part = next.fetch_add(at_once, Ordering::Relaxed);
                if part >= count {
                    break;
                }
                let last = count.min(part + at_once);
                let made = self.matched(matcher, part..last, watch, done);
                if !self.skip && !made.failed.is_empty() {
                    ended.store(true, Ordering::Relaxed);
                }
                // A push that panics leaves the vector as it was, so a poisoned lock is harmless.
                found.lock().unwrap_or_else(PoisonError::into_inner).push((part, made));
            }
        };
        // This thread is one of the `jobs`; it is not the one that holds Python's lock.
        std::thread::scope(|scope| {
            for _ in 1..jobs {
                scope.spawn(work);
            }
            work();
        });
        let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort_by_key(|(part, _)| *part);
        let mut all = Matched::default();
        for (_, made) in found {
            all.append(made);
        }
        all
    }

    fn matched(
        &self,
        matcher: &Matcher,
        numbers: Range<usize>,
        watch: &Watch,
        done: &AtomicUsize,
    ) -> Matched {
        let mut all = Matched::default();
        for number in numbers {
            let points = self.offsets[number]..self.offsets[number + 1];
            match matcher.match_drive(&self.points[points.clone()]) {
                Ok(drive) => all.push(matcher, number, &drive, self.estimator),
                Err(error) => {
                    all.push_failed(number, points.len(), point_of(&error), error.to_string());
                    if !self.skip {
                        break;
                    }
                }
            }
            done.fetch_add(1, Ordering::Relaxed);
            // The rest of the part stays unmatched, which nobody sees: the caller has raised.
            if watch.is_stopped() {
                break;
            }
        }
        all
    }
}

/// Returns the index of the invalid point in its drive.
fn point_of(error: &MatchError) -> Option<usize> {
    match error {
        MatchError::Point { point, .. } | MatchError::Time { point, .. } => Some(*point),
        _ => None,
    }
}

impl Matched {
    fn push_failed(&mut self, number: usize, count: usize, point: Option<usize>, problem: String) {
        self.failed.push((number, point, problem));
        self.answers.push_missing(count);
        self.log_normalizers.resize(self.log_normalizers.len() + count, f64::NAN);
        self.log_likelihoods.push(f64::NAN);
    }

    fn append(&mut self, mut more: Self) {
        self.answers.append(more.answers);
        self.log_normalizers.append(&mut more.log_normalizers);
        self.drives.append(&mut more.drives);
        self.stretches.append(&mut more.stretches);
        self.log_likelihoods.append(&mut more.log_likelihoods);
        self.failed.append(&mut more.failed);
    }

    fn push(&mut self, matcher: &Matcher, number: usize, drive: &MatchedDrive, of: Estimator) {
        for point in 0..drive.points().len() {
            self.answers.push(matcher.network(), &of.answer(drive, point));
            self.log_normalizers.push(drive.log_normalizer(point));
        }
        self.log_likelihoods.push(drive.log_likelihood());
        // One entry in `drives` for each of the stretches that are new.
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
