//! The class `Track`: a live vehicle, query by query.

use std::sync::{Mutex, MutexGuard};

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use wayfix_recognition::{Track, TrackSnapshot};

use super::queries::query;
use super::{PyAnswer, PyRecognizer};
use crate::error::{invalid, recognition};

/// Vehicle tracked step by step, made by `Recognizer.track()`.
///
/// Can be copied and pickled; a copy continues with the same bits.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from wayfix.recognition import Recognizer
/// >>> track = Recognizer.from_similarities(5).track()
/// >>> for similarities in np.eye(5)[[1, 1, 2, 3]]:
/// ...     answer = track.step(similarities)
/// >>> answer.place, track.steps
/// (3, 4)
/// >>> track.places.shape
/// (5,)
#[pyclass(name = "Track", module = "wayfix.recognition", frozen)]
#[derive(Debug)]
pub(crate) struct PyTrack {
    /// Updated without the global lock, by the thread that has the next query.
    track: Mutex<Track>,
    recognizer: Py<PyRecognizer>,
    negated: bool,
}

impl PyTrack {
    pub(super) fn new(recognizer: &Bound<'_, PyRecognizer>) -> Self {
        let of = recognizer.get();
        let track = Mutex::new(of.recognizer.track());
        Self { track, negated: of.negated(), recognizer: recognizer.clone().unbind() }
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Track) -> T + Send) -> T {
        // The global lock is released before this one is taken, so that no thread holds the global
        // lock while it waits for the track.
        py.detach(|| work(&mut self.lock()))
    }

    fn lock(&self) -> MutexGuard<'_, Track> {
        // A track is valid after each call, so a poisoned lock is used as it is.
        self.track.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

#[pymethods]
impl PyTrack {
    /// Takes the next query and, if known, the distance driven since the last one, in references.
    /// Returns the answer. An error leaves the track as it was.
    #[pyo3(signature = (query, odometry=None))]
    fn step(
        &self,
        py: Python<'_>,
        query: &Bound<'_, PyAny>,
        odometry: Option<f64>,
    ) -> PyResult<PyAnswer> {
        let query = self::query(query, self.negated)?;
        let odometry = odometry.filter(|reading| !reading.is_nan());
        let answer = self.with(py, |track| track.step_with(odometry, &query));
        Ok(answer.map_err(|error| recognition(py, &error))?.into())
    }

    /// Takes a step without a query, for a lost frame.
    #[pyo3(signature = (odometry=None))]
    fn predict(&self, py: Python<'_>, odometry: Option<f64>) -> PyResult<PyAnswer> {
        let odometry = odometry.filter(|reading| !reading.is_nan());
        let answer = self.with(py, |track| track.predict_with(odometry));
        Ok(answer.map_err(|error| recognition(py, &error))?.into())
    }

    /// Forgets the position and the last view, but nothing that was learned of the references.
    fn relocate(&self, py: Python<'_>) {
        self.with(py, Track::relocate);
    }

    /// Probabilities of all places, and last that of off the map if it is modelled: a copy.
    #[getter]
    fn places<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.with(py, |track| track.places().as_slice().to_vec()).to_pyarray(py)
    }

    /// Number of steps.
    #[getter]
    fn steps(&self, py: Python<'_>) -> usize {
        self.with(py, |track| track.steps())
    }

    /// Log-likelihood of all queries and measurements so far.
    #[getter]
    fn log_likelihood(&self, py: Python<'_>) -> f64 {
        self.with(py, |track| track.log_likelihood())
    }

    /// Reasons to doubt the recent views and readings, as texts.
    #[getter]
    fn warnings(&self, py: Python<'_>) -> Vec<String> {
        self.with(py, |track| track.warnings().iter().map(ToString::to_string).collect())
    }

    /// The recogniser.
    #[getter]
    fn recognizer(&self, py: Python<'_>) -> Py<PyRecognizer> {
        self.recognizer.clone_ref(py)
    }

    /// Returns the state as bytes (JSON), without the references.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.with(py, |track| serde_json::to_vec(&track.snapshot()));
        Ok(PyBytes::new(py, &bytes.map_err(invalid)?))
    }

    /// Restores the state that `to_bytes` returned, of a track of this recogniser or one with an
    /// equal fit.
    pub(super) fn restore(&self, py: Python<'_>, bytes: &[u8]) -> PyResult<()> {
        let state: TrackSnapshot = py
            .detach(|| serde_json::from_slice(bytes))
            .map_err(|error| invalid(format!("the state of a track: {error}")))?;
        self.with(py, |track| track.restore(&state)).map_err(invalid)
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        let track = Mutex::new(self.with(py, |track| track.clone()));
        Self { track, recognizer: self.recognizer.clone_ref(py), negated: self.negated }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// Pickles the recogniser and the state.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((self.recognizer.bind(py).getattr("track_from_bytes")?, (self.to_bytes(py)?,)))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let steps = self.steps(py);
        format!(
            "<Track: {steps} steps, {} references>",
            self.recognizer.get().recognizer.references()
        )
    }
}
