//! Disturbances of real cameras and drives: altered pixels, and lost or repeated frames.

use std::{ops::Range, path::Path};

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::vpr::synthetic::grey;
use crate::vpr::{Common, Drive, Fallible, Frames, Pass, Split, Task};
use crate::vpr::{estimate, generator, number, print, recall, report};

/// Lengths of disturbances, in steps, and number of clear steps before each disturbance.
const LENGTHS: [usize; 5] = [30, 10, 60, 20, 45];
const CLEAR: usize = 25;
const KINDS: [&str; 8] =
    ["tunnel", "fog", "night", "lens", "look_alike", "exposure", "dropped", "repeated"];
const TABLE: &str = "disturbance,method,tolerance,recall,recall_in_stretches,calibration_error,\
    log_score,worst_minute";

/// Frames shown, true positions, and for each step the step of the undisturbed drive.
type Disturbed = (Frames, Drive, Vec<usize>);

/// Disturbs stretches of a drive in order, cycling through the kinds.
fn disturbed(pass: &Pass, drive: &Drive, stretches: &[Range<usize>], kinds: &[&str]) -> Disturbed {
    let (&Frames { rows, cols, .. }, n) = (&pass.queries, pass.map.len());
    let mut rng = generator(pass.seed, 2);
    let (mut pixels, mut sources) = (Vec::new(), Vec::new());
    let (mut contrast, mut cover, mut away, mut gain, mut offset) = (0.0, (0, 0), 0, 2.0, 40.0);
    for (step, &at) in drive.frames.iter().enumerate() {
        let mut frame = pass.queries.frame(at).to_vec();
        let stretch = stretches.iter().position(|stretch| stretch.contains(&step));
        if stretch.is_some_and(|stretch| stretches[stretch].start == step) {
            contrast = rng.random_range(0.05..0.3);
            // Between a quarter and all of the image.
            cover = (rng.random_range(rows / 2..=rows), rng.random_range(cols / 2..=cols));
            // At least a quarter of the map, in both directions.
            away = rng.random_range(n / 4..=n - n / 4) + n - pass.map.start % n;
        }
        if rng.random_bool(0.2) {
            gain = 2_f64.powf(rng.random_range(-2.0..2.0));
            offset = rng.random_range(-80.0..80.0);
        }
        let mut times = 1;
        let mut alter = |frame: &mut [u8], deviation: f64, map: &dyn Fn(f64) -> f64| {
            for pixel in frame {
                let noise = deviation * rng.sample::<f64, _>(StandardNormal);
                *pixel = grey(map(f64::from(*pixel)) + noise);
            }
        };
        match stretch.map_or("", |stretch| kinds[stretch % kinds.len()]) {
            "tunnel" => alter(&mut frame, 3.0, &|_| 4.0),
            "fog" => alter(&mut frame, 2.0, &|grey| 190.0 + contrast * (grey - 190.0)),
            "night" => alter(&mut frame, 4.0, &|grey| 0.1 * grey),
            "lens" => {
                let lines = frame.chunks_mut(cols).take(cover.0);
                lines.for_each(|line| line[..cover.1].fill(60));
            }
            // Noisy copies of another part of the map, passed at the speed of the vehicle.
            "look_alike" => {
                frame = pass.references.frame(pass.map.start + (at + away) % n).to_vec();
                alter(&mut frame, 12.0, &|grey| grey);
            }
            // Jumps of gain and offset, so large that pixels saturate.
            "exposure" => alter(&mut frame, 0.0, &|grey| gain * grey + offset),
            "dropped" => times = rng.random_range(0..2),
            "repeated" => times = rng.random_range(1..4),
            _ => {}
        }
        sources.extend(std::iter::repeat_n(step, times));
        pixels.extend(frame.repeat(times));
    }
    // The vehicle also passes the places of lost frames, so their distances are added to the next
    // step.
    let before = std::iter::once(&0).chain(&sources);
    let driven = before.zip(&sources).map(|(from, to)| &drive.distances[from + 1..=*to.max(from)]);
    let distances = driven.map(|driven| driven.iter().sum()).collect();
    let frames = sources.iter().map(|source| drive.frames[*source]).collect();
    (Frames { pixels, ..pass.queries }, Drive { frames, distances }, sources)
}

/// Stretches among the given steps, with clear steps before each.
fn stretches(steps: &[usize]) -> Vec<Range<usize>> {
    let (mut stretches, mut lengths) = (Vec::new(), LENGTHS.iter().cycle());
    for run in steps.chunk_by(|a, b| a + 1 == *b) {
        let (mut at, end) = (run[0] + CLEAR.min(run.len() / 3), run[0] + run.len());
        while let Some(length) = lengths.next().filter(|_| at + 10 <= end) {
            stretches.push(at..end.min(at + length));
            at += length + CLEAR;
        }
    }
    stretches
}

/// Disturbs the reported steps of a drive by each kind, and by all kinds in turn; writes and prints
/// the measures of all methods.
pub(crate) fn run(pass: &Pass, drive: &Drive, common: &Common, out: &Path) -> Fallible {
    let undisturbed = pass.recording(&pass.queries.select(&drive.frames), drive)?;
    let split = common.split(&undisturbed)?;
    let stretches = stretches(&split.report_on);
    let steps: Vec<usize> = stretches.iter().cloned().flatten().collect();
    let kinds = KINDS.map(|kind| (kind, vec![kind])).into_iter();
    let kinds = std::iter::once(("none", vec![""])).chain(kinds).chain([("all", KINDS.to_vec())]);
    let mut table = Vec::new();
    for (name, kinds) in kinds {
        let (shown, drive, sources) = disturbed(pass, drive, &stretches, &kinds);
        let recording = &pass.recording(&shown, &drive)?;
        // The same steps are learned from and reported on as without disturbances.
        // Sources ascend, since frames are dropped or repeated but never reordered.
        let now = |step: usize| sources.partition_point(|source| *source < step);
        let of = |steps: &[usize]| -> Vec<usize> {
            (0..sources.len()).filter(|at| steps.binary_search(&sources[*at]).is_ok()).collect()
        };
        let fit_on = split.fit_on.iter().map(|range| now(range.start)..now(range.end)).collect();
        let split = &Split { fit_on, report_on: of(&split.report_on), width: split.width };
        let (estimates, measured) = estimate(Task { recording, split, common })?;
        for (at, score) in measured.iter().enumerate() {
            let places = &estimates.methods[at / common.tolerance.len()].places;
            let within = number(recall(recording, places, score.tolerance, &of(&steps)));
            let cells = report::cells(score);
            let line = [&[name.to_owned()], &cells[..3], &[within], &cells[4..6], &cells[3..4]];
            table.push(line.concat());
        }
    }
    report::write(&out.join("hard.csv"), TABLE, &table)?;
    let tolerance = common.tolerance[0].to_string();
    table.retain(|line| line[2] == tolerance);
    let count = format!("{} of {} steps disturbed", steps.len(), split.report_on.len());
    print(&(count + &report::aligned(TABLE, &table)));
    Ok(())
}
