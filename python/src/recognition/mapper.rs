//! The class `Mapper`: references that are collected while the vehicle drives.

use std::sync::{Mutex, MutexGuard};

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix_recognition::observation::Distance;
use wayfix_recognition::{Mapper, Options};

use super::options::{distance, options};
use super::queries::query;
use super::{PyAnswer, PyRecognizer};
use crate::error::{invalid, recognition};
use crate::typed::Size;

/// Builder of references while the vehicle drives, which distinguishes new places from those seen
/// before.
///
/// Can be copied and pickled, and goes on from there.
///
/// Parameters
/// ----------
/// distance : {"cosine", "euclidean"}
///     Comparison of descriptors.
/// gap : int
///     Smallest number of steps between two visits to one place (30).
/// **options
///     As for `Recognizer`.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from wayfix.recognition import Mapper
/// >>> images = np.random.default_rng(0).normal(size=(120, 16)).astype(np.float32)
/// >>> mapper = Mapper()
/// >>> seen = [mapper.step(images[step % 120]) for step in range(180)]  # once and a half around
/// >>> seen[100] is None, seen[179].place
/// (True, 59)
/// >>> mapper.recognizer()
/// <Recognizer: 130 references, descriptors of 16>
#[pyclass(name = "Mapper", module = "wayfix.recognition", frozen)]
#[derive(Debug)]
pub(crate) struct PyMapper {
    mapper: Mutex<Mapper>,
    distance: Distance,
}

impl PyMapper {
    fn lock(&self) -> MutexGuard<'_, Mapper> {
        // A call that panicked has raised an exception; it does not make later calls fail.
        self.mapper.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

#[pymethods]
impl PyMapper {
    #[new]
    #[pyo3(signature = (distance="cosine", *, gap=Size(30), **options))]
    fn new(distance: &str, gap: Size, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let distance = self::distance(distance)?;
        let options = self::options(&Options::default(), options)?;
        let mapper = Mapper::new(distance, options).map_err(invalid)?.with_gap(gap.0);
        Ok(Self { mapper: Mutex::new(mapper), distance })
    }

    /// Takes the next descriptor and, if known, the distance driven since the last one, in
    /// references. Returns the answer at a place that was seen before, and None at a new place.
    #[pyo3(signature = (query, odometry=None))]
    fn step(
        &self,
        py: Python<'_>,
        query: &Bound<'_, PyAny>,
        odometry: Option<f64>,
    ) -> PyResult<Option<PyAnswer>> {
        let query = self::query(query, false)?;
        // NaN is a missing reading, as it is in arrays.
        let odometry = odometry.filter(|reading| !reading.is_nan());
        let seen = py.detach(|| self.lock().step_with(odometry, &query));
        Ok(seen.map_err(|error| recognition(py, &error))?.map(PyAnswer::from))
    }

    /// References so far: a copy, of shape (n, d).
    #[getter]
    fn references<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (count, values) = py.detach(|| {
            let mapper = self.lock();
            (mapper.references().len(), mapper.references().concat())
        });
        // All references have one width, since the mapper refuses others.
        let width = values.len() / count.max(1);
        PyArray1::from_vec(py, values).reshape([count, width])
    }

    /// Returns a recogniser of the references so far, for later drives.
    #[pyo3(signature = (**options))]
    fn recognizer(
        &self,
        py: Python<'_>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyRecognizer> {
        let options = self::options(&Options::default(), options)?;
        let array = self.references(py)?.unbind();
        let made = py.detach(|| self.lock().recognizer(options)).map_err(invalid)?;
        Ok(PyRecognizer::of_mapped(made, array, self.distance))
    }

    fn __copy__(&self, py: Python<'_>) -> Self {
        let mapper = py.detach(|| self.lock().clone());
        Self { mapper: Mutex::new(mapper), distance: self.distance }
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__(py)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let state = py.detach(|| serde_json::to_string(&*self.lock())).map_err(invalid)?;
        Ok((py.get_type::<Self>().getattr("_from_parts")?, (state,)))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(state: &str) -> PyResult<Self> {
        let mapper: Mapper = serde_json::from_str(state).map_err(invalid)?;
        Ok(Self { distance: mapper.distance(), mapper: Mutex::new(mapper) })
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let count = py.detach(|| self.lock().references().len());
        format!("<Mapper: {count} references>")
    }
}
