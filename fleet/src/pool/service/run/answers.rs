//! Answers of a run to its lines.

use std::io::Write;
use std::path::Path;

use super::super::Notice;
use super::super::connections::{Batch, Text};
use super::super::input::Source;
use super::super::work::{Answers, Command, CommandKind, work, work_on};
use super::Run;
use crate::error::{FleetError, Outcome};
use crate::pool::answers;
use crate::pool::lines::BadLine;

/// Lines of a batch taken at a time: parsed, short lines take more memory than as text.
const PART: usize = 1 << 14;
/// Lines taken after one with a request. Lines behind the next request are parsed again, so take
/// few while requests follow one another.
const FEW: usize = 8;

/// Lines that were answered.
struct Taken {
    lines: usize,
    /// True if the last one had a request for the run.
    is_asked: bool,
    /// Input that this request has cut off.
    cut_off: Option<Source>,
}

impl<W: Write, R: FnMut(&Notice)> Run<'_, W, R> {
    /// Answers the lines of a batch.
    pub(super) fn take(&mut self, batch: &Batch) -> Outcome<()> {
        let (mut lines, mut cut, mut most) = (batch.lines(), Vec::new(), PART);
        loop {
            // Lines of a client that was cut off are dropped: from its last recorded offset
            // onwards, it sends them again on its new connection.
            let next = lines.by_ref().filter(|text| !cut.contains(&text.source));
            let mut part: Vec<Text<'_>> = next.take(PART).collect();
            if part.is_empty() {
                break;
            }
            let mut begin = 0;
            while begin < part.len() {
                let some = &part[begin..part.len().min(begin + most)];
                let Taken { lines, is_asked, cut_off } = self.work_on(some)?;
                begin += lines;
                // Grows back to `PART` while no requests come.
                most = if is_asked { FEW } else { PART.min(2 * most) };
                if let Some(source) = cut_off {
                    part.drain(..begin);
                    part.retain(|text| text.source != source);
                    begin = 0;
                    cut.push(source);
                }
            }
        }
        // The position moves only now: a snapshot can only be taken between batches, when all their
        // lines are answered.
        if batch.bytes > 0 {
            self.position.bytes += batch.bytes;
            self.position.tail = self.connections.tail().unwrap_or_default();
        }
        if let Some(error) = self.vehicles.take_spill_error() {
            (self.report)(&Notice::Spill(error));
        }
        Ok(())
    }

    /// Answers lines up to and including one with a request.
    fn work_on(&mut self, lines: &[Text<'_>]) -> Outcome<Taken> {
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
        let is_asked = command.is_some();
        let cut_off = command.map(|command| self.obey(command)).transpose()?.flatten();
        Ok(Taken { lines: taken, is_asked, cut_off })
    }

    /// Carries out the request of a line. Returns an input that was cut off.
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
                        let (last, saved) = (&self.position.clients, &self.saved);
                        answers::named(&mut out, &name, last.get(&name), saved.get(&name));
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
    pub(super) fn refuse(&mut self, source: Source, bad: &BadLine) -> Outcome<()> {
        self.errors += 1;
        self.metrics.refuse(bad.kind);
        let mut out = Vec::new();
        answers::refuse(&mut out, self.position.lines, bad);
        self.put(&[out], &[source])
    }

    /// Writes answers.
    pub(super) fn put(&mut self, texts: &[Vec<u8>], sources: &[Source]) -> Outcome<()> {
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
        // Counted even if writing fails: the run then ends, and no snapshot has this count.
        self.position.answers += texts.iter().map(|text| text.len() as u64).sum::<u64>();
        written.map_err(FleetError::file(path))
    }

    /// Applies and answers the lines that are waiting for late ones.
    pub(super) fn release(&mut self) -> Outcome<()> {
        let Some(order) = &mut self.order else { return Ok(()) };
        let mut turns = Vec::new();
        order.end(&mut turns);
        let (texts, sources, errors) = work_on(&mut *self.vehicles, turns, &self.metrics);
        self.errors += errors;
        self.put(&texts, &sources)
    }
}
