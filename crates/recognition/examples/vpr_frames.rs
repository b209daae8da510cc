//! Locates each frame of a drive along a route, given the frames of an earlier pass. Without files,
//! a synthetic recording is used.
//!
//! ```text
//! cargo run --release --example vpr_frames -- --reference A.npy --query B.npy
//! cargo run --release --example vpr_frames -- --reference A.u8 --query B.u8 --rows 16 --cols 32
//! ```

#[path = "vpr/mod.rs"]
mod vpr;

#[path = "vpr/hard.rs"]
mod hard;
// Included so that the tests of all modules run here.
#[cfg(test)]
#[path = "vpr/tables.rs"]
mod tables;

use std::ops::Range;
use std::{path::Path, path::PathBuf, process::ExitCode};

use clap::Parser;
use rand_distr::Normal;

use vpr::arguments::span;
use vpr::drive::{Detour, Leg};
use vpr::{Array, Common, Drive, Fallible, Frames, synthetic};

/// Locates the frames of a drive by those of a map, with patch-normalised images as descriptors,
/// and compares the answers with those of simpler methods.
#[derive(Parser)]
struct Arguments {
    /// Frames of the map: grey, unsigned 8-bit, as .npy of frames × rows × columns, or raw bytes.
    #[arg(long, value_name = "FILE", requires = "query")]
    reference: Option<PathBuf>,
    /// Frames to locate. Unless --unknown is given, frame i is taken to show the place of frame i
    /// of the map, if there is one.
    #[arg(long, value_name = "FILE", requires = "reference")]
    query: Option<PathBuf>,
    /// The places of the frames are unknown: learn and score nothing.
    #[arg(long)]
    unknown: bool,
    /// Height of a frame of raw bytes.
    #[arg(long, default_value_t = 0, requires = "reference")]
    rows: usize,
    /// Width of a frame of raw bytes.
    #[arg(long, default_value_t = 0, requires = "reference")]
    cols: usize,
    /// Side of the square patches that are normalised.
    #[arg(long, value_name = "PIXELS", default_value_t = 8)]
    patch: usize,
    /// Use only frames FIRST..END of the reference; places are numbered from FIRST.
    #[arg(long, value_name = "RANGE", value_parser = span, allow_hyphen_values = true)]
    reference_range: Option<Range<usize>>,
    /// Drive along the query, in legs of steps at a speed in frames per step: each step shows the
    /// nearest frame, as in "150@1,60@0,100@-1,200@0.5" [default: all frames in order].
    #[arg(long, value_name = "LEGS", value_parser = leg, value_delimiter = ',', allow_hyphen_values = true)]
    drive: Vec<Leg>,
    /// Frame at which the drive starts, shown at step 0.
    #[arg(long, value_name = "FRAME", default_value_t = 0, requires = "drive")]
    start: usize,
    /// Before step STEP (from 1, detours not counted) show query frames FIRST to END - 1.
    #[arg(long, value_name = "FIRST..END@STEP", value_parser = detour, allow_hyphen_values = true)]
    detour: Vec<Detour>,
    /// Measure the distance before each step, in frames, with normal noise of this deviation.
    #[arg(long, value_name = "SD")]
    odometry: Option<f64>,
    /// Also disturb the reported steps, by tunnels, fog, look-alike places, lost frames and others.
    #[arg(long, conflicts_with = "unknown")]
    hard: bool,
    #[command(flatten)]
    common: Common,
}

fn leg(text: &str) -> Result<Leg, String> {
    let parts = text.trim().split_once('@');
    let leg = parts.and_then(|(steps, speed)| Some((steps.parse().ok()?, speed.parse().ok()?)));
    let leg = leg.filter(|(steps, speed): &Leg| *steps <= 1_000_000 && speed.is_finite());
    leg.ok_or_else(|| String::from("expected STEPS@SPEED, as in 60@1 or 30@-0.5"))
}

fn detour(text: &str) -> Result<Detour, String> {
    let parts = text.trim().split_once('@');
    let detour = parts.and_then(|(frames, at)| Some((span(frames).ok()?, at.parse().ok()?)));
    detour.ok_or_else(|| String::from("expected FIRST..END@STEP with FIRST below END"))
}

fn main() -> ExitCode {
    vpr::exit_code(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Fallible {
    let common = &arguments.common;
    let mut pass = synthetic::pass(common);
    let files = arguments.reference.as_ref().zip(arguments.query.as_ref());
    if let Some((reference, query)) = files {
        pass.name = vpr::name(&[query, reference]);
        pass.references = read(reference, arguments)?;
        pass.queries = read(query, arguments)?;
        pass.map = 0..pass.references.count();
        let [map, found] = [&pass.references, &pass.queries].map(|of| (of.rows, of.cols));
        if map != found {
            return Err(format!("--query: frames of {found:?} pixels, expected {map:?}").into());
        }
    }
    pass.map = arguments.reference_range.clone().unwrap_or(pass.map);
    pass.patch = arguments.patch;
    pass.noise = arguments.odometry.map(|deviation| Normal::new(0.0, deviation)).transpose()?;
    let frames = pass.queries.count();
    let drive = match &arguments.drive[..] {
        [] if files.is_none() => synthetic::drive(common.off_map && arguments.detour.is_empty())?,
        [] => Drive::new(&[(frames - 1, 1.0)], 0, frames)?,
        legs => Drive::new(legs, arguments.start, frames)?,
    };
    let drive = drive.with_detours(&arguments.detour, frames)?;
    let mut recording = pass.recording(&pass.queries.select(&drive.frames), &drive)?;
    // Frames are numbered alike by default, which gives a truth; it is dropped if that is not so.
    recording.truth = recording.truth.filter(|_| !arguments.unknown);
    let out = vpr::run(&recording, common, "vpr_frames")?;
    if arguments.hard {
        hard::run(&pass, &drive, common, &out)?;
    }
    Ok(())
}

/// Reads frames from a `.npy` file or raw bytes.
fn read(file: &Path, &Arguments { rows, cols, .. }: &Arguments) -> Result<Frames, String> {
    let name = file.display();
    if let Some(array) = Array::open(file, "(frames, rows, columns)")? {
        let Array { shape: [_, rows, cols], npy } = array;
        let pixels = npy.into_vec().map_err(|error| format!("{name}, expected uint8: {error}"))?;
        return Ok(Frames { rows, cols, pixels });
    }
    let pixels = std::fs::read(file).map_err(|error| format!("cannot read {name}: {error}"))?;
    let (bytes, size) = (pixels.len(), rows.saturating_mul(cols));
    if bytes == 0 || size == 0 || !bytes.is_multiple_of(size) {
        return Err(format!("{name}: {bytes} bytes, expected --rows {rows} × --cols {cols} each"));
    }
    Ok(Frames { rows, cols, pixels })
}
