//! The progress bar.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use wayfix_fleet::Progress;

pub(crate) fn bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::no_length();
    set_style(&bar, "{spinner} {msg}");
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

pub(crate) fn show(bar: &ProgressBar, progress: &Progress) {
    let Progress { rows, all_rows, drives, .. } = *progress;
    show_rows(bar, rows, all_rows, format!("{drives} drives"));
}

/// Shows the number of rows done, out of all if that is known.
pub(crate) fn show_rows(bar: &ProgressBar, done: u64, all: Option<u64>, message: String) {
    // The bar starts as a spinner: the number of rows is only known once the footers are read, and
    // never for CSV.
    if let Some(all) = all
        && bar.length() != Some(all)
    {
        set_style(bar, "{wide_bar} {pos}/{len} rows, {msg}, {eta} left");
        bar.set_length(all);
    }
    bar.set_position(done);
    bar.set_message(message);
}

fn set_style(bar: &ProgressBar, template: &str) {
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
}
