//! Snapshots of a run.
//!
//! The order is what makes them safe: answers are synced before the snapshot that counts them gets
//! its name. After a crash the output then has at least the answers that the snapshot counts, and
//! whatever follows is cut off.

use std::fs::File;
use std::io::Write;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use super::super::Notice;
use super::super::metrics::now;
use super::Run;
use crate::error::{FleetError, Outcome};
use crate::pool::LiveSummary;

impl<W: Write, R: FnMut(&Notice)> Run<'_, W, R> {
    /// The current position, encoded.
    pub(super) fn note(&mut self) -> Vec<u8> {
        let latest = self.vehicles.latest();
        self.position.latest = latest.time();
        self.position.of_updates = Some(latest);
        if let Some(order) = &self.order {
            self.position.latest = order.latest().time();
            self.position.of_lines = Some(order.latest().clone());
            self.position.waiting = order.waiting();
        }
        let note = self.position.note();
        // Only needed in the note, and possibly large.
        self.position.waiting.clear();
        note
    }

    /// Begins a snapshot if one is due or requested, and completes one that has been written.
    pub(super) fn snapshot(&mut self) -> Outcome<()> {
        if self.writing.as_ref().is_some_and(|(writing, _)| writing.is_finished()) {
            self.wait_for_snapshot();
        }
        let Some(path) = &self.job.live.snapshot else {
            self.asked = false;
            return Ok(());
        };
        let is_due = self.job.every.is_some_and(|every| self.last.1.elapsed() >= every)
            && self.position.lines != self.last.0;
        if self.writing.is_some() || !(self.asked || is_due) {
            return Ok(());
        }
        self.asked = false;
        let answers = self.file.as_ref().map(File::try_clone).transpose();
        let answers = answers.map_err(FleetError::file(path))?;
        let name = self.job.output.clone().unwrap_or_default();
        let before = move || match answers {
            // The snapshot must not count answers that are not on disk. Later answers synced along
            // with them do no harm.
            Some(file) => file.sync_data().map_err(FleetError::file(&name)),
            None => Ok(()),
        };
        let note = self.note();
        self.saving.clone_from(&self.position.clients);
        self.last = (self.position.lines, Instant::now());
        let writing = self.vehicles.begin_snapshot(path, &note, Box::new(before))?;
        self.writing = Some((writing, Instant::now()));
        Ok(())
    }

    pub(super) fn wait_for_snapshot(&mut self) {
        let Some((writing, start)) = self.writing.take() else { return };
        let written = writing.wait();
        self.tell(start, written.as_ref().ok().copied());
        let saving = std::mem::take(&mut self.saving);
        if written.is_ok() {
            self.saved = saving;
        }
        if let Err(error) = written {
            // Nothing of this was saved, so the next snapshot is due even without new lines.
            self.last.0 = u64::MAX;
            (self.report)(&Notice::SnapshotFailed(error));
        }
    }

    /// Reports a snapshot of `bytes` bytes, or its failure.
    fn tell(&mut self, start: Instant, bytes: Option<u64>) {
        let metrics = &self.metrics;
        metrics.is_ill.store(u64::from(bytes.is_none()), Relaxed);
        if let Some(bytes) = bytes {
            metrics.snapshots.fetch_add(1, Relaxed);
            metrics.snapshot_at.store(now(), Relaxed);
            metrics.snapshot_took.store(start.elapsed().as_millis() as u64, Relaxed);
            (self.report)(&Notice::Snapshot { bytes, seconds: start.elapsed().as_secs_f64() });
        } else {
            metrics.snapshots_failed.fetch_add(1, Relaxed);
        }
    }

    /// Writes the final snapshot.
    pub(super) fn end(&mut self) -> Outcome<LiveSummary> {
        self.wait_for_snapshot();
        self.vehicles.forget();
        let mut bytes = None;
        if let Some(path) = &self.job.live.snapshot {
            if let Some(file) = &self.file {
                let name = self.job.output.clone().unwrap_or_default();
                file.sync_data().map_err(FleetError::file(&name))?;
            }
            let note = self.note();
            let start = Instant::now();
            let length = self.vehicles.snapshot(path, &note)?;
            self.tell(start, Some(length));
            bytes = Some(length);
        }
        self.figures = None;
        self.look();
        Ok(LiveSummary {
            lines: self.position.lines - self.first,
            errors: self.errors,
            vehicles: self.vehicles.usage().vehicles,
            snapshot: bytes,
        })
    }
}
