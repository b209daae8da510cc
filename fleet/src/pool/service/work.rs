//! Lines that are worked on together.

use std::sync::atomic::Ordering::Relaxed;
use std::thread;

use super::input::TOO_LONG;
use super::metrics::Metrics;
use super::order::Order;
use super::vehicles::Vehicles;
use crate::pool::lines::{self, BadLine, Line};
use crate::pool::{UpdateResult, VehicleId};
use crate::sensor::Sensor;

/// Lines for which threads are not worth while.
const FEW: usize = 64;

/// Answers to lines.
pub(super) struct Answers {
    pub(super) texts: Vec<Vec<u8>>,
    /// Number of lines that were worked on.
    pub(super) taken: usize,
    /// Number of errors.
    pub(super) errors: u64,
    /// The last offset.
    pub(super) offset: Option<VehicleId>,
    /// A model that is to be gone on with, named in the last line that was taken, and the offset of
    /// that.
    pub(super) model: Option<(String, Option<VehicleId>)>,
}

/// A line that is not an update, at its place among all.
struct Other(usize, OtherKind);

enum OtherKind {
    Bad(Box<BadLine>),
    Remove { vehicle: VehicleId, offset: Option<VehicleId>, was_there: bool },
}

/// Numbers of lines.
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

/// Works on lines with all threads, up to one that names a model. The first has this number;
/// answers have numbers that are lower by `before`.
pub(super) fn work(
    vehicles: &mut dyn Vehicles,
    threads: usize,
    lines: &[&[u8]],
    (first, before): (u64, u64),
    order: Option<&mut Order>,
    metrics: &Metrics,
) -> Answers {
    let sensor = vehicles.sensor();
    let part = if lines.len() < FEW { FEW } else { lines.len().div_ceil(threads.max(1)) };
    let parsed = in_parts(lines, part, |_, lines| {
        lines.iter().map(|line| parse(sensor, line)).collect::<Vec<_>>()
    });
    let mut model = None;
    let (mut taken, mut last) = (0, None);
    let mut parsed = parsed.into_iter().flatten().inspect(|_| taken += 1).map_while(|line| {
        let offset = match &line {
            Line::Update(_, offset) | Line::Remove(_, offset) | Line::Model(_, offset) => offset,
            Line::Bad(bad) => &bad.offset,
        };
        if offset.is_some() {
            last.clone_from(offset);
        }
        match line {
            Line::Model(name, offset) => {
                model = Some((name, offset));
                None
            }
            line => Some(line),
        }
    });
    let mut sorted = Sorted::new(lines.len());
    let numbers = if let Some(order) = order {
        let mut in_turn = Vec::new();
        for ((number, line), text) in (first..).zip(&mut parsed).zip(lines) {
            order.take(number, line, text, &mut in_turn);
        }
        let numbers = in_turn.iter().map(|(number, _)| number.saturating_sub(before)).collect();
        in_turn.into_iter().for_each(|(_, line)| sorted.add(line));
        Numbers::Each(numbers)
    } else {
        parsed.for_each(|line| sorted.add(line));
        Numbers::From(first - before)
    };
    let (texts, errors) = answer(vehicles, sorted, &numbers, part, metrics);
    metrics.lines.fetch_add(taken as u64, Relaxed);
    Answers { texts, taken, errors, offset: last, model }
}

/// Works on lines that have waited.
pub(super) fn work_on(
    vehicles: &mut dyn Vehicles,
    lines: Vec<(u64, Line)>,
    before: u64,
    metrics: &Metrics,
) -> (Vec<Vec<u8>>, u64) {
    let mut sorted = Sorted::new(lines.len());
    let numbers = lines.iter().map(|(number, _)| number.saturating_sub(before)).collect();
    lines.into_iter().for_each(|(_, line)| sorted.add(line));
    answer(vehicles, sorted, &Numbers::Each(numbers), usize::MAX, metrics)
}

/// Updates, and what is between them.
struct Sorted {
    updates: Vec<crate::pool::Update<crate::sensor::Observation>>,
    offsets: Vec<Option<VehicleId>>,
    others: Vec<Other>,
    /// Updates before each vehicle that is removed, and its place among the others.
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
            // Ends the lines that are taken together.
            Line::Model(..) => {}
        }
    }
}

/// Takes the updates, and writes all answers. Returns the texts, and the number of errors.
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
        // Others before the part; all else are updates.
        let mut of_other = others.partition_point(|other| other.0 < start);
        let mut at = start - of_other;
        for &place in places {
            let line = numbers.of(place);
            match others.get(of_other) {
                Some(Other(found, other)) if *found == place => {
                    of_other += 1;
                    match other {
                        OtherKind::Bad(bad) => lines::refuse(&mut out, line, bad),
                        OtherKind::Remove { vehicle, offset, was_there } => {
                            let vehicle = (vehicle, *was_there);
                            lines::removed(&mut out, line, offset.as_ref(), vehicle);
                        }
                    }
                }
                _ => {
                    if let (Some(update), Some(answer)) = (updates.get(at), answers.get(at)) {
                        let id = (&update.vehicle, update.time);
                        lines::answer(&mut out, line, offsets[at].as_ref(), id, answer);
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
    if line == TOO_LONG {
        return Line::Bad(Box::new(BadLine::new("the line is too long")));
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
