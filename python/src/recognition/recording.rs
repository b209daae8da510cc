//! The class `Recording`: a whole drive compared with the references.
//!
//! The recursions over a recording take all of it at once, so they run in the background, and
//! Ctrl-C leaves them behind.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;
use wayfix_recognition::{PlaceBeliefs, RecognitionError, Recording};

use super::beliefs::Answers;
use super::{PyPlaceBeliefs, PyRecognizer};
use crate::error::recognition;
use crate::typed::{Size, index};
use crate::watch::in_background;

/// Drive compared with the references, made by `Recognizer.recording(queries)`: to be filtered,
/// smoothed or decoded.
///
/// Can be copied and pickled. A pickle has the array of the queries, which are compared again when
/// it is loaded: do not change the array.
///
/// Ctrl-C returns from each method at once; the computation ends unseen in the background.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from wayfix.recognition import Recognizer
/// >>> recording = Recognizer.from_similarities(30).recording(np.eye(30)[5:20])
/// >>> recording.smoothed().places
/// array([ 5,  6,  7,  8,  9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19])
/// >>> recording.filtered().probabilities.shape
/// (15, 30)
#[pyclass(name = "Recording", module = "wayfix.recognition", frozen)]
#[derive(Debug)]
pub(crate) struct PyRecording {
    recording: Arc<Recording>,
    recognizer: Py<PyRecognizer>,
    queries: Py<PyArray2<f32>>,
    odometry: Vec<Option<f64>>,
}

impl PyRecording {
    /// Creates a recording; the queries and readings are kept for pickles.
    pub(super) fn new(
        recording: Recording,
        recognizer: &Bound<'_, PyRecognizer>,
        queries: Py<PyArray2<f32>>,
        odometry: Vec<Option<f64>>,
    ) -> Self {
        let recognizer = recognizer.clone().unbind();
        Self { recording: Arc::new(recording), recognizer, queries, odometry }
    }

    fn beliefs(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&Recording) -> Result<PlaceBeliefs, RecognitionError> + Send + 'static,
    ) -> PyResult<PyPlaceBeliefs> {
        let recording = Arc::clone(&self.recording);
        let found = in_background(py, move |_| work(&recording).map(Answers::new))?;
        found
            .map_err(|error| recognition(py, &error))?
            .into_python(py, self.recognizer.get().recognizer.clone())
    }
}

#[pymethods]
impl PyRecording {
    /// Number of steps.
    #[getter]
    fn steps(&self) -> usize {
        self.recording.steps()
    }

    /// Returns the belief of each step given the queries up to it.
    fn filtered(&self, py: Python<'_>) -> PyResult<PyPlaceBeliefs> {
        self.beliefs(py, |recording| Ok(recording.filtered()))
    }

    /// Returns the belief of each step given all queries.
    fn smoothed(&self, py: Python<'_>) -> PyResult<PyPlaceBeliefs> {
        self.beliefs(py, Recording::smoothed)
    }

    /// Returns the belief of each step given the queries up to `lag` steps later.
    fn lagged(&self, py: Python<'_>, lag: Size) -> PyResult<PyPlaceBeliefs> {
        self.beliefs(py, move |recording| {
            // The routine returns beliefs for each lag that it is given.
            recording.lagged(&[lag.0]).map(|mut all| all.swap_remove(0))
        })
    }

    /// Returns the belief of each step given its last new query alone: a baseline.
    fn single(&self, py: Python<'_>) -> PyResult<PyPlaceBeliefs> {
        self.beliefs(py, |recording| Ok(recording.single()))
    }

    /// Returns the path with the largest expected number of right steps: a reference for each step,
    /// -1 off the map.
    fn decoded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let recording = Arc::clone(&self.recording);
        let path = in_background(py, move |_| recording.decoded())?;
        let path = path.map_err(|error| recognition(py, &error))?;
        let path: Vec<i64> = path.into_iter().map(index).collect();
        Ok(path.to_pyarray(py))
    }

    /// Returns reasons to doubt the views and readings of the drive, or their match with the fit,
    /// as texts.
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let recording = Arc::clone(&self.recording);
        in_background(py, move |_| recording.warnings().iter().map(ToString::to_string).collect())
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        Self {
            // Shared: nothing changes a recording once it is made.
            recording: Arc::clone(&self.recording),
            recognizer: self.recognizer.clone_ref(py),
            queries: self.queries.clone_ref(py),
            odometry: self.odometry.clone(),
        }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    /// Pickles the recogniser, the queries and the odometry.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<PyArray2<f32>>, Option<Bound<'py, PyArray1<f64>>>))> {
        let readings = self.odometry.iter().map(|reading| reading.unwrap_or(f64::NAN));
        let readings = readings.collect::<Vec<f64>>().to_pyarray(py);
        // Without readings the vector is empty, as `optional` made it from None.
        let odometry = (!self.odometry.is_empty()).then_some(readings);
        let made = self.recognizer.bind(py).getattr("recording")?;
        Ok((made, (self.queries.clone_ref(py), odometry)))
    }

    fn __len__(&self) -> usize {
        self.recording.steps()
    }

    fn __repr__(&self) -> String {
        let references = self.recognizer.get().recognizer.references();
        format!("<Recording: {} steps, {references} references>", self.recording.steps())
    }
}
