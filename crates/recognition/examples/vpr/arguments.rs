//! Command-line options shared by both examples.

use std::{num::NonZeroUsize, ops::Range, path::PathBuf};

use super::Recording;

/// Options for learning, answering and reporting.
#[derive(Debug, clap::Args)]
pub(crate) struct Common {
    /// Labelled steps to learn from, as FIRST..END,... [default: the first third].
    #[arg(long, value_name = "RANGES", value_delimiter = ',', value_parser = span, allow_hyphen_values = true)]
    pub(crate) fit_on: Vec<Range<usize>>,
    /// Steps to report results on [default: all that are not learned from].
    #[arg(long, value_name = "RANGES", value_delimiter = ',', value_parser = span, allow_hyphen_values = true)]
    pub(crate) report_on: Vec<Range<usize>>,
    /// Learn nothing: use the defaults, and report on all steps.
    #[arg(long, conflicts_with_all = ["fit_on", "fit", "save"])]
    pub(crate) no_fit: bool,
    /// Delay of fixed-lag answers, in steps.
    #[arg(long, value_name = "STEPS", default_value_t = 20)]
    pub(crate) lag: usize,
    /// Model that the vehicle may leave the map.
    #[arg(long)]
    pub(crate) off_map: bool,
    /// Number of references beside the right ones that still count as right.
    #[arg(long, value_name = "REFERENCES", default_value = "1,10", value_delimiter = ',')]
    pub(crate) tolerance: Vec<usize>,
    /// The references form a closed route.
    #[arg(long = "loop")]
    pub(crate) closed: bool,
    /// SeqSLAM: number of steps of a line [default: the best of 10, 20, 50 and 100 by recall, to
    /// its advantage].
    #[arg(long, value_name = "STEPS")]
    pub(crate) sequence: Option<NonZeroUsize>,
    /// SeqSLAM: the slopes of a line, in references per step.
    #[arg(
        long,
        value_name = "SPEEDS",
        default_value = "0.8,0.9,1,1.1,1.2",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    pub(crate) velocities: Vec<f64>,
    /// SeqSLAM: number of references on either side for local contrast.
    #[arg(long, value_name = "REFERENCES", default_value_t = 10)]
    pub(crate) contrast: usize,
    /// Write what was learned to a file, as JSON (with the feature serde).
    #[arg(long, value_name = "FILE", conflicts_with = "fit")]
    pub(crate) save: Option<PathBuf>,
    /// Use a saved fit instead of learning, and report on all steps (with the feature serde).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fit_on", "speeds"])]
    pub(crate) fit: Option<PathBuf>,
    /// Speeds that the vehicle may have, in references per step [default: 15 from -2 to 3].
    #[arg(long, value_name = "LIST", value_delimiter = ',', allow_hyphen_values = true)]
    pub(crate) speeds: Vec<f64>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Folder for answers, tables and pictures [default: target/ and the example's name].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// Steps to learn from, as sorted and separate ranges of labelled steps, and other steps to report
/// on; both empty if the truth is unknown.
#[derive(Debug, Default)]
pub(crate) struct Split {
    pub(crate) fit_on: Vec<Range<usize>>,
    pub(crate) report_on: Vec<usize>,
    /// Half the usual length of labels: references on either side of their middle also count as
    /// right.
    pub(crate) width: usize,
}

/// Parses FIRST..END, a range without its end that must not be empty.
pub(crate) fn span(text: &str) -> Result<Range<usize>, String> {
    let ends = text.trim().split_once("..");
    let range = ends.and_then(|(first, end)| Some(first.parse().ok()?..end.parse().ok()?));
    let range = range.filter(|range: &Range<usize>| !range.is_empty());
    range.ok_or_else(|| String::from("expected FIRST..END with FIRST below END, as in 0..600"))
}

impl Common {
    /// Chooses the steps of a recording to learn from and to report on.
    pub(crate) fn split(&self, recording: &Recording) -> Result<Split, String> {
        let steps = recording.steps();
        let Some(truth) = &recording.truth else {
            let free = self.fit_on.is_empty() && self.report_on.is_empty() && self.save.is_none();
            let what = || "--fit-on, --report-on and --save: expected a truth".into();
            return free.then(Split::default).ok_or_else(what);
        };
        let mut fit_on = match &self.fit_on[..] {
            [] if self.fit.is_some() || self.no_fit => Vec::new(),
            [] => vec![0..steps / 3; 1],
            ranges => ranges.to_vec(),
        };
        fit_on.sort_by_key(|range| range.start);
        // Steps that were learned from must not be reported on: their answers would flatter.
        let learned = |step: &usize| fit_on.iter().any(|range| range.contains(step));
        let mut report_on: Vec<usize> = match &self.report_on[..] {
            [] => (0..steps).filter(|step| !learned(step)).collect(),
            ranges => ranges.iter().cloned().flatten().collect(),
        };
        report_on.sort_unstable();
        report_on.dedup();
        if let Some(range) = self.fit_on.iter().chain(&self.report_on).find(|r| r.end > steps) {
            return Err(format!("{range:?} of {steps} steps, expected an end up to {steps}"));
        }
        if let Some(step) = report_on.iter().find(|step| learned(step)) {
            return Err(format!("--report-on: step {step} is learned from, expected others"));
        }
        if report_on.iter().all(|step| truth[*step].is_none()) {
            let count = report_on.len();
            return Err(format!("{count} steps to report on, expected one that is on the map"));
        }
        let labels = truth.iter().flatten();
        let mut lengths: Vec<usize> = labels.map(|range| range.end() - range.start()).collect();
        lengths.sort_unstable();
        let width = lengths.get(lengths.len() / 2).map_or(0, |length| length / 2);
        Ok(Split { fit_on, report_on, width })
    }
}
