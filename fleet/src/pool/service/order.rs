//! Lines in the order of their times, within a given lateness.
//!
//! The watermark is the latest time minus the lateness. An update leaves once its time is below the
//! watermark, and arrivals below the watermark are refused, so whatever leaves is in order. Ties
//! leave in the order of their lines.

use std::collections::BTreeMap;

use super::connections::Text;
use super::input::{STANDARD, Source};
use crate::pool::latest::Latest;
use crate::pool::lines::{BadLine, Line};
use crate::sensor::Sensor;

/// Updates that wait until no earlier one can still arrive in time.
#[derive(Debug)]
pub(super) struct Order {
    lateness: u64,
    /// Number of vehicles that must have reached the latest time.
    agree: usize,
    latest: Latest,
    /// By time, then by number of the line.
    waiting: BTreeMap<(i64, u64), Waiting>,
    /// Bytes they take, and the maximum.
    bytes: usize,
    most: usize,
}

/// Approximate bytes of a waiting update, besides its text.
const EACH: usize = 300;

/// An update and its text.
type Waiting = (Turn, Box<[u8]>);

/// A line whose turn it is.
#[derive(Debug)]
pub(super) struct Turn {
    /// Number of the line.
    pub(super) number: u64,
    pub(super) source: Source,
    pub(super) line: Line,
}

impl Order {
    /// Creates an order for lines that are at most `lateness` behind the latest time, which `agree`
    /// vehicles must have reached. Waiting lines take about `most` bytes.
    pub(super) fn new(lateness: u64, agree: usize, most: usize) -> Self {
        let (latest, waiting) = (Latest::default(), BTreeMap::new());
        Self { lateness, agree, latest, waiting, bytes: 0, most }
    }

    fn wait(&mut self, time: i64, turn: Turn, text: Box<[u8]>) {
        self.bytes += text.len() + EACH;
        self.waiting.insert((time, turn.number), (turn, text));
    }

    /// Continues from an earlier run, whose connections are gone.
    pub(super) fn resume(
        &mut self,
        latest: Latest,
        waiting: &[(u64, String)],
        parse: impl Fn(&[u8]) -> Line,
    ) {
        self.latest = latest;
        for (number, text) in waiting {
            // Snapshots store the text: the model, and with it the type of observations, may have
            // changed since.
            let line = parse(text.as_bytes());
            if let Line::Update(update, _) = &line {
                let time = update.time;
                let turn = Turn { number: *number, source: STANDARD, line };
                self.wait(time, turn, text.as_bytes().into());
            }
        }
    }

    /// Number of updates that wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// The latest time.
    pub(super) fn latest(&self) -> &Latest {
        &self.latest
    }

    fn watermark(&self) -> i64 {
        let latest = self.latest.time().unwrap_or(i64::MIN);
        latest.checked_sub_unsigned(self.lateness).unwrap_or(i64::MIN)
    }

    /// Takes a line, and appends the lines whose turn has come.
    pub(super) fn take(&mut self, number: u64, text: Text<'_>, line: Line, out: &mut Vec<Turn>) {
        let mut turn = Turn { number, source: text.source, line };
        // Lines without a time take effect at once.
        let Line::Update(update, _) = &turn.line else {
            if let Line::Remove(vehicle, _) = &turn.line {
                self.latest.remove(vehicle);
            }
            out.push(turn);
            return;
        };
        let (time, watermark) = (update.time, self.watermark());
        if time < watermark {
            turn.line = late(turn.line, watermark);
            out.push(turn);
            return;
        }
        self.latest.see(&update.vehicle, time, self.agree);
        self.wait(time, turn, text.line.into());
        // This update may have advanced the latest time.
        let watermark = self.watermark();
        while let Some(first) = self.waiting.first_entry() {
            // A vehicle whose clock is far ahead, which no other one confirms, must not keep its
            // lines waiting forever.
            if first.key().0 >= watermark && self.bytes <= self.most {
                return;
            }
            let (turn, text) = first.remove();
            self.bytes -= text.len() + EACH;
            out.push(turn);
        }
    }

    /// Appends all waiting lines.
    pub(super) fn end(&mut self, out: &mut Vec<Turn>) {
        let waiting = std::mem::take(&mut self.waiting);
        self.bytes = 0;
        out.extend(waiting.into_values().map(|(turn, _)| turn));
    }

    /// Parses the waiting lines again, with the sensor of another model.
    pub(super) fn read_again(&mut self, sensor: &Sensor, parse: impl Fn(&Sensor, &[u8]) -> Line) {
        for (turn, text) in self.waiting.values_mut() {
            turn.line = parse(sensor, text);
        }
    }

    /// Numbers and texts of the waiting lines.
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
        "time {} is too late: updates before {watermark} have been applied already",
        update.time
    );
    let (vehicle, time) = (Some(update.vehicle), Some(update.time));
    Line::Bad(Box::new(BadLine { vehicle, time, offset, kind: "time", message }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pool::Update;
    use crate::sensor::Observation;

    #[test]
    fn what_waits_is_within_the_memory() {
        // No other vehicle confirms this clock, so its lines would wait forever.
        let mut order = Order::new(10, 2, 100 * (EACH + 4));
        let mut out = Vec::new();
        for number in 0..1000 {
            let update = Update::new(7, 1_000_000 + number as i64, Observation::Symbol(2));
            let text = Text { source: STANDARD, line: b"text" };
            order.take(number, text, Line::Update(update, None), &mut out);
        }
        assert_eq!(order.len(), 100);
        assert!(out.iter().map(|turn| turn.number).eq(0..900));
        order.end(&mut out);
        assert_eq!((out.len(), order.bytes), (1000, 0));
    }
}
