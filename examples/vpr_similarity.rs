//! Locates each image of a drive along a route, given its similarity to each image of an earlier
//! pass, by any descriptor.
//!
//! ```text
//! cargo run --release --example vpr_similarity -- --similarity S.csv --truth T.csv
//! ```
//!
//! Without files, a synthetic recording is used.

#[path = "vpr/mod.rs"]
mod vpr;

#[path = "vpr/similarity.rs"]
mod similarity;

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

use vpr::arguments::Common;
use vpr::drive::Drive;
use vpr::synthetic;

/// Locates the images of a drive by their similarities to those of a map, and
/// compares single images, SeqSLAM and hidden Markov models.
#[derive(Parser)]
struct Arguments {
    /// CSV file of similarities without a header: one line per query image in order of time, one
    /// column per reference image in order along the route. Without it, a synthetic recording is
    /// used.
    #[arg(long, value_name = "FILE", requires = "truth")]
    similarity: Option<PathBuf>,
    /// CSV file of `query,first,last`, from 0, with or without a header line of these names: the
    /// references, including the last, that show the place of the query; both empty or -1 if none
    /// does.
    #[arg(long, value_name = "FILE", requires = "similarity")]
    truth: Option<PathBuf>,
    /// The matrix holds distances: smaller = more alike, inf = surely not there.
    #[arg(long, requires = "similarity")]
    distances: bool,
    #[command(flatten)]
    common: Common,
}

fn main() -> ExitCode {
    vpr::exit_code(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let common = &arguments.common;
    let files = arguments.similarity.as_ref().zip(arguments.truth.as_ref());
    let mut recording = if let Some((similarity, truth)) = files {
        similarity::read(similarity, truth, arguments.distances)?
    } else {
        let (references, queries) = synthetic::frames(common.seed, common.closed);
        let frames = queries.count();
        let detours = if common.off_map { synthetic::detours() } else { Vec::new() };
        let drive = Drive::new(&synthetic::legs(), synthetic::START, frames)?;
        let drive = drive.with_detours(&detours, frames)?;
        let name = synthetic::NAME.to_owned();
        let map = 0..synthetic::MAPPED;
        let places = vpr::places(&references, &map, 8)?;
        let sightings = queries.descriptors(drive.frames.iter().copied(), 8)?;
        vpr::compare(name, &places, &map, &sightings, &drive)?
    };
    recording.closed = common.closed;
    let out = common.out.clone().unwrap_or_else(|| PathBuf::from("target/vpr_similarity"));
    vpr::run(&recording, common, &out)?;
    Ok(())
}
