//! A run: it takes events, and processes lines in batches.
//!
//! All state changes happen on this one thread. Whatever was decided between two batches (a
//! snapshot, another model, the end) is therefore between two lines, and the position says which.

mod answers;
mod begin;
mod models;
mod snapshots;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::connections::{Batch, Connections};
use super::input::{Event, STANDARD, WAITING};
use super::listen::Listener;
use super::metrics::Metrics;
use super::order::Order;
use super::position::Position;
use super::vehicles::Vehicles;
use super::work::parse;
use super::{Control, Notice, ServiceJob};
use begin::{Begin, begin};
use wayfix::Likelihood;

use crate::error::{FleetError, Outcome};
use crate::pool::latest::Latest;
use crate::pool::{LiveSummary, VehicleId, Writing};

/// Bytes of lines in a batch, about.
const TOGETHER: usize = 1 << 20;
/// Interval at which a snapshot being written is checked.
const LOOK: Duration = Duration::from_millis(20);
/// Interval at which the metrics of memory are updated.
const FIGURES: Duration = Duration::from_secs(1);

/// Answers every line of the input, or of connections, with a line, until the input ends or the run
/// is stopped. Periodic snapshots hold a [position](super::position()) for another run to continue
/// from.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written. Bad lines, and periodic snapshots that
/// cannot be written, are not errors.
pub fn serve(
    job: &ServiceJob,
    control: &Control,
    input: impl Read + Send + 'static,
    mut output: impl Write,
    report: impl FnMut(&Notice),
) -> Outcome<LiveSummary> {
    let Begin { vehicles, position, file, locked, listener, events, queue } = begin(job, input)?;
    control.attach(events);
    let mut run = Run {
        job,
        // A line holds at most one number for each state.
        connections: Connections::new((1 << 20) + 64 * vehicles.sensor().states()),
        order: job.lateness.map(|lateness| {
            let most = job.live.options.memory.unwrap_or(usize::MAX);
            Order::new(lateness, job.timing.agree(), most)
        }),
        first: position.lines,
        saved: position.clients.clone(),
        saving: BTreeMap::new(),
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
    // No new connections; then the open ones get their last answers. The lock of the snapshot goes
    // last, also after an error.
    run.listener = None;
    run.connections.end_all();
    drop(locked);
    done
}

struct Run<'a, W, R> {
    job: &'a ServiceJob,
    vehicles: Box<dyn Vehicles>,
    connections: Connections,
    order: Option<Order>,
    position: Position,
    /// Number of lines in earlier runs.
    first: u64,
    errors: u64,
    writing: Option<(Writing, Instant)>,
    /// Last offsets of the clients in the last snapshot, and in the one being written.
    saved: BTreeMap<String, VehicleId>,
    saving: BTreeMap<String, VehicleId>,
    /// True if a snapshot was requested and not begun.
    asked: bool,
    /// Number of lines in the last snapshot, and when it was begun.
    last: (u64, Instant),
    figures: Option<Instant>,
    /// True once it was reported that memory exceeds its limit.
    is_beyond: bool,
    metrics: Arc<Metrics>,
    file: Option<File>,
    listener: Option<Listener>,
    output: &'a mut W,
    report: R,
}

impl<W: Write, R: FnMut(&Notice)> Run<'_, W, R> {
    /// Continues from the snapshot.
    fn resume(&mut self) -> Outcome<()> {
        let waiting = std::mem::take(&mut self.position.waiting);
        let sensor = self.vehicles.sensor();
        match &mut self.order {
            Some(order) => {
                let latest = self.position.of_lines.take();
                let latest = latest.unwrap_or_else(|| Latest::at(self.position.latest));
                order.resume(latest, &waiting, |text| parse(sensor, text));
            }
            // Without an order, the waiting lines would have to be applied now, in another order
            // than if the run had not stopped.
            None if !waiting.is_empty() => {
                let message =
                    "lines of the snapshot wait for late ones: give the same --lateness again";
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
        // Number of events still to take after the run was asked to stop: new ones may never cease
        // to come.
        let mut left = None;
        while is_open {
            batch.clear();
            let mut next = self.next(control, queue, &mut left);
            if control.is_stopped() && next.is_none() {
                break;
            }
            while let Some(event) = next {
                is_open = self.receive(event, &mut batch)?;
                // Only the first event is waited for: a batch is whatever has arrived while the
                // previous one was processed.
                if !is_open || batch.text.len() >= TOGETHER || left == Some(0) {
                    break;
                }
                left = left.map(|left: usize| left - 1);
                next = queue.try_recv().ok();
            }
            self.take(&batch)?;
            // After the answers are in the outboxes, so that the last ones of a connection come
            // before its end.
            self.connections.answered(&batch);
            if control.take_model() {
                self.read_model()?;
            }
            self.asked |= control.take_snapshot();
            self.snapshot()?;
            self.look();
        }
        // At the end of the input no late line can come, so the waiting lines are released. A run
        // that was stopped keeps them in its snapshot instead.
        if !is_open || self.job.live.snapshot.is_none() {
            self.release()?;
        }
        self.end()
    }

    /// Takes an event. Returns false at the end of the input.
    fn receive(&mut self, event: Event, batch: &mut Batch) -> Outcome<bool> {
        match event {
            Event::Open(source, peer) => self.connections.open(source, peer),
            Event::Chunk(source, Ok(chunk)) => self.connections.add(source, &chunk, batch),
            Event::Chunk(STANDARD, Err(error)) => {
                let input = self.job.input.as_deref().unwrap_or(Path::new("standard input"));
                return Err(FleetError::file(input)(error));
            }
            Event::End(STANDARD) => {
                let before = batch.bytes;
                let bytes = self.connections.end(STANDARD, batch);
                // Bytes were added: the last line was whole except for its line end.
                self.position.is_open |= batch.bytes > before;
                if bytes > 0 {
                    (self.report)(&Notice::Unfinished { bytes });
                }
                return Ok(false);
            }
            // A connection that fails has simply ended.
            Event::End(source) | Event::Chunk(source, Err(_)) => {
                self.connections.end(source, batch);
            }
            Event::Wake => {}
        }
        Ok(true)
    }

    /// Returns the next event, or `None` when something else is due.
    fn next(
        &self,
        control: &Control,
        queue: &Receiver<Event>,
        left: &mut Option<usize>,
    ) -> Option<Event> {
        if !control.is_stopped() {
            return self.wait(queue);
        }
        // As many events as the queue holds, plus the chunk that each reader may be about to send.
        let left = left.get_or_insert(WAITING + self.connections.len());
        if *left == 0 {
            return None;
        }
        *left -= 1;
        queue.try_recv().ok()
    }

    /// Waits for an event, or until something else is due.
    fn wait(&self, queue: &Receiver<Event>) -> Option<Event> {
        let due = self
            .job
            .every
            .map(|every| (self.last.1 + every).saturating_duration_since(Instant::now()));
        let has_new = self.position.lines != self.last.0;
        let until = match (&self.writing, due) {
            (Some(_), _) => LOOK,
            // Without new lines the next snapshot would equal the last.
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

    /// Updates the metrics of memory, and warns once if the limit cannot hold.
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
        // Above the limit although almost all states are on disk: the ids alone exceed it. (Each
        // shard keeps at least one vehicle in memory.)
        let limit = self.job.live.options.memory.filter(|&limit| usage.bytes > limit);
        let limit = limit.filter(|_| usage.in_memory < usage.vehicles / 16);
        if let Some(limit) = limit.filter(|_| !self.is_beyond) {
            self.is_beyond = true;
            (self.report)(&Notice::Ids { bytes: usage.bytes, limit });
        }
        metrics.waiting.store(self.order.as_ref().map_or(0, Order::len) as u64, Relaxed);
        let of_lines = self.order.as_ref().map(|order| order.latest().time());
        let latest = of_lines.unwrap_or_else(|| self.vehicles.latest().time());
        metrics.latest.store(latest.unwrap_or(i64::MIN), Relaxed);
    }
}
