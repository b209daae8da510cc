//! The command `live`: updates as lines of JSON, and answers as such lines.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use wayfix::{Hmm, Transition};

use super::lines::{self, BadLine};
use super::{Pool, PoolOptions, Update};
use crate::error::{FleetError, Outcome};
use crate::model::{Model, with_hmm};
use crate::sensor::{Observation, Sensor};

/// Bytes that are read at once.
const CHUNK: usize = 1 << 18;
/// Chunks that wait while others are worked on.
const WAITING: usize = 16;
/// Bytes of lines that are worked on together.
const TOGETHER: usize = 1 << 22;
/// Lines for which threads are not worth while.
const FEW: usize = 64;

/// A run over lines of JSON.
#[derive(Debug, Clone)]
pub struct LiveJob {
    /// Model, a file.
    pub model: PathBuf,
    /// Snapshot to begin with. If it is also that at the end, and not there yet, there are no
    /// vehicles at first.
    pub restore: Option<PathBuf>,
    /// File for the snapshot at the end.
    pub snapshot: Option<PathBuf>,
    /// Threads and memory.
    pub options: PoolOptions,
}

/// What a run has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LiveSummary {
    /// Number of lines.
    pub lines: u64,
    /// Number of lines that were answered with an error.
    pub errors: u64,
    /// Number of vehicles in the pool at the end.
    pub vehicles: usize,
    /// Bytes of the snapshot, if there is one.
    pub snapshot: Option<u64>,
}

/// Answers every line of the input with a line, in order, until the input ends; then writes the
/// snapshot. Lines that have come are worked on together, and answered without waiting for more.
///
/// `warn` is told that vehicles beyond the limit of memory cannot be moved to the disk, and stay
/// in memory.
///
/// # Errors
///
/// [`FleetError`] if the model or the snapshot cannot be read, the input cannot be read, the output
/// or the snapshot at the end cannot be written. A bad line is none.
pub fn live(
    job: &LiveJob,
    input: impl Read + Send + 'static,
    output: impl Write,
    warn: impl FnMut(&FleetError),
) -> Outcome<LiveSummary> {
    let model = Model::load(&job.model)?;
    with_hmm!(model, hmm => run(job, Arc::new(hmm.clone()), model.hash(), input, output, warn))
}

fn run<A: Transition<Control = ()> + Send + Sync>(
    job: &LiveJob,
    model: Arc<Hmm<A, Sensor>>,
    hash: &str,
    input: impl Read + Send + 'static,
    mut output: impl Write,
    mut warn: impl FnMut(&FleetError),
) -> Outcome<LiveSummary> {
    let to_output = FleetError::file(Path::new("standard output"));
    // A line has at most a number for each state.
    let longest = (1 << 20) + 64 * model.states();
    // What cannot be looked at may be there: it must not be replaced at the end.
    let is_missing = |path: &PathBuf| matches!(path.try_exists(), Ok(false));
    let is_first = |path: &PathBuf| job.snapshot.as_ref() == Some(path) && is_missing(path);
    let mut pool = match &job.restore {
        Some(path) if !is_first(path) => Pool::restore(path, model, hash, &job.options)?,
        _ => Pool::new(model, hash, &job.options)?,
    };
    let chunks = read_ahead(input);
    let mut lines = Lines { waiting: Vec::new(), is_too_long: false, longest };
    let mut summary = LiveSummary { lines: 0, errors: 0, vehicles: 0, snapshot: None };
    let mut is_open = true;
    while is_open {
        let mut batch = Vec::new();
        // Waits for the first chunk only.
        let mut next = chunks.recv().ok();
        loop {
            let Some(chunk) = next else {
                is_open = false;
                lines.end(&mut batch);
                break;
            };
            let chunk = chunk.map_err(FleetError::file(Path::new("standard input")))?;
            lines.add(&chunk, &mut batch);
            if batch.len() >= TOGETHER {
                break;
            }
            next = match chunks.try_recv() {
                Ok(chunk) => Some(chunk),
                // If the input has ended, the next round notices.
                Err(_) => break,
            };
        }
        work(&mut pool, job.options.threads, &batch, &mut summary, |text| {
            output.write_all(text).map_err(&to_output)
        })?;
        output.flush().map_err(&to_output)?;
        if let Some(error) = pool.take_spill_error() {
            warn(&error);
        }
    }
    summary.vehicles = pool.usage().vehicles;
    if let Some(path) = &job.snapshot {
        summary.snapshot = Some(pool.snapshot(path)?);
    }
    Ok(summary)
}

/// Reads an input on a thread of its own, which ends with the process at the latest.
fn read_ahead(mut input: impl Read + Send + 'static) -> Receiver<io::Result<Vec<u8>>> {
    let (sender, receiver) = sync_channel(WAITING);
    thread::spawn(move || {
        loop {
            let mut chunk = vec![0; CHUNK];
            let chunk = match input.read(&mut chunk) {
                Ok(0) => return,
                Ok(count) => {
                    chunk.truncate(count);
                    Ok(chunk)
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => Err(error),
            };
            let is_error = chunk.is_err();
            if sender.send(chunk).is_err() || is_error {
                return;
            }
        }
    });
    receiver
}

/// Chunks that become whole lines.
struct Lines {
    /// Begin of a line whose end has not come.
    waiting: Vec<u8>,
    /// True if the begin of the line has been dropped.
    is_too_long: bool,
    longest: usize,
}

/// Stands for a line that is too long to be kept: no line of JSON begins so.
const TOO_LONG: &[u8] = b"\x00";

impl Lines {
    /// Adds what has come, and appends the lines that are whole to a batch.
    fn add(&mut self, chunk: &[u8], batch: &mut Vec<u8>) {
        let whole = chunk.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        let (mut lines, rest) = chunk.split_at(whole);
        if self.is_too_long && !lines.is_empty() {
            let end = lines.iter().position(|&byte| byte == b'\n').unwrap_or(0);
            batch.extend(TOO_LONG);
            lines = &lines[end..];
            self.is_too_long = false;
        }
        if !lines.is_empty() {
            batch.append(&mut self.waiting);
            batch.extend(lines);
        }
        if !self.is_too_long {
            self.waiting.extend(rest);
        }
        if self.waiting.len() > self.longest {
            self.waiting = Vec::new();
            self.is_too_long = true;
        }
    }

    /// Appends the last line, if it has no end.
    fn end(&mut self, batch: &mut Vec<u8>) {
        batch.append(&mut self.waiting);
        if self.is_too_long {
            batch.extend(TOO_LONG);
        }
    }
}

/// Works on lines with all threads, and writes the answers.
fn work<A: Transition<Control = ()> + Send + Sync>(
    pool: &mut Pool<A, Sensor>,
    threads: usize,
    batch: &[u8],
    summary: &mut LiveSummary,
    mut write: impl FnMut(&[u8]) -> Outcome<()>,
) -> Outcome<()> {
    let lines: Vec<&[u8]> = batch
        .split_inclusive(|&byte| byte == b'\n')
        .map(|line| line.strip_suffix(b"\n").unwrap_or(line))
        .collect();
    let sensor = pool.model().likelihood();
    let part = if lines.len() < FEW { FEW } else { lines.len().div_ceil(threads.max(1)) };
    let parsed = in_parts(&lines, part, |_, lines| {
        lines.iter().map(|line| parse(sensor, line)).collect::<Vec<_>>()
    });
    let mut updates = Vec::with_capacity(lines.len());
    let mut bad = Vec::new();
    for (number, line) in parsed.into_iter().flatten().enumerate() {
        match line {
            Ok(update) => updates.push(update),
            Err(line) => bad.push((number, line)),
        }
    }
    let answers = pool.update_all(&updates);
    let refused = answers.iter().filter(|answer| answer.is_err()).count();
    let first = summary.lines;
    summary.lines += lines.len() as u64;
    summary.errors += (bad.len() + refused) as u64;
    let numbers: Vec<usize> = (0..lines.len()).collect();
    let texts = in_parts(&numbers, part, |start, numbers| {
        let mut out = Vec::with_capacity(128 * numbers.len());
        // Bad lines before the part; all others are updates.
        let mut of_bad = bad.partition_point(|(number, _)| *number < start);
        let mut at = start - of_bad;
        for &number in numbers {
            let line = first + number as u64 + 1;
            match bad.get(of_bad) {
                Some((found, bad)) if *found == number => {
                    of_bad += 1;
                    lines::refuse(&mut out, line, bad);
                }
                _ => {
                    if let (Some(update), Some(answer)) = (updates.get(at), answers.get(at)) {
                        let id = (&update.vehicle, update.time);
                        lines::answer(&mut out, line, id, answer);
                    }
                    at += 1;
                }
            }
        }
        out
    });
    texts.iter().try_for_each(|text| write(text))
}

fn parse(sensor: &Sensor, line: &[u8]) -> Result<Update<Observation>, BadLine> {
    if line == TOO_LONG {
        return Err(BadLine::new("the line is too long"));
    }
    lines::parse(sensor, line)
}

/// Works on parts of a slice, each on a thread of its own, and returns the results in order. The
/// work is given the index at which a part begins.
fn in_parts<T: Sync, R: Send>(
    items: &[T],
    part: usize,
    work: impl Fn(usize, &[T]) -> R + Sync,
) -> Vec<R> {
    if items.len() <= part {
        return vec![work(0, items)];
    }
    thread::scope(|scope| {
        let work = &work;
        let parts = items.chunks(part).enumerate();
        let threads: Vec<_> =
            parts.map(|(number, items)| scope.spawn(move || work(number * part, items))).collect();
        let results = threads.into_iter().map(|thread| match thread.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        results.collect()
    })
}
