//! What both examples do with a recording.

use std::ops::Range;

/// What to learn from, how to answer, and what to report.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// The steps whose truth may be used: in order, apart from each other.
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
}
