//! Locates each frame of a drive along a route, given the frames of an earlier pass.
//!
//! ```text
//! cargo run --release --example vpr_frames -- --reference A.u8 --query B.u8 --rows 16 --cols 32
//! ```
//!
//! Without files, a synthetic recording is used.

#[path = "vpr/mod.rs"]
mod vpr;

#[path = "vpr/frames.rs"]
mod frames;
#[path = "vpr/hard.rs"]
mod hard;
#[path = "vpr/robustness.rs"]
mod robustness;
// Included so that the tests of all modules run here.
#[cfg(test)]
#[path = "vpr/similarity.rs"]
mod similarity;

use std::error::Error;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, Normal};

use hard::Pass;
use vpr::arguments::{Common, span, whole};
use vpr::drive::{Detour, Drive, Leg};
use vpr::patches::Descriptors;
use vpr::recording::Recording;
use vpr::synthetic;

/// Locates the frames of a drive by those of a map, with patch-normalised
/// images as descriptors, and compares single images, SeqSLAM and hidden Markov
/// models.
#[derive(Parser)]
struct Arguments {
    /// Frames of the map: grey, unsigned 8-bit, row by row, frame after frame. Without files, a
    /// synthetic recording is used.
    #[arg(long, value_name = "FILE", requires_all = ["query", "rows", "cols"])]
    reference: Option<PathBuf>,
    /// Frames to be located: frame i shows the place of frame i of the map. If the map has no
    /// such frame, its place is not on the map.
    #[arg(long, value_name = "FILE", requires = "reference")]
    query: Option<PathBuf>,
    /// Height of a frame.
    #[arg(long, requires = "reference", value_parser = whole, allow_negative_numbers = true)]
    rows: Option<usize>,
    /// Width of a frame.
    #[arg(long, requires = "reference", value_parser = whole, allow_negative_numbers = true)]
    cols: Option<usize>,
    /// Side of the square patches that are normalised.
    #[arg(long, value_name = "PIXELS", default_value_t = 8, value_parser = whole, allow_negative_numbers = true)]
    patch: usize,
    /// Use only these frames of the reference as the map, as FIRST..END; places are numbered from
    /// FIRST [default: all; of the synthetic recording, the first 300].
    #[arg(long, value_name = "RANGE", value_parser = span, allow_hyphen_values = true)]
    reference_range: Option<Range<usize>>,
    /// Show the query as a drive with legs of a number of steps at a speed in frames per step, as
    /// in "150@1,60@0,100@-1,200@0.5". Step 0 shows the frame `--start`, and each step of each
    /// leg adds its speed and shows the nearest frame, halves rounded up. So there is one frame
    /// more than the legs and detours have steps [default: all frames in order; of the synthetic
    /// recording, a drive with a stop and a reverse].
    #[arg(long, value_name = "LEGS", value_delimiter = ',', allow_hyphen_values = true)]
    drive: Vec<Leg>,
    /// Frame at which the drive starts.
    #[arg(long, value_name = "FRAME", default_value_t = 0, requires = "drive", value_parser = whole, allow_negative_numbers = true)]
    start: usize,
    /// Before step STEP of the drive (from 1, detours not counted), show the query frames FIRST
    /// to END - 1, driven at speed 1; then the drive continues as without the detour. May be
    /// given several times.
    #[arg(long, value_name = "FIRST..END@STEP", allow_hyphen_values = true)]
    detour: Vec<Detour>,
    /// Measure the distance before each step, in frames, with normal noise of this standard
    /// deviation.
    #[arg(long, value_name = "SD", value_parser = deviation, allow_negative_numbers = true)]
    odometry: Option<Normal<f64>>,
    /// Then disturb the reported steps, as on real drives, by each of tunnel, fog, night, covered
    /// lens, look-alike places, jumps of exposure, dropped and repeated frames, and by all in
    /// turn. Prints a table, and writes it as hard.csv.
    #[arg(long)]
    hard: bool,
    #[command(flatten)]
    common: Common,
}

fn deviation(text: &str) -> Result<Normal<f64>, String> {
    let number = text.parse().ok().filter(|sd: &f64| (sd * sd).is_finite() && *sd >= 0.0);
    let normal = number.and_then(|sd| Normal::new(0.0, sd).ok());
    normal.ok_or_else(|| String::from("expected a number of at least 0, its square finite"))
}

fn main() -> ExitCode {
    vpr::exit_code(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let common = &arguments.common;
    let made_up = arguments.query.is_none();
    let files = arguments.reference.as_ref().zip(arguments.query.as_ref());
    let (name, references, queries) = if let Some((reference, query)) = files {
        let (rows, cols) = (arguments.rows.unwrap_or(0), arguments.cols.unwrap_or(0));
        let name = format!("{} on {}", vpr::file_name(query), vpr::file_name(reference));
        (name, frames::read(reference, rows, cols)?, frames::read(query, rows, cols)?)
    } else {
        let (references, queries) = synthetic::frames(common.seed, common.closed);
        (synthetic::NAME.to_owned(), references, queries)
    };
    let map = match &arguments.reference_range {
        Some(range) => range.clone(),
        None if made_up => 0..synthetic::MAPPED,
        None => 0..references.count(),
    };
    let frames = queries.count();
    let (legs, start) = match &arguments.drive[..] {
        [] if made_up => (synthetic::legs(), synthetic::START),
        [] => (vec![Leg { steps: frames - 1, speed: 1.0 }], 0),
        legs => (legs.to_vec(), arguments.start),
    };
    let made_up_detours = made_up && common.off_map && arguments.drive.is_empty();
    let detours = match &arguments.detour[..] {
        [] if made_up_detours => synthetic::detours(),
        detours => detours.to_vec(),
    };
    let drive = Drive::new(&legs, start, frames)?.with_detours(&detours, frames)?;
    let pass = Pass { references: &references, map, queries: &queries, drive };
    let places = vpr::places(&references, &pass.map, arguments.patch)?;
    // Compares the frames shown at each step of a drive with the map.
    let record = |shown: &Descriptors, drive: &Drive| -> Result<Recording, String> {
        let mut recording = vpr::compare(name.clone(), &places, &pass.map, shown, drive)?;
        recording.closed = common.closed;
        recording.odometry = arguments.odometry.map(|noise| {
            let mut rng = ChaCha8Rng::seed_from_u64(common.seed);
            rng.set_stream(1);
            let measured = |distance: &f64| distance + noise.sample(&mut rng);
            std::iter::once(0.0).chain(drive.distances[1..].iter().map(measured)).collect()
        });
        Ok(recording)
    };
    let shown = queries.descriptors(pass.drive.frames.iter().copied(), arguments.patch)?;
    let recording = record(&shown, &pass.drive)?;
    let out = common.out.clone().unwrap_or_else(|| PathBuf::from("target/vpr_frames"));
    let undisturbed = vpr::run(&recording, common, &out)?;
    if arguments.hard {
        robustness::run(&pass, (&recording, &undisturbed), common, &out, |disturbed| {
            let frames = 0..disturbed.drive.frames.len();
            record(&disturbed.shown.descriptors(frames, arguments.patch)?, &disturbed.drive)
        })?;
    }
    Ok(())
}
