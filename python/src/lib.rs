//! The compiled part of the Python package `wayfix`: arrays in, arrays out, and the global lock
//! released meanwhile. What it does is the library's; nothing is computed here.

mod array;
mod arrow;
mod densities;
mod error;
mod evaluate;
mod few;
mod filter;
mod fixed_lag;
mod kinds;
mod learning;
mod many;
mod matching;
mod model;
mod options;
mod parts;
mod recognition;
mod results;
mod sequences;
mod signals;
mod typed;

use pyo3::prelude::*;

#[pymodule]
mod _wayfix {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::arrow::{arrow_stream, read_arrow};
    #[pymodule_export]
    use crate::densities::{gaussian_log_densities, poisson_log_densities};
    #[pymodule_export]
    use crate::error::{Error, ImpossibleError};
    #[pymodule_export]
    use crate::evaluate::{PyThresholdCurve, recall_within, reliability};
    #[pymodule_export]
    use crate::filter::PyFilter;
    #[pymodule_export]
    use crate::fixed_lag::PyFixedLag;
    #[pymodule_export]
    use crate::learning::{PyFamily, PyLearned, learn};
    #[pymodule_export]
    use crate::matching::{
        PyLearnedMatchModel, PyMatchedDrive, PyMatcher, PyRankedRoutes, PyRoadAnswer,
        PyRoadAnswers, PyRoadNetwork, PyStretches, PyVehicle, read_traces,
    };
    #[pymodule_export]
    use crate::model::PyHmm;
    #[pymodule_export]
    use crate::recognition::{
        PyAnswer, PyMapper, PyPlaceBeliefs, PyRecognizer, PyRecording, PyTrack,
    };
    #[pymodule_export]
    use crate::results::{PyPath, PySmoothed};
    #[pymodule_export]
    use crate::sequences::{expectations, log_likelihoods, rows_sum_to_one, smooth, viterbi};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
