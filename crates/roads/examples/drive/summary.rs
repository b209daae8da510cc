//! Figures over all drives, printed and as a file.

use std::error::Error;
use std::path::Path;

use wayfix::evaluate::expected_calibration_error;

use super::roads::measures::{ESTIMATORS, Forecasts, Lengths};
use super::roads::off_road::OffRoad;
use super::roads::{self, cannot_write};

/// Sums over drives.
#[derive(Default)]
pub(crate) struct Total {
    pub(crate) drives: usize,
    pub(crate) points: usize,
    /// Points of the file that were skipped.
    pub(crate) skipped: usize,
    /// Names of drives that could not be matched, with the reasons.
    pub(crate) failed: Vec<String>,
    pub(crate) candidates: f64,
    /// Seconds of matching, summed over all threads.
    pub(crate) seconds: f64,
    pub(crate) threads: usize,
    /// Seconds from start to end, including output.
    pub(crate) elapsed: f64,
    pub(crate) metres: f64,
    /// Metres off the road.
    pub(crate) off_road: f64,
    pub(crate) with_truth: usize,
    pub(crate) lengths: Lengths,
    pub(crate) forecasts: Forecasts,
    pub(crate) points_off_road: OffRoad,
    /// Mismatch of each drive, and its name.
    pub(crate) worst: Vec<(f64, String)>,
}

/// Names of figures, in the order of the estimators.
const RIGHT: [&str; 3] = [
    "points on the true route, live",
    "points on the true route, late",
    "points on the true route, smoothed",
];
const ERROR: [&str; 3] =
    ["stated against right, live", "stated against right, late", "stated against right, smoothed"];

/// Largest number of drives that are named.
const NAMED: usize = 5;

/// Prints and writes the figures.
pub(crate) fn report(total: &Total, out: &Path) -> Result<(), Box<dyn Error>> {
    let Total { drives, points, lengths, .. } = total;
    // No drives and no metres give 0, not NaN.
    let share_off = total.off_road / (total.off_road + total.metres).max(1e-9);
    let mut rows = vec![
        ("drives", drives.to_string()),
        ("drives failed", total.failed.len().to_string()),
        ("points", points.to_string()),
        ("points skipped", total.skipped.to_string()),
        ("candidates per point", format!("{:.2}", total.candidates / *points as f64)),
        ("points per second and core", format!("{:.0}", *points as f64 / total.seconds)),
        ("threads", total.threads.to_string()),
        ("seconds with output", format!("{:.2}", total.elapsed)),
        ("km matched", format!("{:.2}", total.metres / 1000.0)),
        ("share of length off the road", format!("{share_off:.4}")),
    ];
    let mut table = String::new();
    if total.with_truth > 0 {
        rows.extend([
            ("drives with a truth", total.with_truth.to_string()),
            ("km of true routes", format!("{:.2}", lengths.truth / 1000.0)),
            ("route mismatch", format!("{:.4}", lengths.mismatch())),
            ("length added", format!("{:.4}", lengths.added / lengths.truth)),
            ("length missed", format!("{:.4}", lengths.missed / lengths.truth)),
            ("share of length right", format!("{:.4}", lengths.found())),
        ]);
        let right = total.forecasts.right();
        rows.extend((0..ESTIMATORS.len()).map(|n| (RIGHT[n], format!("{:.4}", right[n]))));
        let diagrams = total.forecasts.reliability()?;
        let error = |n: usize| format!("{:.4}", expected_calibration_error(&diagrams[n]));
        rows.extend((0..ESTIMATORS.len()).map(|n| (ERROR[n], error(n))));
        let mut worst: Vec<&(f64, String)> = total.worst.iter().collect();
        // Report the worst cases beside the means.
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let named =
            worst.iter().take(NAMED).map(|(mismatch, name)| format!("{name} ({mismatch:.3})"));
        let named: Vec<String> = named.collect();
        table = format!(
            "\nlargest mismatch: drives {}\n{}\n\
             The truth tells the roads, not which one at each point. An answer on any of them is right,\n\
             so more are right than the probability of the single road says.\n{}",
            named.join(", "),
            total.points_off_road,
            total.forecasts.table()?
        );
    }
    let mut file = csv::Writer::from_path(out.join("summary.csv"))
        .map_err(|error| cannot_write(out, error))?;
    file.write_record(["measure", "value"])?;
    for (name, value) in &rows {
        file.write_record([*name, value])?;
    }
    file.flush().map_err(|error| cannot_write(out, error))?;
    let lines = rows.iter().map(|(name, value)| format!("{name:<36} {value:>10}\n"));
    roads::print(&format!("\n{}{table}\n", lines.collect::<String>()))?;
    let failures = total.failed.iter().take(NAMED).map(|name| format!("failed: drive {name}\n"));
    roads::print(&failures.collect::<String>())?;
    if total.failed.len() > NAMED {
        roads::print(&format!("failed: {} more drives\n", total.failed.len() - NAMED))?;
    }
    if *drives == 0 {
        return Err("no drive could be matched".into());
    }
    roads::print(&format!(
        "Wrote route.csv, points.csv, route.geojson, drive.svg and summary.csv into {}\n",
        out.display()
    ))?;
    Ok(())
}
