//! Settings of both examples for one recording.

use std::ops::Range;
use std::path::PathBuf;

/// References whose resemblance to everything is corrected for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Offsets {
    None,
    All,
}

/// Settings for learning, answering and reporting.
#[derive(Debug, Clone, Default)]
pub(crate) struct Settings {
    /// Steps whose truth may be used, as sorted and separate ranges; empty with a saved fit.
    pub(crate) fit_on: Vec<Range<usize>>,
    /// Steps that results are reported on, sorted, none of them learned from.
    pub(crate) report_on: Vec<usize>,
    /// Delay of fixed-lag answers, in steps.
    pub(crate) lag: usize,
    /// True to model places that are not on the map.
    pub(crate) off_map: bool,
    /// Distances from the truth at which an answer is still right, in references; at least one,
    /// without duplicates. The fit does not depend on them.
    pub(crate) tolerances: Vec<usize>,
    /// File to write the fit to.
    pub(crate) save: Option<PathBuf>,
    /// Saved fit to use.
    pub(crate) fit: Option<PathBuf>,
    /// Temperature of the camera, instead of a learned one.
    pub(crate) temperature: Option<f64>,
    /// Offsets of the references, instead of those of all.
    pub(crate) offsets: Option<Offsets>,
    /// Speeds of the vehicle in references per step, ascending; empty for the built-in ones.
    pub(crate) speeds: Vec<f64>,
}
