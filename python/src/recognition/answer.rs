//! The class `Answer`: the answer of one step.

use pyo3::prelude::*;
use wayfix_recognition::Answer;

/// Estimated position of the vehicle at one step.
///
/// Attributes
/// ----------
/// place : int or None
///     Number of the reference, from 0; None if the vehicle is more probably off the map than on
///     it.
/// probability : float
///     Probability that the vehicle is within `window` references of `place`, or off the map.
/// around : tuple of int
///     First and last of the references around `place` that hold 90% of the belief on the map. On
///     a loop, the first may be larger than the last.
/// off_map : float
///     Probability of being off the map.
/// log_likelihood : float
///     Log-likelihood of the query and the measurements of this step, given all earlier ones.
#[pyclass(name = "Answer", module = "wayfix.recognition", frozen, eq, get_all)]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PyAnswer {
    place: Option<usize>,
    probability: f64,
    around: (usize, usize),
    off_map: f64,
    log_likelihood: f64,
}

impl From<Answer> for PyAnswer {
    fn from(answer: Answer) -> Self {
        let Answer { place, probability, around, off_map, log_likelihood } = answer;
        // On a loop, the range may be descending, so it is kept as a pair.
        let around = around.into_inner();
        Self { place, probability, around, off_map, log_likelihood }
    }
}

#[pymethods]
impl PyAnswer {
    /// Pickles all attributes.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Option<usize>, f64, (usize, usize), f64, f64))> {
        let Self { place, probability, around, off_map, log_likelihood } = *self;
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, (place, probability, around, off_map, log_likelihood)))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        place: Option<usize>,
        probability: f64,
        around: (usize, usize),
        off_map: f64,
        log_likelihood: f64,
    ) -> Self {
        Self { place, probability, around, off_map, log_likelihood }
    }

    fn __repr__(&self) -> String {
        let Self { place, probability, around: (first, last), .. } = self;
        match place {
            Some(place) => {
                format!(
                    "<Answer: place {place}, probability {probability:.3}, around {first} to {last}>"
                )
            }
            None => format!("<Answer: off the map, probability {probability:.3}>"),
        }
    }
}
