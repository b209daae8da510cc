//! Matching of all drives on several threads, with output in the order of the drives.
//!
//! Threads take the next drive from a counter and send results through a bounded channel, so memory
//! holds a few drives per thread whatever their number.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Instant;

use wayfix_roads::matching::{MatchError, MatchedDrive, Matcher};

use super::files::{Lines, Output};
use super::roads::measures::{Forecasts, Lengths, edges_of, is_among};
use super::roads::off_road::OffRoad;
use super::roads::picture::draw_drive;
use super::roads::{self, cannot_write};
use super::{Drive, summary::Total};

/// Results of a matched drive.
struct Matched {
    lines: Lines,
    seconds: f64,
    candidates: f64,
    metres: f64,
    off_road: f64,
    truth: Option<(Lengths, Forecasts, OffRoad)>,
    /// The matched drive itself, if it is to be drawn.
    picture: Option<MatchedDrive>,
}

/// Matches the drives and writes the answers in order.
pub(crate) fn run(
    matcher: &Matcher,
    drives: &[Drive],
    [threads, late]: [usize; 2],
    picture: &str,
    out: &Path,
) -> Result<Total, Box<dyn Error>> {
    let mut output = Output::create(out)?;
    let mut total = Total::default();
    let bar = roads::bar("matching drives", drives.len());
    // Relaxed: the counter only hands out numbers, and the scope joins the threads.
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::sync_channel::<(usize, Result<Matched, String>)>(4 * threads);
    let start = Instant::now();
    thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        for _ in 0..threads {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(drive) = drives.get(number) else { return };
                    let wanted = drive.trace.name == picture;
                    let matched = matched(matcher, drive, late, wanted);
                    // The receiver is dropped after an error of the output: no one waits for more.
                    if sender.send((number, matched)).is_err() {
                        return;
                    }
                }
            });
        }
        // The channel closes once the threads' senders are gone.
        drop(sender);
        // Drives that are done while an earlier one is not.
        let mut waiting = BTreeMap::new();
        let mut number = 0;
        // The loop owns the receiver, so returning early from it makes the threads end.
        for (done, matched) in receiver {
            bar.inc(1);
            waiting.insert(done, matched);
            while let Some(matched) = waiting.remove(&number) {
                let drive = &drives[number];
                match matched {
                    Ok(matched) => {
                        output.write(&matched.lines).map_err(|e| cannot_write(out, e))?;
                        if let Some(drawn) = &matched.picture {
                            let title = format!(
                                "Drive {picture}: GPS points, and the route that was found"
                            );
                            let file = out.join("drive.svg");
                            draw_drive(&file, &title, matcher.network(), drawn)
                                .map_err(|e| cannot_write(out, e))?;
                        }
                        take(&mut total, drive, &matched);
                    }
                    Err(error) => {
                        total.failed.push(format!("{}: {error}", drive.trace.name));
                    }
                }
                number += 1;
            }
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    output.finish().map_err(|e| cannot_write(out, e))?;
    total.threads = threads;
    total.elapsed = start.elapsed().as_secs_f64();
    Ok(total)
}

/// Matches a drive and measures it if its truth is known.
fn matched(
    matcher: &Matcher,
    drive: &Drive,
    late: usize,
    is_drawn: bool,
) -> Result<Matched, String> {
    let message = |error: MatchError| error.to_string();
    let points = &drive.trace.points;
    let start = Instant::now();
    let found = matcher.match_drive(points).map_err(message)?;
    // Matching alone, without output and measures.
    let seconds = start.elapsed().as_secs_f64();
    let lines = Lines::of(&drive.trace.name, matcher, &found, late).map_err(|e| e.to_string())?;
    let network = matcher.network();
    let truth = drive.truth.as_ref().map(|truth| {
        let driven = truth.driven(network, points, &drive.tail);
        let lengths = Lengths::of(network, &driven, found.route());
        let edges = edges_of(network, driven.iter().map(|part| part.0));
        let (mut forecasts, mut off_road) = (Forecasts::default(), OffRoad::default());
        for (number, point) in points.iter().enumerate() {
            let answers = [found.live(number), found.late(number, late), found.smoothed(number)];
            let is_off_road = truth.is_off_road(point);
            is_off_road.into_iter().for_each(|is| off_road.push(is, answers));
            forecasts.push(answers, |answer| {
                // Where no time tells, the vehicle is taken to be on the road.
                if is_off_road == Some(true) {
                    answer.edge.is_none()
                } else {
                    is_among(network, &edges, answer)
                }
            });
        }
        (lengths, forecasts, off_road)
    });
    let stretches = found.route().iter().filter(|stretch| stretch.edge.is_none());
    Ok(Matched {
        lines,
        seconds,
        candidates: found.candidates() * points.len() as f64,
        metres: found.metres(),
        off_road: stretches.map(|stretch| stretch.exit).sum(),
        truth,
        picture: is_drawn.then_some(found),
    })
}

/// Adds the results of a drive.
fn take(total: &mut Total, drive: &Drive, matched: &Matched) {
    total.drives += 1;
    total.points += drive.trace.points.len();
    total.seconds += matched.seconds;
    total.candidates += matched.candidates;
    total.metres += matched.metres;
    total.off_road += matched.off_road;
    if let Some((lengths, forecasts, off_road)) = &matched.truth {
        total.with_truth += 1;
        total.lengths.add(*lengths);
        total.forecasts.extend(forecasts);
        total.points_off_road.add(*off_road);
        if lengths.truth > 0.0 {
            // A mismatch is relative to the true length.
            total.worst.push((lengths.mismatch(), drive.trace.name.clone()));
        }
    }
}
