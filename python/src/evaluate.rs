//! Scores of answers.

use numpy::{PyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::evaluate;
use wayfix_recognition::{ThresholdCurve, ThresholdPoint};

use crate::array::doubles;
use crate::array::integers;
use crate::error::invalid;
use crate::recognition::places;
use crate::typed::{Size, truths};

fn judged(scores: &Bound<'_, PyAny>, right: &Bound<'_, PyAny>) -> PyResult<Vec<(f64, bool)>> {
    let (scores, right) = (doubles(scores, "scores")?, truths(right, "truth values")?);
    let (scores, right) = (scores.as_slice().map_err(invalid)?, right.as_slice().map_err(invalid)?);
    // `zip` below would drop the rest of the longer array.
    if scores.len() != right.len() {
        let (found, expected) = (right.len(), scores.len());
        return Err(invalid(format!("found {found} truth values, expected {expected}")));
    }
    Ok(scores.iter().copied().zip(right.iter().copied()).collect())
}

/// Returns the share of the steps on the map with an answer within `within` references of the
/// truth.
///
/// Parameters
/// ----------
/// truth : array of int, shape (steps,) or (steps, 2)
///     The true reference, or the first and last of those that show the place; -1 off the map.
/// places : array of int, shape (steps,)
///     The answers; -1 is off the map.
/// within : int
///     Tolerance, in references (0).
///
/// Examples
/// --------
/// >>> from wayfix.evaluate import recall_within
/// >>> recall_within([3, 9, -1, 20], [4, 30, 7, 20], 1)
/// 0.6666666666666666
#[pyfunction]
#[pyo3(signature = (truth, places, within=Size(0)))]
pub(crate) fn recall_within(
    truth: &Bound<'_, PyAny>,
    places: &Bound<'_, PyAny>,
    within: Size,
) -> PyResult<f64> {
    let truth = self::places(truth)?;
    let answers = integers(places, "places")?;
    let answers = answers.as_slice().map_err(invalid)?;
    // -1 and any other negative number is off the map.
    let answers: Vec<_> = answers.iter().map(|place| usize::try_from(*place).ok()).collect();
    evaluate::recall_within(&truth, &answers, within.0).map_err(invalid)
}

/// Returns a reliability diagram of probabilities: a dictionary with the arrays `lower`, `upper`,
/// `count`, `mean_probability` and `fraction_true` over the bins that are not empty, and the
/// numbers `expected_calibration_error` and `maximum_calibration_error`.
///
/// Parameters
/// ----------
/// probabilities : array, shape (n,)
///     Probabilities of the answers.
/// right : array of bool, shape (n,)
///     True for each answer that is right.
/// bins : int
///     Number of bins of equal width (10).
///
/// Examples
/// --------
/// >>> from wayfix.evaluate import reliability
/// >>> found = reliability([0.25, 0.25, 0.875, 1, 0.875], [False, False, True, False, True], 2)
/// >>> found.get("count").tolist(), found.get("expected_calibration_error")
/// ([2, 3], 0.25)
#[pyfunction]
#[pyo3(signature = (probabilities, right, bins=Size(10)))]
pub(crate) fn reliability<'py>(
    py: Python<'py>,
    probabilities: &Bound<'py, PyAny>,
    right: &Bound<'py, PyAny>,
    bins: Size,
) -> PyResult<Bound<'py, PyDict>> {
    let found = evaluate::reliability(&judged(probabilities, right)?, bins.0).map_err(invalid)?;
    let column = |of: fn(&evaluate::ReliabilityBin) -> f64| -> Bound<'py, PyArray1<f64>> {
        found.iter().map(of).collect::<Vec<f64>>().to_pyarray(py)
    };
    let counts: Vec<u64> = found.iter().map(|bin| bin.count as u64).collect();
    let diagram = PyDict::new(py);
    diagram.set_item("lower", column(|bin| bin.lower))?;
    diagram.set_item("upper", column(|bin| bin.upper))?;
    diagram.set_item("count", counts.to_pyarray(py))?;
    diagram.set_item("mean_probability", column(|bin| bin.mean_probability))?;
    diagram.set_item("fraction_true", column(|bin| bin.fraction_true))?;
    let errors = [
        ("expected_calibration_error", evaluate::expected_calibration_error(&found)),
        ("maximum_calibration_error", evaluate::maximum_calibration_error(&found)),
    ];
    errors.into_iter().try_for_each(|(name, error)| diagram.set_item(name, error))?;
    Ok(diagram)
}

/// Precision and recall at each threshold of a confidence, or the receiver operating
/// characteristic.
///
/// Examples
/// --------
/// >>> from wayfix.evaluate import ThresholdCurve
/// >>> curve = ThresholdCurve.precision_recall([0.9, 0.8, 0.4, 0.2], [True, True, False, False], 3)
/// >>> curve.recall_at_precision(1.0)
/// 0.6666666666666666
/// >>> curve.thresholds
/// array([0.9, 0.8, 0.4, 0.2])
#[pyclass(name = "ThresholdCurve", module = "wayfix.evaluate", frozen)]
#[derive(Debug)]
pub(crate) struct PyThresholdCurve(ThresholdCurve);

impl PyThresholdCurve {
    fn column<'py>(
        &self,
        py: Python<'py>,
        of: fn(&ThresholdPoint) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        self.0.points().iter().map(of).collect::<Vec<f64>>().to_pyarray(py)
    }
}

#[pymethods]
impl PyThresholdCurve {
    /// Returns the curve of answers, from their confidences and truth values. `positives` is the
    /// number of queries that have a right answer, by default all.
    #[staticmethod]
    #[pyo3(signature = (confidence, right, positives=None))]
    fn precision_recall(
        confidence: &Bound<'_, PyAny>,
        right: &Bound<'_, PyAny>,
        positives: Option<Size>,
    ) -> PyResult<Self> {
        let answers = judged(confidence, right)?;
        let positives = positives.map_or(answers.len(), |size| size.0);
        Ok(Self(ThresholdCurve::precision_recall(&answers, positives).map_err(invalid)?))
    }

    /// Returns the receiver operating characteristic of scores, from truth values that are true for
    /// positives.
    #[staticmethod]
    fn roc(scores: &Bound<'_, PyAny>, positive: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self(ThresholdCurve::roc(&judged(scores, positive)?).map_err(invalid)?))
    }

    /// Returns the largest recall at a precision of at least `level`; 0 if there is none.
    fn recall_at_precision(&self, level: f64) -> PyResult<f64> {
        self.0.recall_at_precision(level).map_err(invalid)
    }

    /// Thresholds, from the highest down.
    #[getter]
    fn thresholds<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |point| point.threshold)
    }

    /// Precision at each threshold.
    #[getter]
    fn precision<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |point| point.precision)
    }

    /// Recall at each threshold.
    #[getter]
    fn recall<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |point| point.recall)
    }

    /// False positive rate at each threshold.
    #[getter]
    fn false_positive_rate<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |point| point.false_positive_rate)
    }

    /// Area under the receiver operating characteristic.
    #[getter]
    fn area(&self) -> f64 {
        self.0.area()
    }

    /// Average precision: the precision at each threshold, weighted by its gain in recall.
    #[getter]
    fn average_precision(&self) -> f64 {
        self.0.average_precision()
    }

    fn __repr__(&self) -> String {
        format!("<ThresholdCurve: {} thresholds>", self.0.points().len())
    }
}
