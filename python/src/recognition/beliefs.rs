//! The class `PlaceBeliefs`: beliefs and answers of a drive, as arrays.

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods, ToPyArray,
};
use pyo3::prelude::*;
use wayfix::Belief;
use wayfix_recognition::{PlaceBeliefs, Recognizer};

use crate::array::integers;
use crate::error::invalid;
use crate::typed::{Size, index};

/// Answers of all steps and the rows of their beliefs, as vectors: made on the thread that computed
/// them, without Python's lock.
pub(super) struct Answers {
    rows: Vec<f64>,
    steps: usize,
    places: Vec<i64>,
    probability: Vec<f64>,
    around: Vec<i64>,
    off_map: Vec<f64>,
    log_likelihoods: Vec<f64>,
}

impl Answers {
    // Taken by value so that the beliefs are dropped here. Their rows, the largest part of a
    // recording, are in memory twice only while they are copied.
    #[expect(clippy::needless_pass_by_value, reason = "see above")]
    pub(super) fn new(beliefs: PlaceBeliefs) -> Self {
        let answers = beliefs.answers();
        let around =
            answers.iter().flat_map(|answer| [*answer.around.start(), *answer.around.end()]);
        Self {
            steps: beliefs.steps(),
            places: answers.iter().map(|answer| index(answer.place)).collect(),
            probability: answers.iter().map(|answer| answer.probability).collect(),
            around: around.map(|place| index(Some(place))).collect(),
            off_map: answers.iter().map(|answer| answer.off_map).collect(),
            log_likelihoods: answers.iter().map(|answer| answer.log_likelihood).collect(),
            rows: beliefs.iter().flat_map(|belief| belief.as_slice().iter().copied()).collect(),
        }
    }

    pub(super) fn into_python(
        self,
        py: Python<'_>,
        recognizer: Recognizer,
    ) -> PyResult<PyPlaceBeliefs> {
        let off_map = usize::from(recognizer.options().off_map().is_some());
        // The state off the map comes after the references.
        let width = recognizer.references() + off_map;
        let probabilities = PyArray1::from_vec(py, self.rows).reshape([self.steps, width])?;
        Ok(PyPlaceBeliefs {
            probabilities: probabilities.unbind(),
            places: self.places.to_pyarray(py).unbind(),
            probability: self.probability.to_pyarray(py).unbind(),
            around: PyArray1::from_vec(py, self.around).reshape([self.steps, 2])?.unbind(),
            off_map: self.off_map.to_pyarray(py).unbind(),
            log_likelihoods: self.log_likelihoods.to_pyarray(py).unbind(),
            recognizer,
        })
    }
}

/// Beliefs over places, one for each step of a drive, and the answers that follow from them.
///
/// Attributes
/// ----------
/// probabilities : array, shape (steps, n) or (steps, n + 1)
///     A row for each step; if off the map is modelled, its probability is in the last column.
/// places : array of int, shape (steps,)
///     The reference of each answer, from 0: the middle of the most probable `2 window + 1`
///     references, which need not be the most probable one; -1 if the vehicle is more probably off
///     the map.
/// probability : array, shape (steps,)
///     Probability that the vehicle is within `window` references of the place, or off the map.
/// around : array of int, shape (steps, 2)
///     First and last of the references around the place that hold 90% of the belief on the map.
///     On a loop, the first may be larger than the last.
/// off_map : array, shape (steps,)
///     Probability of being off the map.
/// log_likelihoods : array, shape (steps,)
///     Log-likelihood of each step given those before; 0 for smoothed beliefs.
#[pyclass(name = "PlaceBeliefs", module = "wayfix.recognition", frozen)]
#[derive(Debug)]
pub(crate) struct PyPlaceBeliefs {
    #[pyo3(get)]
    probabilities: Py<PyArray2<f64>>,
    #[pyo3(get)]
    places: Py<PyArray1<i64>>,
    #[pyo3(get)]
    probability: Py<PyArray1<f64>>,
    #[pyo3(get)]
    around: Py<PyArray2<i64>>,
    #[pyo3(get)]
    off_map: Py<PyArray1<f64>>,
    #[pyo3(get)]
    log_likelihoods: Py<PyArray1<f64>>,
    recognizer: Recognizer,
}

impl PyPlaceBeliefs {
    fn read<'py>(&self, py: Python<'py>) -> PyResult<PyReadonlyArray2<'py, f64>> {
        // The array also belongs to the user, who may be writing to it.
        self.probabilities.bind(py).try_readonly().map_err(invalid)
    }
}

/// Returns the row of a step.
fn row<'a>(array: &'a PyReadonlyArray2<'_, f64>, step: usize) -> PyResult<&'a [f64]> {
    let &[steps, width] = array.shape() else { return Err(invalid("expected two axes")) };
    if step >= steps {
        return Err(invalid(format!("there is no step {step}, expected a number below {steps}")));
    }
    Ok(&array.as_slice().map_err(invalid)?[step * width..][..width])
}

#[pymethods]
impl PyPlaceBeliefs {
    /// Returns the probability, at each step, of being within `within` references of a place.
    ///
    /// Parameters
    /// ----------
    /// places : array of int, shape (steps,)
    ///     For example the true places; -1 is off the map.
    /// within : int
    ///     Number of references on either side (0).
    #[pyo3(signature = (places, within=Size(0)))]
    fn mass_near<'py>(
        &self,
        py: Python<'py>,
        places: &Bound<'py, PyAny>,
        within: Size,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (places, rows) = (integers(places, "places")?, self.read(py)?);
        let (places, n) = (places.as_slice().map_err(invalid)?, self.recognizer.references());
        let steps = rows.shape()[0];
        if places.len() != steps {
            return Err(invalid(format!("found {} places, expected {steps}", places.len())));
        }
        let mut masses = Vec::with_capacity(steps);
        for (step, place) in places.iter().enumerate() {
            let belief = row(&rows, step)?;
            masses.push(match usize::try_from(*place) {
                Ok(place) if place < n => self.recognizer.mass_near(belief, place, within.0),
                Ok(place) => {
                    let what = format!("places have {place} at {step}, expected below {n}");
                    return Err(invalid(what));
                }
                // Off the map: the entry after the references, or 0 if it is not modelled.
                Err(_) => belief.get(n).copied().unwrap_or(0.0),
            });
        }
        Ok(masses.to_pyarray(py))
    }

    /// Returns the fewest places, the most probable first, that hold a probability of at least
    /// `level` at a step, from 0; the number of references stands for off the map.
    fn credible_set<'py>(
        &self,
        py: Python<'py>,
        step: Size,
        level: f64,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let rows = self.read(py)?;
        let set = Belief::new(row(&rows, step.0)?.to_vec()).map_err(invalid)?;
        let set = set.credible_set(level).map_err(invalid)?;
        let set: Vec<i64> = set.into_iter().map(|place| index(Some(place))).collect();
        Ok(set.to_pyarray(py))
    }

    /// Pickles the arrays, and the recogniser's number of references and options.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let of_places = (self.places.clone_ref(py), self.probability.clone_ref(py));
        let others = (self.off_map.clone_ref(py), self.log_likelihoods.clone_ref(py));
        let probabilities = self.probabilities.clone_ref(py);
        let options = serde_json::to_string(self.recognizer.options()).map_err(invalid)?;
        let recognizer = (self.recognizer.references(), options);
        let parts = (probabilities, of_places, self.around.clone_ref(py), others, recognizer);
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, parts.into_pyobject(py)?.into_any()))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        probabilities: Py<PyArray2<f64>>,
        of_places: (Py<PyArray1<i64>>, Py<PyArray1<f64>>),
        around: Py<PyArray2<i64>>,
        others: (Py<PyArray1<f64>>, Py<PyArray1<f64>>),
        recognizer: (usize, String),
    ) -> PyResult<Self> {
        let ((places, probability), (off_map, log_likelihoods)) = (of_places, others);
        let (references, options) = recognizer;
        // Only `mass_near` and the width need a recogniser, and any with these options gives the
        // same: so the references are not in the pickle.
        let options = serde_json::from_str(&options).map_err(invalid)?;
        let recognizer = Recognizer::from_distances(references, options).map_err(invalid)?;
        Ok(Self {
            probabilities,
            places,
            probability,
            around,
            off_map,
            log_likelihoods,
            recognizer,
        })
    }

    fn __len__(&self, py: Python<'_>) -> usize {
        self.places.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (steps, references) = (self.__len__(py), self.recognizer.references());
        format!("<PlaceBeliefs: {steps} steps, {references} references>")
    }
}
