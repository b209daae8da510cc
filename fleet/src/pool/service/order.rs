//! Lines in the order of their times, within a stated lateness.

use std::collections::BTreeMap;

use crate::pool::lines::{BadLine, Line};
use crate::sensor::Sensor;

/// Updates that wait until none that belongs before them can come in time.
#[derive(Debug)]
pub(super) struct Order {
    lateness: u64,
    /// Largest time of all updates.
    latest: Option<i64>,
    /// By time, then by number: what is asked, and the text.
    waiting: BTreeMap<(i64, u64), Waiting>,
}

/// An update, and its text.
type Waiting = (Line, Box<[u8]>);

impl Order {
    pub(super) fn new(lateness: u64) -> Self {
        Self { lateness, latest: None, waiting: BTreeMap::new() }
    }

    /// Goes on where another run was.
    pub(super) fn resume(
        &mut self,
        latest: Option<i64>,
        waiting: &[(u64, String)],
        parse: impl Fn(&[u8]) -> Line,
    ) {
        self.latest = latest;
        for (number, text) in waiting {
            let line = parse(text.as_bytes());
            if let Line::Update(update, _) = &line {
                self.waiting.insert((update.time, *number), (line, text.as_bytes().into()));
            }
        }
    }

    /// Number of updates that wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Largest time of all updates.
    pub(super) fn latest(&self) -> Option<i64> {
        self.latest
    }

    fn watermark(&self) -> i64 {
        let latest = self.latest.unwrap_or(i64::MIN);
        latest.checked_sub_unsigned(self.lateness).unwrap_or(i64::MIN)
    }

    /// Takes a line, and appends those whose turn it is, with their numbers.
    pub(super) fn take(
        &mut self,
        number: u64,
        line: Line,
        text: &[u8],
        out: &mut Vec<(u64, Line)>,
    ) {
        let Line::Update(update, _) = &line else {
            out.push((number, line));
            return;
        };
        let (time, watermark) = (update.time, self.watermark());
        if time < watermark {
            out.push((number, late(line, watermark)));
            return;
        }
        self.latest = self.latest.max(Some(time));
        self.waiting.insert((time, number), (line, text.into()));
        let watermark = self.watermark();
        while let Some(first) = self.waiting.first_entry() {
            let (time, number) = *first.key();
            if time >= watermark {
                return;
            }
            out.push((number, first.remove().0));
        }
    }

    /// Appends all that wait.
    pub(super) fn end(&mut self, out: &mut Vec<(u64, Line)>) {
        while let Some(((_, number), (line, _))) = self.waiting.pop_first() {
            out.push((number, line));
        }
    }

    /// Reads the lines that wait with the sensor of another model.
    pub(super) fn read_again(&mut self, sensor: &Sensor, parse: impl Fn(&Sensor, &[u8]) -> Line) {
        for (line, text) in self.waiting.values_mut() {
            *line = parse(sensor, text);
        }
    }

    /// Lines that wait.
    pub(super) fn waiting(&self) -> Vec<(u64, String)> {
        let lines = self.waiting.iter();
        lines
            .map(|((_, number), (_, text))| (*number, String::from_utf8_lossy(text).into_owned()))
            .collect()
    }
}

fn late(line: Line, watermark: i64) -> Line {
    let Line::Update(update, offset) = line else { return line };
    let message = format!(
        "time {} is too late: updates up to {watermark} have been taken in order",
        update.time
    );
    let (vehicle, time) = (Some(update.vehicle), Some(update.time));
    Line::Bad(Box::new(BadLine { vehicle, time, offset, kind: "time", message }))
}
