//! Processing of a batch of lines: parsed in parallel, applied in order, answered in parallel.

use std::sync::atomic::Ordering::Relaxed;
use std::thread;

use super::connections::Text;
use super::input::{Source, TOO_LONG};
use super::metrics::Metrics;
use super::order::{Order, Turn};
use super::vehicles::Vehicles;
use crate::pool::answers;
use crate::pool::lines::{self, BadLine, Line};
use crate::pool::{UpdateResult, VehicleId};
use crate::sensor::Sensor;

/// Below this number of lines, threads do not pay off.
const FEW: usize = 64;

/// Answers to a batch of lines.
pub(super) struct Answers {
    pub(super) texts: Vec<Vec<u8>>,
    /// Input of the line of each answer.
    pub(super) sources: Vec<Source>,
    /// Number of lines processed.
    pub(super) taken: usize,
    /// Number of errors.
    pub(super) errors: u64,
    /// Offsets to record per input, in order.
    pub(super) offsets: Vec<(Source, VehicleId)>,
    /// Request in the last line processed, if it has one.
    pub(super) command: Option<Command>,
}

/// Request of a line to the run.
pub(super) struct Command {
    pub(super) source: Source,
    pub(super) kind: CommandKind,
}

pub(super) enum CommandKind {
    /// Continue with the model of this name; with the offset of the line.
    Model(String, Option<VehicleId>),
    /// Know the client by this name.
    Client(String),
}

/// A line that is not an update, with its index in the batch.
struct Other(usize, OtherKind);

enum OtherKind {
    Bad(Box<BadLine>),
    Remove { vehicle: VehicleId, offset: Option<VehicleId>, was_there: bool },
}

/// Numbers of the lines of a batch.
enum Numbers {
    From(u64),
    Each(Vec<u64>),
}

impl Numbers {
    fn of(&self, at: usize) -> u64 {
        match self {
            Self::From(first) => first + at as u64,
            Self::Each(numbers) => numbers.get(at).copied().unwrap_or(0),
        }
    }
}

/// Processes lines with all threads, up to and including one that has a request for the run;
/// `first` is the number of the first line.
pub(super) fn work(
    vehicles: &mut dyn Vehicles,
    threads: usize,
    lines: &[Text<'_>],
    first: u64,
    order: Option<&mut Order>,
    metrics: &Metrics,
) -> Answers {
    let sensor = vehicles.sensor();
    // Parts larger than the batch mean that no thread is started.
    let part = if lines.len() < FEW { FEW } else { lines.len().div_ceil(threads.max(1)) };
    let parsed = in_parts(lines, part, |_, lines| {
        lines.iter().map(|text| parse(sensor, text.line)).collect::<Vec<_>>()
    });
    let (mut command, mut offsets) = (None, Vec::new());
    let mut taken = 0;
    let mut parsed = parsed.into_iter().flatten().zip(lines).map_while(|(line, text)| {
        // Every line that is looked at counts, including the one with the request, where
        // `map_while` stops.
        taken += 1;
        let source = text.source;
        if let Some(offset) = line.offset() {
            match offsets.last_mut() {
                Some((last, before)) if *last == source => offset.clone_into(before),
                _ => offsets.push((source, offset.clone())),
            }
        }
        let kind = match line {
            Line::Model(name, offset) => CommandKind::Model(name, offset),
            Line::Client(name) => CommandKind::Client(name),
            line => return Some((text, line)),
        };
        command = Some(Command { source, kind });
        None
    });
    // `parsed` is lazy: `taken`, `offsets` and `command` are complete once one of the two branches
    // below has exhausted it.
    let mut sorted = Sorted::new(lines.len());
    let mut sources = Vec::with_capacity(lines.len());
    let numbers = if let Some(order) = order {
        let mut turns = Vec::new();
        for (number, (text, line)) in (first..).zip(&mut parsed) {
            order.take(number, *text, line, &mut turns);
        }
        Numbers::Each(sorted.add_all(turns, &mut sources))
    } else {
        parsed.for_each(|(text, line)| {
            sources.push(text.source);
            sorted.add(line);
        });
        Numbers::From(first)
    };
    let (texts, errors) = answer(vehicles, sorted, &numbers, part, metrics);
    metrics.lines.fetch_add(taken as u64, Relaxed);
    Answers { texts, sources, taken, errors, offsets, command }
}

/// Processes lines that have waited.
pub(super) fn work_on(
    vehicles: &mut dyn Vehicles,
    turns: Vec<Turn>,
    metrics: &Metrics,
) -> (Vec<Vec<u8>>, Vec<Source>, u64) {
    let (mut sorted, mut sources) = (Sorted::new(turns.len()), Vec::new());
    let numbers = Numbers::Each(sorted.add_all(turns, &mut sources));
    let (texts, errors) = answer(vehicles, sorted, &numbers, usize::MAX, metrics);
    (texts, sources, errors)
}

/// Updates, and the other lines between them.
struct Sorted {
    updates: Vec<crate::pool::Update<crate::sensor::Observation>>,
    offsets: Vec<Option<VehicleId>>,
    others: Vec<Other>,
    /// For each removal, the number of updates before it and its index among the other lines.
    removals: Vec<(usize, usize)>,
}

impl Sorted {
    fn new(room: usize) -> Self {
        let (updates, offsets) = (Vec::with_capacity(room), Vec::with_capacity(room));
        Self { updates, offsets, others: Vec::new(), removals: Vec::new() }
    }

    fn len(&self) -> usize {
        self.updates.len() + self.others.len()
    }

    fn add(&mut self, line: Line) {
        let at = self.len();
        match line {
            Line::Update(update, offset) => {
                self.updates.push(update);
                self.offsets.push(offset);
            }
            Line::Remove(vehicle, offset) => {
                self.removals.push((self.updates.len(), self.others.len()));
                let other = OtherKind::Remove { vehicle, offset, was_there: false };
                self.others.push(Other(at, other));
            }
            Line::Bad(bad) => self.others.push(Other(at, OtherKind::Bad(bad))),
            // These end a batch, and are answered by the run.
            Line::Model(..) | Line::Client(_) => {}
        }
    }

    /// Adds lines in their turn, and returns their numbers.
    fn add_all(&mut self, turns: Vec<Turn>, sources: &mut Vec<Source>) -> Vec<u64> {
        let add = |Turn { number, source, line }| {
            sources.push(source);
            self.add(line);
            number
        };
        turns.into_iter().map(add).collect()
    }
}

/// Applies the updates and removals, and writes all answers. Returns the texts and the number of
/// errors.
fn answer(
    vehicles: &mut dyn Vehicles,
    sorted: Sorted,
    numbers: &Numbers,
    part: usize,
    metrics: &Metrics,
) -> (Vec<Vec<u8>>, u64) {
    let count = sorted.len();
    let Sorted { updates, offsets, mut others, removals } = sorted;
    let mut answers: Vec<UpdateResult> = Vec::new();
    // A removal must happen between the updates before and after it, so it splits the batch.
    for (end, other) in removals {
        answers.extend(vehicles.update_all(&updates[answers.len()..end]));
        if let OtherKind::Remove { vehicle, was_there, .. } = &mut others[other].1 {
            *was_there = vehicles.remove(vehicle);
        }
    }
    if answers.is_empty() {
        answers = vehicles.update_all(&updates);
    } else {
        answers.extend(vehicles.update_all(&updates[answers.len()..]));
    }
    // Nothing changes below this line, so answers can be written in parallel.
    let mut errors = 0;
    let bad = others.iter().filter_map(|other| match &other.1 {
        OtherKind::Bad(bad) => Some(bad.kind),
        OtherKind::Remove { .. } => None,
    });
    let refused = answers.iter().filter_map(|answer| answer.as_ref().err());
    for kind in refused.map(super::super::UpdateError::kind).chain(bad) {
        errors += 1;
        metrics.refuse(kind);
    }
    metrics
        .accepted
        .fetch_add(answers.iter().filter(|answer| answer.is_ok()).count() as u64, Relaxed);
    let places: Vec<usize> = (0..count).collect();
    let texts = in_parts(&places, part, |start, places| {
        let mut out = Vec::with_capacity(128 * places.len());
        // Of the lines before this part, `of_other` are others, and the rest updates.
        let mut of_other = others.partition_point(|other| other.0 < start);
        let mut at = start - of_other;
        for &place in places {
            let line = numbers.of(place);
            match others.get(of_other) {
                Some(Other(found, other)) if *found == place => {
                    of_other += 1;
                    match other {
                        OtherKind::Bad(bad) => answers::refuse(&mut out, line, bad),
                        OtherKind::Remove { vehicle, offset, was_there } => {
                            let vehicle = (vehicle, *was_there);
                            answers::removed(&mut out, line, offset.as_ref(), vehicle);
                        }
                    }
                }
                _ => {
                    if let (Some(update), Some(answer)) = (updates.get(at), answers.get(at)) {
                        let id = (&update.vehicle, update.time);
                        answers::answer(&mut out, line, offsets[at].as_ref(), id, answer);
                    }
                    at += 1;
                }
            }
        }
        out
    });
    (texts, errors)
}

pub(super) fn parse(sensor: &Sensor, line: &[u8]) -> Line {
    if let Some(begin) = line.strip_prefix(TOO_LONG) {
        let offset = lines::first_offset(begin);
        return Line::Bad(Box::new(BadLine { offset, ..BadLine::new("the line is too long") }));
    }
    lines::parse(sensor, line)
}

/// Processes parts of a slice, each on a thread of its own, and returns the results in order.
/// `work` gets the index at which its part begins.
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
