//! How far a query is, on standard error.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::query::QueryState;

const SECOND: Duration = Duration::from_secs(1);

/// Way to say how far a query is.
pub(super) enum Shown {
    /// Not at all.
    Nothing,
    /// A bar, if standard error is a terminal.
    Bar(ProgressBar),
    /// A line for each part, or each second without parts; the time of the last one.
    Lines(Instant),
}

impl Shown {
    pub(super) fn bar() -> Self {
        let bar = ProgressBar::no_length();
        bar.enable_steady_tick(Duration::from_millis(500));
        Self::Bar(bar)
    }

    pub(super) fn show(&mut self, state: &QueryState) {
        // Standard error may be closed.
        match (self, state) {
            (Self::Nothing, _) => {}
            (Self::Bar(bar), QueryState::Whole(reason)) => bar.suspend(|| {
                _ = writeln!(io::stderr(), "{}", whole(reason));
            }),
            (Self::Bar(bar), QueryState::Rows { done, all, made }) => {
                let style = match all {
                    Some(_) => "{wide_bar} {pos}/{len} rows, {msg}, {eta} left",
                    None => "{spinner} {msg}",
                };
                if (bar.length() != *all || bar.message().is_empty())
                    && let Ok(style) = ProgressStyle::with_template(style)
                {
                    bar.set_style(style);
                }
                all.iter().for_each(|&all| bar.set_length(all));
                bar.set_position(*done);
                bar.set_message(format!("{made} rows made"));
            }
            (Self::Lines(_), QueryState::Whole(reason)) => {
                _ = writeln!(io::stderr(), "{}", whole(reason));
            }
            (Self::Lines(last), QueryState::Rows { done, all, made }) => {
                if let Some(all) = all {
                    _ = writeln!(io::stderr(), "{done} of {all} rows, {made} rows made");
                } else if last.elapsed() >= SECOND {
                    _ = writeln!(io::stderr(), "{made} rows made");
                    *last = Instant::now();
                }
            }
        }
    }

    pub(super) fn end(self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

fn whole(reason: &str) -> String {
    format!("an interruption starts this query over: {reason}")
}
