//! A run: events, and batches of lines.

mod snapshots;

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::input::{Event, Lines, read_ahead};
use super::metrics::Metrics;
use super::order::Order;
use super::position::{self, Position};
use super::vehicles::{self, Vehicles};
use super::work::{Answers, parse, work, work_on};
use super::{Control, Notice, ServiceJob};
use wayfix::Likelihood;

use crate::error::{FleetError, Outcome};
use crate::model::Model;
use crate::pool::lines::{self, BadLine};
use crate::pool::{LiveSummary, VehicleId, Writing};

/// Bytes of lines that are worked on together.
const TOGETHER: usize = 1 << 22;
/// Time between two looks at a snapshot that is being written.
const LOOK: Duration = Duration::from_millis(20);
/// Time between two looks at the memory.
const FIGURES: Duration = Duration::from_secs(1);

/// Answers every line of the input with a line until it ends or the run is stopped, with snapshots
/// in between, whose [position] says where another run goes on.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written; a bad line, or a snapshot in between that
/// cannot be written, is none.
pub fn serve(
    job: &ServiceJob,
    control: &Control,
    mut input: impl Read + Send + 'static,
    mut output: impl Write,
    report: impl FnMut(&Notice),
) -> Outcome<LiveSummary> {
    let (vehicles, position, is_first) = begin(job)?;
    let file = match &job.output {
        Some(path) => Some(position::open_output(path, position.answers, is_first)?),
        None => None,
    };
    if let (true, Some(_), Some(path)) = (is_first, &file, &job.live.snapshot) {
        // So that a run that is killed early leaves no output of which nobody knows what counts.
        vehicles.snapshot(path, &position.note())?;
    }
    let is_rest = job.input.is_none() && !job.replay;
    let (events, queue) = if let Some(path) = &job.input {
        read_ahead(position::open_input(path, position.bytes)?)
    } else {
        if job.replay {
            position::skip(&mut input, position.bytes)?;
        }
        read_ahead(input)
    };
    control.attach(events);
    let metrics = Arc::new(Metrics::default());
    let mut run = Run {
        job,
        // A line has at most a number for each state.
        lines: Lines::new((1 << 20) + 64 * vehicles.sensor().states(), position.bytes),
        order: job.lateness.map(Order::new),
        before: if is_rest { position.lines } else { 0 },
        first: position.lines,
        position,
        vehicles,
        errors: 0,
        writing: None,
        asked: false,
        last: (u64::MAX, Instant::now()),
        figures: None,
        is_beyond: false,
        metrics,
        file,
        output: &mut output,
        report,
    };
    run.resume()?;
    run.serve(control, &queue)
}

/// Opens the model and the snapshot. Also returns whether there was none.
fn begin(job: &ServiceJob) -> Outcome<(Box<dyn Vehicles>, Position, bool)> {
    let live = &job.live;
    if job.every.is_some() && live.snapshot.is_none() {
        return Err(FleetError::Settings("snapshots in between need a file".to_owned()));
    }
    // What cannot be looked at may be there: it must not be replaced at the end.
    let is_missing = |path: &PathBuf| matches!(path.try_exists(), Ok(false));
    let is_first = |path: &PathBuf| live.snapshot.as_ref() == Some(path) && is_missing(path);
    let restore = live.restore.as_deref().filter(|_| !live.restore.as_ref().is_some_and(is_first));
    let position = match restore {
        Some(path) => position::position(path)?.unwrap_or_default(),
        None => Position::default(),
    };
    let model = match &position.model {
        Some(name) => load(job, name)?,
        None => Model::load(&live.model)?,
    };
    let mut vehicles = vehicles::open(&model, restore, &live.options)?;
    vehicles.set_timing(job.timing, position.latest);
    Ok((vehicles, position, restore.is_none()))
}

/// Loads a model that a line has named.
fn load(job: &ServiceJob, name: &str) -> Outcome<Model> {
    let refused = |why: &str| Err(FleetError::Settings(format!("model {name:?}: {why}")));
    let Some(folder) = &job.models else { return refused("there is no folder of models") };
    let mut parts = Path::new(name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(part)), None) if part == name => Model::load(&folder.join(name)),
        _ => refused("is not the name of a file in the folder of models"),
    }
}

struct Run<'a, W, R> {
    job: &'a ServiceJob,
    vehicles: Box<dyn Vehicles>,
    lines: Lines,
    order: Option<Order>,
    position: Position,
    /// Lines of runs before, which numbers of answers leave out; and of runs before in all.
    before: u64,
    first: u64,
    errors: u64,
    writing: Option<(Writing, Instant)>,
    /// True if a snapshot is asked for, and not begun.
    asked: bool,
    /// Lines that the last snapshot has, and when it was begun.
    last: (u64, Instant),
    figures: Option<Instant>,
    /// True if it was said that memory is beyond its limit.
    is_beyond: bool,
    metrics: Arc<Metrics>,
    file: Option<File>,
    output: &'a mut W,
    report: R,
}

impl<W: Write, R: FnMut(&Notice)> Run<'_, W, R> {
    /// Goes on from the snapshot.
    fn resume(&mut self) -> Outcome<()> {
        let waiting = std::mem::take(&mut self.position.waiting);
        let sensor = self.vehicles.sensor();
        match &mut self.order {
            Some(order) => {
                order.resume(self.position.latest, &waiting, |text| parse(sensor, text));
            }
            None if !waiting.is_empty() => {
                let message = "lines of the snapshot wait for late ones: give the lateness again";
                return Err(FleetError::Settings(message.to_owned()));
            }
            None => {}
        }
        self.last.0 = self.position.lines;
        if let Some(address) = &self.job.metrics {
            let address = self.metrics.listen(address)?;
            (self.report)(&Notice::Metrics(address));
        }
        let vehicles = self.vehicles.usage().vehicles;
        (self.report)(&Notice::Begin { lines: self.position.lines, vehicles });
        self.look();
        Ok(())
    }

    fn serve(&mut self, control: &Control, queue: &Receiver<Event>) -> Outcome<LiveSummary> {
        let mut batch = Vec::new();
        let mut is_open = true;
        while is_open {
            batch.clear();
            // Waits for the first event only.
            let mut next =
                if control.is_stopped() { queue.try_recv().ok() } else { self.wait(queue) };
            if control.is_stopped() && next.is_none() {
                break;
            }
            while let Some(event) = next {
                match event {
                    Event::Chunk(chunk) => {
                        let chunk = chunk.map_err(FleetError::file(self.input()))?;
                        self.lines.add(&chunk, &mut batch);
                    }
                    Event::End => {
                        self.lines.end(&mut batch);
                        is_open = false;
                        break;
                    }
                    Event::Wake => {}
                }
                if batch.len() >= TOGETHER {
                    break;
                }
                next = queue.try_recv().ok();
            }
            self.take(&batch)?;
            if control.take_model() {
                self.read_model()?;
            }
            self.asked |= control.take_snapshot();
            self.snapshot()?;
            self.look();
        }
        if !is_open || self.job.live.snapshot.is_none() {
            self.release()?;
        }
        self.end()
    }

    /// The next event, or none in time for what else is to be done.
    fn wait(&self, queue: &Receiver<Event>) -> Option<Event> {
        let due = self
            .job
            .every
            .map(|every| (self.last.1 + every).saturating_duration_since(Instant::now()));
        let has_new = self.position.lines != self.last.0;
        let until = match (&self.writing, due) {
            (Some(_), _) => LOOK,
            (None, Some(due)) if has_new => due,
            _ => {
                return queue.recv().ok().or(Some(Event::End));
            }
        };
        match queue.recv_timeout(until) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Event::End),
        }
    }

    fn input(&self) -> &Path {
        self.job.input.as_deref().unwrap_or(Path::new("standard input"))
    }

    /// Answers whole lines.
    fn take(&mut self, batch: &[u8]) -> Outcome<()> {
        let lines: Vec<&[u8]> = batch
            .split_inclusive(|&byte| byte == b'\n')
            .map(|line| line.strip_suffix(b"\n").unwrap_or(line))
            .collect();
        let mut rest = &lines[..];
        while !rest.is_empty() {
            let Answers { texts, taken, errors, offset, model } = work(
                &mut *self.vehicles,
                self.job.live.options.threads,
                rest,
                (self.position.lines + 1, self.before),
                self.order.as_mut(),
                &self.metrics,
            );
            self.position.lines += taken as u64;
            self.errors += errors;
            if offset.is_some() {
                self.position.offset = offset;
            }
            self.put(&texts)?;
            if let Some((name, offset)) = model {
                self.exchange(&name, offset.as_ref())?;
            }
            rest = &rest[taken.min(rest.len())..];
        }
        self.position.bytes = self.lines.whole;
        if let Some(error) = self.vehicles.take_spill_error() {
            (self.report)(&Notice::Spill(error));
        }
        Ok(())
    }

    /// Writes answers.
    fn put(&mut self, texts: &[Vec<u8>]) -> Outcome<()> {
        let path = self.job.output.as_deref().unwrap_or(Path::new("standard output"));
        let written = texts.iter().try_for_each(|text| match &mut self.file {
            Some(file) => file.write_all(text),
            None => self.output.write_all(text),
        });
        let written = written.and_then(|()| match &self.file {
            Some(_) => Ok(()),
            None => self.output.flush(),
        });
        self.position.answers += texts.iter().map(|text| text.len() as u64).sum::<u64>();
        written.map_err(FleetError::file(path))
    }

    /// Answers the lines that wait for others.
    fn release(&mut self) -> Outcome<()> {
        let Some(order) = &mut self.order else { return Ok(()) };
        let mut lines = Vec::new();
        order.end(&mut lines);
        let (texts, errors) = work_on(&mut *self.vehicles, lines, self.before, &self.metrics);
        self.errors += errors;
        self.put(&texts)
    }

    /// Goes on with a model that a line has named, and answers the line.
    fn exchange(&mut self, name: &str, offset: Option<&VehicleId>) -> Outcome<()> {
        let number = self.position.lines - self.before;
        let mut out = Vec::new();
        match load(self.job, name) {
            Ok(model) => {
                let counts = self.go_on_with(&model)?;
                self.position.model = Some(name.to_owned());
                lines::exchanged(&mut out, number, offset, (name, model.hash()), counts);
            }
            Err(error) => {
                self.errors += 1;
                self.metrics.refuse("line");
                let bad = BadLine { offset: offset.cloned(), ..BadLine::new(error.to_string()) };
                lines::refuse(&mut out, number, &bad);
            }
        }
        self.put(&[out])
    }

    /// Reads the file of the model again.
    fn read_model(&mut self) -> Outcome<()> {
        match Model::load(&self.job.live.model) {
            Ok(model) => {
                self.go_on_with(&model)?;
                self.position.model = None;
                // A run that goes on needs one with this model.
                self.asked = self.job.live.snapshot.is_some();
            }
            Err(error) => (self.report)(&Notice::ModelFailed(error)),
        }
        Ok(())
    }

    /// Returns the number of vehicles that keep their belief, and that lose it.
    fn go_on_with(&mut self, model: &Model) -> Outcome<(usize, usize)> {
        self.wait_for_snapshot();
        // Those that are forgotten are not kept.
        self.vehicles.forget();
        let before = self.vehicles.usage().vehicles;
        let options = &self.job.live.options;
        self.vehicles = self.vehicles.exchange(model, options)?;
        let kept = self.vehicles.usage().vehicles;
        if let Some(order) = &mut self.order {
            order.read_again(self.vehicles.sensor(), parse);
        }
        let hash = model.hash().to_owned();
        (self.report)(&Notice::Model { hash, kept, anew: before - kept });
        Ok((kept, before - kept))
    }

    /// Looks at the memory.
    fn look(&mut self) {
        if self.figures.is_some_and(|last| last.elapsed() < FIGURES) {
            return;
        }
        self.figures = Some(Instant::now());
        let (usage, metrics) = (self.vehicles.usage(), &self.metrics);
        metrics.vehicles.store(usage.vehicles as u64, Relaxed);
        metrics.in_memory.store(usage.in_memory as u64, Relaxed);
        metrics.memory_bytes.store(usage.bytes as u64, Relaxed);
        metrics.disk_bytes.store(usage.file_bytes, Relaxed);
        // Each shard keeps a vehicle at least.
        let limit = self.job.live.options.memory.filter(|&limit| usage.bytes > limit);
        let limit = limit.filter(|_| usage.in_memory < usage.vehicles / 16);
        if let Some(limit) = limit.filter(|_| !self.is_beyond) {
            self.is_beyond = true;
            (self.report)(&Notice::Ids { bytes: usage.bytes, limit });
        }
        metrics.waiting.store(self.order.as_ref().map_or(0, Order::len) as u64, Relaxed);
        let latest = self.order.as_ref().map_or(self.vehicles.latest(), Order::latest);
        metrics.latest.store(latest.unwrap_or(i64::MIN), Relaxed);
    }
}
