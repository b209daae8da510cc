//! The paper's experiment: the accuracy of filter and smoother on a drive of 50 steps through
//! central Canberra.
//!
//! ```text
//! cargo run --release --example canberra -- [--runs 2000] [--seed 1] [--out target/canberra]
//! ```
//!
//! Prints Table 1 beside the paper's values, and writes tables (CSV), pictures (SVG), a page that
//! shows them (index.html), and a page that replays the first drives (replay.html) to the output
//! folder.

mod experiment;
mod figures;
mod layout;
mod matrix;
mod moment;
mod page;
mod replay;

use std::error::Error;
use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use wayfix::canberra;

use experiment::{ESTIMATORS, Estimator, Row, SETTINGS, STEPS, Setting};

/// Reproduces Table 1 of "Visual Place Recognition" as distributions.
#[derive(Parser)]
struct Arguments {
    /// Number of drives to simulate for each setting.
    #[arg(long, default_value = "2000", value_parser = count)]
    runs: NonZeroUsize,
    /// Seed of the random drives.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Output folder for tables, pictures and pages.
    #[arg(long, default_value = "target/canberra")]
    out: PathBuf,
}

fn count(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| String::from("expected a whole number above 0"))
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(Arguments { runs, seed, out }: Arguments) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(&out).map_err(|e| format!("cannot create {}: {e}", out.display()))?;

    let map = canberra::map();
    let bar = ProgressBar::new((SETTINGS.len() * runs.get()) as u64);
    bar.set_style(ProgressStyle::with_template(
        "{msg:20} {bar:40} {pos}/{len} drives, {eta} left",
    )?);
    let mut rows = Vec::new();
    for setting in &SETTINGS {
        bar.set_message(setting.to_string());
        rows.extend(setting.run(&map, runs, seed, || bar.inc(1))?);
    }
    bar.finish_and_clear();

    print_tables(&rows, runs, seed);
    let in_folder = |error: &dyn Error| format!("cannot write into {}: {error}", out.display());
    write_table1(&out.join("table1.csv"), &rows, runs).map_err(|e| in_folder(&e))?;
    write_errors(&out.join("errors.csv"), &rows).map_err(|e| in_folder(&e))?;
    write_drives(&out.join("drives.csv"), &rows).map_err(|e| in_folder(&e))?;
    let figures = figures::draw_all(&out, &map, &rows, seed).map_err(|e| in_folder(&*e))?;
    let page = page::html(&rows, &figures, runs, seed);
    fs::write(out.join("index.html"), page).map_err(|e| in_folder(&e))?;
    let replay = replay::html(&map, runs, seed)?;
    fs::write(out.join("replay.html"), replay).map_err(|e| in_folder(&e))?;
    println!("\nWrote tables, {} pictures and {}", figures.len(), out.join("index.html").display());
    println!("Replay of the first drives: {}", out.join("replay.html").display());
    Ok(())
}

fn print_tables(rows: &[Row], runs: NonZeroUsize, seed: u64) {
    println!(
        "A reconstruction of Table 1: accuracy over {STEPS} steps, {runs} drives for each setting, \
         seed {seed}.\n\
         The central 95% are those of single drives, like each of the paper's figures.\n"
    );
    println!("start  sigma  estimator        mean  std.err.  central 95%    paper");
    for row in rows {
        let Setting { initial, sigma, .. } = row.setting;
        let paper = row.paper().map_or(String::from("-"), |paper| format!("{paper:.2}"));
        println!(
            "{initial:5}  {sigma:5}  {:<12}  {:7.4}  {:8.4}  {:.2} to {:.2}  {paper:>7}",
            row.estimator, row.mean, row.std_error, row.lo95, row.hi95
        );
    }
    println!("\nstart  sigma  estimator     error: hops  metres           legal drives");
    for row in rows {
        let Setting { initial, sigma, .. } = row.setting;
        println!(
            "{initial:5}  {sigma:5}  {:<12}  {:11.3}  {:6.1}  {:20.1}%",
            row.estimator,
            row.hops,
            row.metres,
            100.0 * row.legal
        );
    }
}

fn write_table1(path: &Path, rows: &[Row], runs: NonZeroUsize) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(path)?;
    file.write_record([
        "initial",
        "sigma",
        "steps",
        "runs",
        "estimator",
        "mean",
        "std_error",
        "lo95",
        "hi95",
        "paper",
    ])?;
    for row in rows {
        file.write_record([
            row.setting.initial.to_string(),
            row.setting.sigma.to_string(),
            STEPS.to_string(),
            runs.to_string(),
            row.estimator.column(),
            format!("{:.6}", row.mean),
            format!("{:.6}", row.std_error),
            format!("{:.2}", row.lo95),
            format!("{:.2}", row.hi95),
            row.paper().map_or(String::new(), |paper| format!("{paper:.2}")),
        ])?;
    }
    Ok(file.flush()?)
}

/// Writes one line per drive, numbered from 1, with the accuracy of each estimator.
fn write_drives(path: &Path, rows: &[Row]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(path)?;
    let estimators = ESTIMATORS.map(Estimator::column);
    file.write_record(
        ["initial", "sigma", "drive"].into_iter().map(String::from).chain(estimators),
    )?;
    // Rows come setting by setting, with the estimators in their fixed order.
    for rows in rows.chunks(ESTIMATORS.len()) {
        let Setting { initial, sigma, .. } = rows[0].setting;
        for run in 0..rows[0].accuracies.len() {
            let drive = [initial.to_string(), sigma.to_string(), (run + 1).to_string()];
            let accuracies = rows.iter().map(|row| format!("{:.2}", row.accuracies[run]));
            file.write_record(drive.into_iter().chain(accuracies))?;
        }
    }
    Ok(file.flush()?)
}

fn write_errors(path: &Path, rows: &[Row]) -> Result<(), csv::Error> {
    let mut file = csv::Writer::from_path(path)?;
    file.write_record([
        "initial",
        "sigma",
        "estimator",
        "mean_hops",
        "mean_metres",
        "legal_drives",
    ])?;
    for row in rows {
        file.write_record([
            row.setting.initial.to_string(),
            row.setting.sigma.to_string(),
            row.estimator.column(),
            format!("{:.6}", row.hops),
            format!("{:.3}", row.metres),
            format!("{:.6}", row.legal),
        ])?;
    }
    Ok(file.flush()?)
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "start {}, sigma {}", self.initial, self.sigma)
    }
}

impl Estimator {
    /// Name of the estimator in CSV files.
    fn column(self) -> String {
        self.to_string().to_lowercase().replace(' ', "_")
    }
}

impl std::fmt::Display for Estimator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Raw => "sensor alone",
            Self::Filter => "filter",
            Self::Smoother => "smoother",
            Self::Viterbi => "Viterbi",
        })
    }
}
