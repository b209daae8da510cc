//! A run: events, and batches of lines.

mod begin;
mod models;
mod snapshots;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::connections::{Batch, Connections, Text};
use super::input::{Event, STANDARD, Source, WAITING};
use super::listen::Listener;
use super::metrics::Metrics;
use super::order::Order;
use super::position::Position;
use super::vehicles::Vehicles;
use super::work::{Answers, Command, CommandKind, parse, work, work_on};
use super::{Control, Notice, ServiceJob};
use begin::{Begin, begin};
use wayfix::Likelihood;

use crate::error::{FleetError, Outcome};
use crate::pool::lines::{self, BadLine};
use crate::pool::{LiveSummary, Writing};

/// Bytes of lines that are worked on together.
const TOGETHER: usize = 1 << 20;
/// Lines of these that are taken at a time: short ones are larger in memory than as text.
const PART: usize = 1 << 14;
/// Time between two looks at a snapshot that is being written.
const LOOK: Duration = Duration::from_millis(20);
/// Time between two looks at the memory.
const FIGURES: Duration = Duration::from_secs(1);

/// Answers every line of the input, or of connections, with a line until it ends or the run is
/// stopped, with snapshots in between, whose [position](super::position()) says where another run
/// goes on.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written; a bad line, or a snapshot in between that
/// cannot be written, is none.
pub fn serve(
    job: &ServiceJob,
    control: &Control,
    input: impl Read + Send + 'static,
    mut output: impl Write,
    report: impl FnMut(&Notice),
) -> Outcome<LiveSummary> {
    let Begin { vehicles, position, file, listener, events, queue } = begin(job, input)?;
    control.attach(events);
    let mut run = Run {
        job,
        // A line has at most a number for each state.
        connections: Connections::new((1 << 20) + 64 * vehicles.sensor().states()),
        order: job.lateness.map(Order::new),
        first: position.lines,
        position,
        vehicles,
        errors: 0,
        writing: None,
        asked: false,
        last: (u64::MAX, Instant::now()),
        figures: None,
        is_beyond: false,
        metrics: Arc::new(Metrics::default()),
        file,
        listener,
        output: &mut output,
        report,
    };
    run.resume()?;
    let done = run.serve(control, &queue);
    run.listener = None;
    run.connections.end_all();
    done
}

struct Run<'a, W, R> {
    job: &'a ServiceJob,
    vehicles: Box<dyn Vehicles>,
    connections: Connections,
    order: Option<Order>,
    position: Position,
    /// Lines of runs before.
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
    listener: Option<Listener>,
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
        if let Some(listener) = &self.listener {
            (self.report)(&Notice::Listen(listener.address()));
        }
        let vehicles = self.vehicles.usage().vehicles;
        let Position { lines, offset, .. } = &self.position;
        (self.report)(&Notice::Begin { lines: *lines, vehicles, offset: offset.clone() });
        self.look();
        Ok(())
    }

    fn serve(&mut self, control: &Control, queue: &Receiver<Event>) -> Outcome<LiveSummary> {
        let mut batch = Batch::default();
        let mut is_open = true;
        // Events that are taken after the run was asked to stop. Others may never cease to come.
        let mut left = None;
        while is_open {
            batch.clear();
            let mut next = self.next(control, queue, &mut left);
            if control.is_stopped() && next.is_none() {
                break;
            }
            while let Some(event) = next {
                is_open = self.receive(event, &mut batch)?;
                // Waits for the first event only.
                if !is_open || batch.text.len() >= TOGETHER || left == Some(0) {
                    break;
                }
                left = left.map(|left: usize| left - 1);
                next = queue.try_recv().ok();
            }
            self.take(&batch)?;
            self.connections.answered(&batch);
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

    /// Takes an event. Returns false if it is the end of the input.
    fn receive(&mut self, event: Event, batch: &mut Batch) -> Outcome<bool> {
        match event {
            Event::Open(source, peer) => self.connections.open(source, peer),
            Event::Chunk(source, Ok(chunk)) => self.connections.add(source, &chunk, batch),
            Event::Chunk(STANDARD, Err(error)) => {
                let input = self.job.input.as_deref().unwrap_or(Path::new("standard input"));
                return Err(FleetError::file(input)(error));
            }
            Event::End(STANDARD) => {
                let bytes = self.connections.end(STANDARD, batch);
                if bytes > 0 {
                    (self.report)(&Notice::Unfinished { bytes });
                }
                return Ok(false);
            }
            Event::End(source) | Event::Chunk(source, Err(_)) => {
                self.connections.end(source, batch);
            }
            Event::Wake => {}
        }
        Ok(true)
    }

    /// The next event, or none in time for what else is to be done.
    fn next(
        &self,
        control: &Control,
        queue: &Receiver<Event>,
        left: &mut Option<usize>,
    ) -> Option<Event> {
        if !control.is_stopped() {
            return self.wait(queue);
        }
        // One more of each input may have been read.
        let left = left.get_or_insert(WAITING + self.connections.len());
        if *left == 0 {
            return None;
        }
        *left -= 1;
        queue.try_recv().ok()
    }

    /// Waits for an event, or until there is something else to be done.
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
                return queue.recv().ok().or(Some(Event::End(STANDARD)));
            }
        };
        match queue.recv_timeout(until) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Event::End(STANDARD)),
        }
    }

    /// Answers whole lines.
    fn take(&mut self, batch: &Batch) -> Outcome<()> {
        let (mut lines, mut cut) = (batch.lines(), Vec::new());
        loop {
            // A client that is cut off sends the rest of its lines again.
            let next = lines.by_ref().filter(|text| !cut.contains(&text.source));
            let mut part: Vec<Text<'_>> = next.take(PART).collect();
            if part.is_empty() {
                break;
            }
            while !part.is_empty() {
                let (taken, source) = self.work_on(&part)?;
                part.drain(..taken);
                if let Some(source) = source {
                    part.retain(|text| text.source != source);
                    cut.push(source);
                }
            }
        }
        self.position.bytes += batch.bytes;
        if let Some(error) = self.vehicles.take_spill_error() {
            (self.report)(&Notice::Spill(error));
        }
        Ok(())
    }

    /// Answers lines up to one that asks something of the run. Returns the number of lines, and an
    /// input that was cut off.
    fn work_on(&mut self, lines: &[Text<'_>]) -> Outcome<(usize, Option<Source>)> {
        let Answers { texts, sources, taken, errors, offsets, command } = work(
            &mut *self.vehicles,
            self.job.live.options.threads,
            lines,
            self.position.lines + 1,
            self.order.as_mut(),
            &self.metrics,
        );
        self.position.lines += taken as u64;
        self.errors += errors;
        for (source, offset) in offsets {
            self.connections.note(source, offset, &mut self.position);
        }
        self.put(&texts, &sources)?;
        let cut = command.map(|command| self.obey(command)).transpose()?.flatten();
        Ok((taken, cut))
    }

    /// Does what a line asks of the run. Returns an input that was cut off.
    fn obey(&mut self, Command { source, kind }: Command) -> Outcome<Option<Source>> {
        match kind {
            CommandKind::Model(name, offset) => {
                self.exchange(source, &name, offset.as_ref())?;
                Ok(None)
            }
            CommandKind::Client(name) => {
                match self.connections.name(source, &name, &self.position) {
                    Ok(cut) => {
                        let mut out = Vec::new();
                        lines::named(&mut out, &name, self.position.clients.get(&name));
                        self.put(&[out], &[source])?;
                        Ok(cut)
                    }
                    Err(message) => {
                        self.refuse(source, &BadLine::new(message))?;
                        Ok(None)
                    }
                }
            }
        }
    }

    /// Answers the last line with an error.
    fn refuse(&mut self, source: Source, bad: &BadLine) -> Outcome<()> {
        self.errors += 1;
        self.metrics.refuse(bad.kind);
        let mut out = Vec::new();
        lines::refuse(&mut out, self.position.lines, bad);
        self.put(&[out], &[source])
    }

    /// Writes answers.
    fn put(&mut self, texts: &[Vec<u8>], sources: &[Source]) -> Outcome<()> {
        let path = self.job.output.as_deref().unwrap_or(Path::new("standard output"));
        let written = texts.iter().try_for_each(|text| match (&mut self.file, &self.listener) {
            (Some(file), _) => file.write_all(text),
            (None, None) => self.output.write_all(text),
            (None, Some(_)) => Ok(()),
        });
        let written = written.and_then(|()| match (&self.file, &self.listener) {
            (None, None) => self.output.flush(),
            _ => Ok(()),
        });
        if self.listener.is_some() {
            self.connections.answer(texts, sources);
        }
        self.position.answers += texts.iter().map(|text| text.len() as u64).sum::<u64>();
        written.map_err(FleetError::file(path))
    }

    /// Answers the lines that wait for others.
    fn release(&mut self) -> Outcome<()> {
        let Some(order) = &mut self.order else { return Ok(()) };
        let mut turns = Vec::new();
        order.end(&mut turns);
        let (texts, sources, errors) = work_on(&mut *self.vehicles, turns, &self.metrics);
        self.errors += errors;
        self.put(&texts, &sources)
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
