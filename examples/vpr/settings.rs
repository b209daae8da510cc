//! What both examples do with a recording.

use std::ops::Range;
use std::path::PathBuf;

/// Which references are corrected for how they compare with anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Offsets {
    None,
    All,
}

/// What to learn from, how to answer, and what to report.
#[derive(Debug, Clone, Default)]
pub(crate) struct Settings {
    /// The steps whose truth may be used: in order, apart from each other; none
    /// with a saved fit.
    pub(crate) fit_on: Vec<Range<usize>>,
    /// The steps that results are reported on: in order, none learned from.
    pub(crate) report_on: Vec<usize>,
    /// How many steps later a fixed-lag answer is due.
    pub(crate) lag: usize,
    /// Model places that are not on the map.
    pub(crate) off_map: bool,
    /// How far a right answer may lie from the truth, in references; at least
    /// one, each once. The fit does not depend on them.
    pub(crate) tolerances: Vec<usize>,
    /// Where to write the fit.
    pub(crate) save: Option<PathBuf>,
    /// The saved fit to be used.
    pub(crate) fit: Option<PathBuf>,
    /// The temperature of the camera, rather than one that is learned.
    pub(crate) temperature: Option<f64>,
    /// The offsets of the references, rather than those of all.
    pub(crate) offsets: Option<Offsets>,
    /// The speeds of the vehicle in references per step, ascending; none: those
    /// that are built in.
    pub(crate) speeds: Vec<f64>,
}
