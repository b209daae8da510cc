//! Imports a road network, simulates drives in it, and tracks them.
//!
//! ```text
//! cargo run --release -p wayfix-roads --all-features --example city -- --roads city.osm.pbf --largest
//! ```
//!
//! Without a path, a small made-up city is used.

#[path = "../roads/mod.rs"]
mod roads;

mod track;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use plotters::prelude::*;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::evaluate::expected_calibration_error;
use wayfix::map::{Position, RoadClass};
use wayfix_roads::matching::{MatchModel, Matcher};
use wayfix_roads::{Cleaning, ImportOptions, RoadNetwork};

use roads::measures::ESTIMATORS;
use roads::picture::{Canvas, Drawn, draw_drive};
use roads::simulate::{self, Scenario};
use track::Tracked;

/// Imports a road network, summarises it, simulates drives with a GPS receiver, and tracks them,
/// live and afterwards. Writes pictures of the network and of a drive.
#[derive(Parser)]
struct Arguments {
    /// Roads: a folder with nodes.csv and edges.csv, a GeoJSON file, or an OpenStreetMap extract
    /// (.osm.pbf). Without it, a small made-up city is used.
    #[arg(long, value_name = "FILE|FOLDER")]
    roads: Option<PathBuf>,
    /// Cut the network to a box, in degrees.
    #[arg(long = "box", value_name = "W,S,E,N", value_delimiter = ',', allow_hyphen_values = true)]
    corners: Vec<f64>,
    /// Keep the largest part whose nodes can all reach one another.
    #[arg(long)]
    largest: bool,
    /// Remove nodes that roads only pass through.
    #[arg(long)]
    contract: bool,
    /// Merge intersections within a radius in metres.
    #[arg(long, value_name = "METRES", value_parser = roads::positive, allow_negative_numbers = true)]
    merge: Option<f64>,
    /// Number of drives to simulate.
    #[arg(long, default_value_t = 20, value_parser = roads::whole, allow_negative_numbers = true)]
    drives: usize,
    /// Seed of the drives.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Standard deviation of a position in each direction; 3 in 100 are up to 150 m off.
    #[arg(long, value_name = "METRES", default_value = "10", value_parser = roads::positive, allow_negative_numbers = true)]
    noise: f64,
    /// Seconds between two positions.
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = roads::positive, allow_negative_numbers = true)]
    every: f64,
    /// Number of points by which late answers are late.
    #[arg(long, value_name = "POINTS", default_value_t = 3)]
    late: usize,
    /// Output folder.
    #[arg(long, default_value = "target/city")]
    out: PathBuf,
}

fn main() -> ExitCode {
    roads::exit_code(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let Arguments { noise, every, out, .. } = arguments;
    let (noise, every) = (*noise, *every);
    roads::create_folder(out)?;
    let network = import(arguments)?;
    let picture = out.join("city.svg");
    draw_network(&picture, &network).map_err(|error| roads::cannot_write(out, error))?;

    let mut rng = ChaCha8Rng::seed_from_u64(arguments.seed);
    let scenario = Scenario { noise, every, ..Scenario::default() };
    let bar = roads::bar("simulating drives", arguments.drives);
    let mut drives = Vec::new();
    for _ in 0..arguments.drives {
        drives.push(simulate::drive(&network, &scenario, &mut rng)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let points: usize = drives.iter().map(|drive| drive.points.len()).sum();
    roads::print(&format!(
        "simulated {} drives with {points} points, every {every} s, noise {noise} m (seed {})\n",
        drives.len(),
        arguments.seed
    ))?;

    let start = Instant::now();
    let matcher = Matcher::new(network);
    // The simulated noise is known, so nothing is learned.
    let model = MatchModel { noise, ..*matcher.model() };
    let matcher = matcher.with_model(model)?;
    let seconds = start.elapsed().as_secs_f64();
    roads::print(&format!("index of the roads: {seconds:.2} s\n\n"))?;

    let mut total = Tracked::default();
    let bar = roads::bar("tracking", drives.len());
    for (number, drive) in drives.iter().enumerate() {
        let (tracked, matched) = track::track(&matcher, drive, arguments.late)
            .map_err(|error| format!("drive {}: {error}", number + 1))?;
        // One picture is enough: the first drive's.
        if number == 0 {
            let title = "A simulated drive, and the route that was found from its points";
            let file = out.join("drive.svg");
            draw_drive(&file, title, matcher.network(), &matched)
                .map_err(|error| roads::cannot_write(out, error))?;
        }
        total.add(&tracked);
        bar.inc(1);
    }
    bar.finish_and_clear();
    report(&total)?;
    roads::print(&format!("\nWrote city.svg and drive.svg into {}\n", out.display()))?;
    Ok(())
}

/// Reads and cleans the network, and prints a report.
fn import(arguments: &Arguments) -> Result<RoadNetwork, Box<dyn Error>> {
    let mut cleaning = Vec::new();
    match arguments.corners[..] {
        [] => {}
        [west, south, east, north] => cleaning.push(Cleaning::Within([
            Position { latitude: south, longitude: west },
            Position { latitude: north, longitude: east },
        ])),
        _ => return Err("--box needs four numbers, W,S,E,N in degrees".into()),
    }
    // Contraction comes before merging, so that only intersections are merged, and again after it,
    // since merged nodes may be passed through.
    cleaning.extend(arguments.largest.then_some(Cleaning::LargestComponent));
    cleaning.extend(arguments.contract.then_some(Cleaning::Contraction));
    if let Some(metres) = arguments.merge {
        cleaning.push(Cleaning::Merging { metres });
        cleaning.extend(arguments.contract.then_some(Cleaning::Contraction));
    }
    let start = Instant::now();
    let (name, network, report) = if let Some(path) = &arguments.roads {
        let options = ImportOptions::default().with_cleaning(cleaning);
        let (network, report) = RoadNetwork::from_path(path, &options)?;
        (path.display().to_string(), network, report.to_string())
    } else {
        let network = roads::town::network()?;
        let counts =
            format!("built {} nodes, {} edges", network.nodes().len(), network.edges().len());
        let (network, steps) = network.cleaned(&cleaning)?;
        let steps = steps.iter().map(|step| format!("\n{step}"));
        (roads::town::NAME.to_owned(), network, counts + &steps.collect::<String>())
    };
    let seconds = start.elapsed().as_secs_f64();
    // Every step of cleaning prints its counts before → after.
    let is_clean = report.contains('→');
    let note =
        if is_clean { "" } else { "not cleaned (see --largest, --contract, --merge, --box)\n" };
    roads::print(&format!("{name}, in {seconds:.2} s\n{report}\n{note}"))?;
    for (class, name) in CLASSES {
        let of_class = network.edges().iter().filter(|edge| edge.class == class);
        // `sum` of an empty iterator is -0.0.
        let metres = of_class.clone().fold(0.0, |sum, edge| sum + edge.metres);
        let count = of_class.count();
        roads::print(&format!("  {name:<10} {count:8} edges {:10.1} km\n", metres / 1000.0))?;
    }
    if network.edges().is_empty() {
        return Err(format!("{name} has no roads for cars after import").into());
    }
    Ok(network)
}

const CLASSES: [(RoadClass, &str); 4] = [
    (RoadClass::Main, "main"),
    (RoadClass::Arterial, "arterial"),
    (RoadClass::Collector, "collector"),
    (RoadClass::Street, "street"),
];

/// Draws the roads by class.
fn draw_network(file: &Path, network: &RoadNetwork) -> Drawn {
    let style = |class: RoadClass| match class {
        RoadClass::Main => RGBColor(213, 94, 0).stroke_width(3),
        RoadClass::Arterial => RGBColor(230, 159, 0).stroke_width(2),
        RoadClass::Collector => RGBColor(0, 114, 178).stroke_width(1),
        RoadClass::Street => RGBColor(150, 150, 150).stroke_width(1),
    };
    let title = format!("{} nodes, {} edges", network.nodes().len(), network.edges().len());
    let positions = network.nodes().iter().map(|node| node.position);
    let canvas = Canvas::new(file, &title, positions, 0.0)?;
    canvas.roads(network, style)?;
    canvas.legend(&CLASSES.map(|(class, name)| (name, style(class))))?;
    canvas.finish()
}

/// Prints the measures of all drives.
fn report(total: &Tracked) -> Result<(), Box<dyn Error>> {
    let points = total.points as f64;
    let mut text = format!(
        "tracked live: {:.0} µs a point, at most {} bytes a vehicle\n\
         matched afterwards: {:.0} µs a point, {:.1} candidates a point\n\
         route mismatch {:.4} (added {:.4}, missed {:.4}), {:.4} of {:.1} km right\n\n",
        1e6 * total.live_seconds / points,
        total.bytes,
        1e6 * total.match_seconds / points,
        total.candidates / points,
        total.lengths.mismatch(),
        total.lengths.added / total.lengths.truth,
        total.lengths.missed / total.lengths.truth,
        total.lengths.found(),
        total.lengths.truth / 1000.0
    );
    let diagrams = total.forecasts.reliability()?;
    text += "answers    right edge   calibration error\n";
    for ((name, right), diagram) in ESTIMATORS.iter().zip(total.forecasts.right()).zip(&diagrams) {
        let error = expected_calibration_error(diagram);
        text += &format!("{name:<9} {right:11.4} {error:19.4}\n");
    }
    roads::print(&format!("{text}{}\n{}", total.off_road, total.forecasts.table()?))?;
    Ok(())
}
