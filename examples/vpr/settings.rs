//! What both examples do with a recording.

use std::ops::Range;
use std::path::PathBuf;

/// What references look like everything, and are corrected for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Offsets {
    None,
    Hubs,
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
    /// The temperature of the camera, rather than one that is fit.
    pub(crate) temperature: Option<f64>,
    /// The offsets of the camera, rather than those that fit best.
    pub(crate) offsets: Option<Offsets>,
    /// The speeds of the vehicle in references per step, each once; none: those
    /// that are built in.
    pub(crate) speeds: Vec<f64>,
}

impl Settings {
    /// An option that the estimator does not take yet, if it was given.
    ///
    /// TO BE WIRED: goes, option by option, as the estimator learns to take them.
    pub(crate) fn not_wired(&self) -> Option<&'static str> {
        let given = [
            ("--save", self.save.is_some()),
            ("--fit", self.fit.is_some()),
            ("--temperature", self.temperature.is_some()),
            ("--offsets", self.offsets.is_some()),
            ("--speeds", !self.speeds.is_empty()),
        ];
        given.into_iter().find(|option| option.1).map(|option| option.0)
    }
}
