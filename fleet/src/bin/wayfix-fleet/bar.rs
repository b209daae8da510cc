//! The bar that shows progress.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use wayfix_fleet::Progress;

pub(crate) fn bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::no_length();
    let style = "{wide_bar} {pos}/{len} rows, {msg}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(style) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

pub(crate) fn show(bar: &ProgressBar, progress: &Progress) {
    if let Some(rows) = progress.all_rows {
        bar.set_length(rows);
    }
    bar.set_position(progress.rows);
    bar.set_message(format!("{} drives", progress.drives));
}
