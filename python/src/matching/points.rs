//! Points of drives, from arrays.

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use wayfix::map::Position;
use wayfix_roads::matching::TracePoint;

use crate::array::doubles;
use crate::error::invalid;

/// Creates a point. NaN is unknown in `others`; in time and position the library refuses it.
pub(super) fn point(time: f64, position: [f64; 2], others: [f64; 3]) -> TracePoint {
    let [latitude, longitude] = position;
    let [accuracy, heading, speed] = others.map(|value| (!value.is_nan()).then_some(value));
    TracePoint { time, position: Position { latitude, longitude }, accuracy, heading, speed }
}

/// Reads a time, in seconds or as a date, as in frames.
pub(super) fn moment(time: &Bound<'_, PyAny>) -> PyResult<f64> {
    // The usual case of a live vehicle needs no call into Python.
    if let Ok(seconds) = time.extract() {
        return Ok(seconds);
    }
    time.py().import("wayfix._frames")?.call_method1("moment", (time,))?.extract()
}

/// Columns of points, before their types are checked.
#[derive(Debug, FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct Columns<'py> {
    time: Bound<'py, PyAny>,
    lat: Bound<'py, PyAny>,
    lon: Bound<'py, PyAny>,
    accuracy: Option<Bound<'py, PyAny>>,
    heading: Option<Bound<'py, PyAny>>,
    speed: Option<Bound<'py, PyAny>>,
}

impl Columns<'_> {
    /// Finds the columns in a data frame, a dictionary or the like.
    pub(super) fn read<'py>(points: &Bound<'py, PyAny>) -> PyResult<Columns<'py>> {
        let frames = points.py().import("wayfix._frames")?;
        frames.call_method1("point_columns", (points,))?.extract()
    }

    /// Returns the points.
    pub(super) fn points(&self) -> PyResult<Vec<TracePoint>> {
        let time = doubles(&self.time, "times")?;
        let count = time.as_slice().map_err(invalid)?.len();
        let read = |values: &Bound<'_, PyAny>, what: &str| -> PyResult<Vec<f64>> {
            let array: PyReadonlyArray1<'_, f64> = doubles(values, what)?;
            let values = array.as_slice().map_err(invalid)?;
            if values.len() != count {
                return Err(invalid(format!("found {} {what}, expected {count}", values.len())));
            }
            Ok(values.to_vec())
        };
        // A missing column is one of unknown values.
        let optional = |values: &Option<Bound<'_, PyAny>>, what: &str| match values {
            Some(values) => read(values, what),
            None => Ok(vec![f64::NAN; count]),
        };
        let (lat, lon) = (read(&self.lat, "latitudes")?, read(&self.lon, "longitudes")?);
        let accuracy = optional(&self.accuracy, "accuracies")?;
        let heading = optional(&self.heading, "headings")?;
        let speed = optional(&self.speed, "speeds")?;
        let time = time.as_slice().map_err(invalid)?.iter().enumerate();
        let of = |(k, &time): (usize, &f64)| {
            point(time, [lat[k], lon[k]], [accuracy[k], heading[k], speed[k]])
        };
        Ok(time.map(of).collect())
    }
}
