//! Matches recorded GPS drives to the roads of a network: the route and the road at each point,
//! with probabilities.
//!
//! ```text
//! cargo run --release -p wayfix-roads --all-features --example drive -- --roads city.osm.pbf --trace drives.csv
//! ```
//!
//! Without files, drives are simulated in a small made-up city, and written to files beside the
//! results.

#[path = "../roads/mod.rs"]
mod roads;

mod files;
mod fit;
mod made_up;
mod run;
mod summary;
mod truth;

use std::error::Error;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread;
use std::time::Instant;

use clap::Parser;
use wayfix_roads::matching::{MatchModel, Matcher, Trace, read_traces};
use wayfix_roads::{Cleaning, ImportOptions, RoadNetwork};

use truth::{Truth, Truths};

/// Matches GPS drives to roads. Writes the routes (route.csv, route.geojson), the road at each
/// point (points.csv), a picture of a drive (drive.svg), and measures (summary.csv).
#[derive(Parser)]
struct Arguments {
    /// Roads: a folder with nodes.csv and edges.csv, a GeoJSON file, or an OpenStreetMap extract
    /// (.osm.pbf).
    #[arg(long, value_name = "FILE|FOLDER", requires = "trace")]
    roads: Option<PathBuf>,
    /// Drives: GPX, GeoJSON, or CSV with trace,time,longitude,latitude[,accuracy,heading,speed], in
    /// seconds or dates with times (2024-05-01T12:00:00Z), degrees, metres and metres per second.
    #[arg(long, value_name = "FILE", requires = "roads")]
    trace: Option<PathBuf>,
    /// True routes: trace,order,from,to[,enter_m,exit_m,time], with nodes as in the roads, both
    /// empty off the road, and the time of the first point there.
    #[arg(long, value_name = "FILE", requires = "trace")]
    truth: Option<PathBuf>,
    /// Keep the largest part of the roads whose nodes can all reach one another.
    #[arg(long)]
    largest: bool,
    /// Remove nodes that roads only pass through; a truth may name them.
    #[arg(long, conflicts_with = "truth")]
    contract: bool,
    /// Take every K-th point of each drive.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = roads::whole, allow_negative_numbers = true)]
    every: usize,
    /// Number of points by which late answers are late.
    #[arg(long, value_name = "POINTS", default_value_t = 3)]
    late: usize,
    /// Standard deviation of a position in each direction [default: learned from the drives, with
    /// the rest of the model].
    #[arg(long, value_name = "METRES", value_parser = roads::positive, allow_negative_numbers = true)]
    noise: Option<f64>,
    /// Probability of leaving the road within a second [default: learned with the rest].
    #[arg(long, value_name = "PROBABILITY", value_parser = roads::positive, allow_negative_numbers = true)]
    leave_road: Option<f64>,
    /// Number of threads [default: one for each core].
    #[arg(long, value_parser = roads::whole, allow_negative_numbers = true)]
    threads: Option<usize>,
    /// Drive to draw [default: the first].
    #[arg(long, value_name = "NAME")]
    picture: Option<String>,
    /// Output folder.
    #[arg(long, default_value = "target/drive")]
    out: PathBuf,
}

fn main() -> ExitCode {
    roads::exit_code(run(&Arguments::parse()))
}

/// A drive with every K-th point, and its true route, if known.
struct Drive {
    trace: Trace,
    /// Points left out after the last one kept.
    tail: Vec<wayfix_roads::matching::TracePoint>,
    truth: Option<Truth>,
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let out = &arguments.out;
    roads::create_folder(out)?;
    let (road_path, trace_path, truth_path) =
        if let (Some(roads), Some(trace)) = (&arguments.roads, &arguments.trace) {
            (roads.clone(), trace.clone(), arguments.truth.clone())
        } else {
            // Files, too, so that the run without arguments takes the same path as one with a
            // user's data.
            made_up::write(out)?;
            roads::print(&format!(
                "{}: wrote nodes.csv, edges.csv, trace.csv and truth.csv into {}\n",
                roads::town::NAME,
                out.display()
            ))?;
            (out.clone(), out.join("trace.csv"), Some(out.join("truth.csv")))
        };
    let start = Instant::now();
    let mut cleaning = Vec::new();
    cleaning.extend(arguments.largest.then_some(Cleaning::LargestComponent));
    cleaning.extend(arguments.contract.then_some(Cleaning::Contraction));
    let options = ImportOptions::default().with_cleaning(cleaning);
    let (network, report) = RoadNetwork::from_path(&road_path, &options)?;
    roads::print(&format!("{report}\n"))?;
    let (traces, read) = read_traces(&trace_path)?;
    check(&traces, &trace_path, &network)?;
    let truths = truth_path.map(|path| Truths::read(&path, &network, &traces)).transpose()?;
    let drives = thinned(traces, truths.unwrap_or_default(), arguments.every);
    if let Some(name) = &arguments.picture
        && drives.iter().all(|drive| drive.trace.name != *name)
    {
        return Err(format!("--picture {name}: {} has no such drive", trace_path.display()).into());
    }
    let mut matcher = Matcher::new(network);
    roads::print(&format!(
        "read {} drives and built the index in {:.2} s; {read}{}\n",
        drives.len(),
        start.elapsed().as_secs_f64(),
        most_skipped(&drives)
    ))?;
    matcher = match arguments.noise {
        Some(noise) => {
            let model = MatchModel { noise, ..*matcher.model() };
            matcher.with_model(model)?
        }
        None => fit::fit(matcher, &drives)?,
    };
    // After learning, which it overrides.
    if let Some(leave_road) = arguments.leave_road {
        let model = MatchModel { leave_road, ..*matcher.model() };
        matcher = matcher.with_model(model)?;
    }
    let cores = thread::available_parallelism().map_or(1, NonZeroUsize::get);
    // The matcher is shared; more threads than drives would be idle.
    let threads = arguments.threads.unwrap_or(cores).min(drives.len());
    let picture = arguments.picture.as_ref().unwrap_or(&drives[0].trace.name);
    let mut total = run::run(&matcher, &drives, [threads, arguments.late], picture, out)?;
    total.skipped = read.repeated + read.backwards;
    summary::report(&total, out)?;
    Ok(())
}

/// Names the drives with the most points left out; empty if there are none.
fn most_skipped(drives: &[Drive]) -> String {
    const NAMED: usize = 5;
    let skipped = |drive: &Drive| drive.trace.repeated + drive.trace.backwards;
    let mut most: Vec<&Drive> = drives.iter().filter(|drive| skipped(drive) > 0).collect();
    most.sort_by_key(|drive| std::cmp::Reverse(skipped(drive)));
    let named = most.iter().take(NAMED);
    let named = named.map(|drive| format!("{} of drive {}", skipped(drive), drive.trace.name));
    let named: Vec<String> = named.collect();
    if named.is_empty() { String::new() } else { format!("\nmost skipped: {}", named.join(", ")) }
}

/// Checks that some point is near the roads: files of another region or with swapped axes fail here
/// rather than off the road everywhere.
fn check(traces: &[Trace], path: &Path, network: &RoadNetwork) -> Result<(), String> {
    let path = path.display();
    let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for position in network.nodes().iter().map(|node| node.position) {
        for (axis, value) in [position.longitude, position.latitude].into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    let is_in = |values: [f64; 2]| {
        // A tenth of a degree, some 10 km, around the roads.
        (0..2).all(|axis| (low[axis] - 0.1..=high[axis] + 0.1).contains(&values[axis]))
    };
    let values = || {
        let points = traces.iter().flat_map(|trace| &trace.points);
        points.map(|point| [point.position.longitude, point.position.latitude])
    };
    if values().any(is_in) {
        return Ok(());
    }
    // The usual reason why no point is near.
    let swapped = values().any(|[longitude, latitude]| is_in([latitude, longitude]));
    let hint = if swapped { "; longitude and latitude seem to be swapped" } else { "" };
    Err(format!(
        "{path}: no point is near the roads, expected longitudes from {:.4} to {:.4} and latitudes from {:.4} to {:.4}{hint}",
        low[0], high[0], low[1], high[1]
    ))
}

/// Keeps every K-th point of each drive.
fn thinned(traces: Vec<Trace>, mut truths: Truths, every: usize) -> Vec<Drive> {
    let thin = |trace: Trace| {
        let truth = truths.take(&trace.name);
        // Index of the last point kept: the largest multiple of K in range.
        let last = (trace.points.len().max(1) - 1) / every * every;
        let tail = trace.points.get(last + 1..).unwrap_or_default().to_vec();
        let points = trace.points.into_iter().step_by(every).collect();
        Drive { trace: Trace { points, ..trace }, tail, truth }
    };
    traces.into_iter().map(thin).collect()
}
