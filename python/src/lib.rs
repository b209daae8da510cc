//! The compiled part of the Python package `wayfix`: arrays in, arrays out, with the global lock
//! released in between. All computation is the library's; this crate only converts and checks.

mod array;
mod arrow;
mod densities;
mod error;
mod evaluate;
mod filter;
mod fixed_lag;
mod kinds;
mod learning;
mod live;
mod many;
mod matching;
mod model;
mod options;
mod parts;
mod recognition;
mod recorder;
mod results;
mod sequences;
mod typed;
mod watch;

use pyo3::prelude::*;

#[pymodule]
mod _wayfix {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::arrow::{arrow_stream, read_arrow};
    #[pymodule_export]
    use crate::densities::{diagonal_log_densities, gaussian_log_densities, poisson_log_densities};
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
    use crate::sequences::{are_distributions, expectations, log_likelihoods, smooth, viterbi};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::error::add_attributes(module.py())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
