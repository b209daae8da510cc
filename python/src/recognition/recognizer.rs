//! The class `Recognizer`: references of a route, options, and the result of learning.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix_recognition::observation::Distance;
use wayfix_recognition::{Options, Parameters, Recognizer};

use super::labels::{Parts, places};
use super::options::{check_memory, distance, options};
use super::queries::Queries;
use super::source::Source;
use super::{PyRecording, PyTrack};
use crate::error::{invalid, recognition};
use crate::options::to_python;
use crate::typed::{Rows, Size, float_rows, optional};
use crate::watch::{computed, in_background};

/// Recogniser of the places of a route, by images of an earlier pass.
///
/// References are the rows of a matrix, in order along the route: descriptors of images by any
/// method, in 32 bits. Queries are descriptors of the same kind. If something else compares the
/// images, `from_distances` and `from_similarities` take only the number of references, and
/// queries are rows of distances or similarities.
///
/// Then `track()` follows a vehicle live, and `recording(queries)` takes a whole drive.
///
/// Parameters
/// ----------
/// descriptors : array, shape (n, d)
///     One row for each reference. The array is kept for pickles: do not change it.
/// distance : {"cosine", "euclidean"}
///     Cosine suits networks, Euclidean pixels.
/// **options
///     Any of the library's options by name; those that are dictionaries may be given in part. The
///     attribute `options` lists them all. The most important ones: `closed=True` for references
///     that form a loop, `off_map=True` (or its rates `leave`, `back`, `near`, `within`) for a
///     vehicle that may leave the route, `window`, the number of references on either side that
///     count as the same place (1), and `speeds`, in references per step (-2 to 3).
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from wayfix.recognition import Recognizer
/// >>> rng = np.random.default_rng(0)
/// >>> references = rng.normal(size=(40, 16)).astype(np.float32)
/// >>> drive = references[12:30] + 0.3 * rng.normal(size=(18, 16)).astype(np.float32)
/// >>> recognizer = Recognizer(references)
/// >>> track = recognizer.track()
/// >>> for frame in drive:
/// ...     answer = track.step(frame)
/// >>> answer.place
/// 29
/// >>> answers = recognizer.recording(drive).smoothed()
/// >>> answers.places
/// array([12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28,
///        29])
/// >>> bool(answers.probability.min() > 0.9)
/// True
#[pyclass(name = "Recognizer", module = "wayfix.recognition", frozen)]
#[derive(Debug)]
pub(crate) struct PyRecognizer {
    pub(super) recognizer: Recognizer,
    source: Source,
}

impl PyRecognizer {
    fn made(
        py: Python<'_>,
        traverses: Vec<PyReadonlyArray2<'_, f32>>,
        distance: Distance,
        options: Options,
    ) -> PyResult<Self> {
        let all: Vec<Rows<'_, f32>> = traverses.iter().map(Rows::of).collect::<PyResult<_>>()?;
        // All passes have as many rows as the first; the library refuses others.
        check_memory(all.first().map_or(0, Rows::count), &options)?;
        // The rows borrow numpy's memory, since a copy of a large map might not fit. So they cannot
        // go to a thread that may outlive this call, as in `compared`, and Ctrl-C waits.
        let made = py.detach(|| {
            let rows: Vec<Vec<&[f32]>> = all.iter().map(|rows| rows.iter().collect()).collect();
            let slices: Vec<&[&[f32]]> = rows.iter().map(Vec::as_slice).collect();
            Recognizer::from_traverses(&slices, distance, options)
        });
        let recognizer = made.map_err(invalid)?;
        let traverses = traverses.iter().map(|array| (**array).clone().unbind()).collect();
        Ok(Self { recognizer, source: Source::Descriptors { traverses, distance } })
    }

    fn compared(
        py: Python<'_>,
        references: usize,
        negated: bool,
        given: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let options = options(&Options::default(), given)?;
        check_memory(references, &options)?;
        // The tables are built in one call, which cannot look for signals.
        let made = in_background(py, move |_| Recognizer::from_distances(references, options))?;
        Ok(Self { recognizer: made.map_err(invalid)?, source: Source::Compared { negated } })
    }

    /// Returns another recogniser of the same references.
    fn with(&self, py: Python<'_>, recognizer: Recognizer) -> Self {
        Self { recognizer, source: self.source.clone_ref(py) }
    }

    /// True if queries are similarities.
    pub(super) fn negated(&self) -> bool {
        self.source.negated()
    }

    /// Creates a recogniser of the references of a mapper.
    pub(super) fn of_mapped(
        recognizer: Recognizer,
        array: Py<PyArray2<f32>>,
        distance: Distance,
    ) -> Self {
        Self { recognizer, source: Source::Descriptors { traverses: vec![array], distance } }
    }
}

#[pymethods]
impl PyRecognizer {
    #[new]
    #[pyo3(signature = (descriptors, distance="cosine", **options))]
    fn new(
        py: Python<'_>,
        descriptors: &Bound<'_, PyAny>,
        distance: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let rows = float_rows(descriptors, "descriptors")?;
        let options = self::options(&Options::default(), options)?;
        Self::made(py, vec![rows], self::distance(distance)?, options)
    }

    /// Creates a recogniser from several passes along the route, in different seasons or weather: a
    /// list of matrices whose rows i show place i.
    #[staticmethod]
    #[pyo3(signature = (traverses, distance="cosine", **options))]
    fn from_traverses(
        py: Python<'_>,
        traverses: Vec<Bound<'_, PyAny>>,
        distance: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let rows = traverses.iter().map(|rows| float_rows(rows, "descriptors"));
        let rows = rows.collect::<PyResult<Vec<_>>>()?;
        let options = self::options(&Options::default(), options)?;
        Self::made(py, rows, self::distance(distance)?, options)
    }

    /// Creates a recogniser for queries that are rows of distances to the references, smaller for
    /// more alike, by any comparison; scale and offset do not matter. Raises MemoryError for more
    /// references than fit into memory; with the default speeds, each takes 1.2 kB.
    #[staticmethod]
    #[pyo3(signature = (references, **options))]
    fn from_distances(
        py: Python<'_>,
        references: Size,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        Self::compared(py, references.0, false, options)
    }

    /// Creates a recogniser for queries that are rows of similarities to the references, larger for
    /// more alike.
    #[staticmethod]
    #[pyo3(signature = (references, **options))]
    fn from_similarities(
        py: Python<'_>,
        references: Size,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        Self::compared(py, references.0, true, options)
    }

    /// Number of references.
    #[getter]
    fn references(&self) -> usize {
        self.recognizer.references()
    }

    /// Options, given or learned, as a dictionary.
    #[getter]
    fn options<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, self.recognizer.options())
    }

    /// Result of learning as JSON, for `with_parameters`; before learning, it holds the options
    /// alone.
    #[getter]
    fn parameters(&self) -> PyResult<String> {
        serde_json::to_string(self.recognizer.parameters()).map_err(invalid)
    }

    /// Returns a recogniser of the same references with another result of learning. Values learned
    /// for single references are dropped if the number of references differs.
    fn with_parameters(&self, py: Python<'_>, parameters: &str) -> PyResult<Self> {
        // The options of the parameters may have more speeds than the present ones, and so need
        // more memory.
        let fit: Parameters = serde_json::from_str(parameters)
            .map_err(|error| invalid(format!("parameters: {error}")))?;
        check_memory(self.references(), fit.options())?;
        Ok(self.with(py, self.recognizer.with_parameters(fit).map_err(invalid)?))
    }

    /// Returns a recogniser with some options replaced, which keeps everything that was learned.
    #[pyo3(signature = (**options))]
    fn with_options(&self, py: Python<'_>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let options = self::options(self.recognizer.options(), options)?;
        check_memory(self.references(), &options)?;
        let fit = self.recognizer.parameters().clone().with_options(options);
        Ok(self.with(py, self.recognizer.with_parameters(fit).map_err(invalid)?))
    }

    /// Reasons to doubt the fit, as texts; empty for parameters that were read from JSON.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.recognizer.parameters().warnings().iter().map(ToString::to_string).collect()
    }

    /// Starts to track a vehicle, which may be anywhere on the route at first.
    fn track(this: &Bound<'_, Self>) -> PyTrack {
        PyTrack::new(this)
    }

    /// Returns a track with the state that `Track.to_bytes` returned.
    fn track_from_bytes(this: &Bound<'_, Self>, bytes: &[u8]) -> PyResult<PyTrack> {
        let track = PyTrack::new(this);
        track.restore(this.py(), bytes)?;
        Ok(track)
    }

    /// Compares a whole drive with the references.
    ///
    /// Parameters
    /// ----------
    /// queries : array, shape (steps, d) or (steps, n)
    ///     Descriptors, distances or similarities, as the recogniser was made for.
    /// odometry : array, shape (steps,), optional
    ///     Distance driven before each query, in references; NaN without a reading.
    #[pyo3(signature = (queries, odometry=None))]
    fn recording(
        this: &Bound<'_, Self>,
        queries: &Bound<'_, PyAny>,
        odometry: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyRecording> {
        let (py, of) = (this.py(), this.get());
        let queries = Queries::new(queries, of.negated())?;
        let rows = queries.rows()?;
        let odometry = optional(odometry, "odometry readings", rows.count())?;
        let values = queries.values(&rows);
        // Comparing reads the queries one by one, so this thread can look for signals itself.
        let made = computed(py, |watch| {
            of.recognizer.recording(&watch.over_rows(rows.with(&values).iter()), &odometry)
        })?;
        Ok(PyRecording::new(
            made.map_err(|error| recognition(py, &error))?,
            this,
            queries.array(),
            odometry,
        ))
    }

    /// Learns from labelled parts of drives: speeds, odometry, rates of leaving the map, and the
    /// usual scores of each reference. Returns another recogniser; read its `warnings`.
    ///
    /// Parameters
    /// ----------
    /// queries : array, shape (steps, d) or (steps, n)
    ///     A hundred or more, as `recording` takes them.
    /// places : array of int, shape (steps,) or (steps, 2)
    ///     The reference of each query, or the first and last of those that show its place; -1 off
    ///     the map.
    /// odometry : array, shape (steps,), optional
    ///     As in `recording`.
    /// lengths : list of int, optional
    ///     Lengths of several parts, one after another; they sum to the number of steps.
    #[pyo3(signature = (queries, places, odometry=None, lengths=None))]
    fn fit(
        &self,
        py: Python<'_>,
        queries: &Bound<'_, PyAny>,
        places: &Bound<'_, PyAny>,
        odometry: Option<&Bound<'_, PyAny>>,
        lengths: Option<Vec<Size>>,
    ) -> PyResult<Self> {
        let queries = Queries::new(queries, self.negated())?;
        let rows = queries.rows()?;
        let values = queries.values(&rows);
        // Without lengths, all steps are one part.
        let parts = Parts {
            places: self::places(places)?,
            odometry: optional(odometry, "odometry readings", rows.count())?,
            lengths: lengths
                .map_or_else(|| vec![rows.count()], |all| all.iter().map(|size| size.0).collect()),
        };
        parts.check(rows.count())?;
        let fitted = computed(py, |watch| {
            let queries = watch.over_rows(rows.with(&values).iter());
            self.recognizer.fit(&parts.with(&queries))
        })?;
        Ok(self.with(py, fitted.map_err(|error| recognition(py, &error))?))
    }

    /// Pickles the references and the result of learning.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (arrays, kind) = self.source.stored(py)?;
        let arguments = (arrays, kind, self.references(), self.parameters()?);
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, arguments.into_pyobject(py)?.into_any()))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        py: Python<'_>,
        traverses: Vec<Bound<'_, PyAny>>,
        kind: &str,
        references: usize,
        parameters: &str,
    ) -> PyResult<Self> {
        // The parameters have the options; the defaults here are replaced at the end.
        let made = match kind {
            "distances" => Self::compared(py, references, false, None)?,
            "similarities" => Self::compared(py, references, true, None)?,
            distance => Self::from_traverses(py, traverses, distance, None)?,
        };
        made.with_parameters(py, parameters)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("<Recognizer: {} references, {}>", self.references(), self.source.described(py))
    }
}
