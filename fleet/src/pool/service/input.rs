//! Input that arrives in chunks, assembled into whole lines.

use std::io::{self, Read};
use std::sync::mpsc::SyncSender;
use std::thread;

use serde::de::IgnoredAny;

use super::listen::Peer;
use super::position::{TAIL, Tail};

/// Bytes read at a time.
const CHUNK: usize = 1 << 16;
/// Length of the queue of events: chunks that wait while others are processed.
pub(super) const WAITING: usize = 64;

/// Number of an input; connections count from 1.
pub(super) type Source = u64;
/// Standard input, or a file.
pub(super) const STANDARD: Source = 0;

/// An event that the run waits for.
#[derive(Debug)]
pub(super) enum Event {
    /// A connection has begun.
    Open(Source, Peer),
    Chunk(Source, io::Result<Vec<u8>>),
    /// An input has ended.
    End(Source),
    /// Something was requested through the `Control`.
    Wake,
}

/// Reads an input to its end; calls `ready` before each chunk, which may wait.
pub(super) fn read(
    mut input: impl Read,
    source: Source,
    events: &SyncSender<Event>,
    ready: impl Fn(),
) {
    let mut buffer = vec![0; CHUNK];
    loop {
        ready();
        let chunk = match input.read(&mut buffer) {
            Ok(0) => {
                _ = events.send(Event::End(source));
                return;
            }
            Ok(count) => Ok(buffer[..count].to_vec()),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => Err(error),
        };
        let is_error = chunk.is_err();
        // The queue is bounded, so a run that falls behind slows its inputs down. Sending fails
        // once the run has ended.
        if events.send(Event::Chunk(source, chunk)).is_err() || is_error {
            return;
        }
    }
}

/// Reads standard input or a file on a thread of its own. It may block in a read until the process
/// ends.
pub(super) fn read_ahead(input: impl Read + Send + 'static, events: SyncSender<Event>) {
    thread::spawn(move || read(input, STANDARD, &events, || ()));
}

/// Assembles chunks into whole lines.
#[derive(Debug)]
pub(super) struct Lines {
    /// Beginning of a line whose end has not arrived.
    waiting: Vec<u8>,
    /// Length of that line, including bytes that were dropped.
    length: u64,
    longest: usize,
    /// The last `TAIL` bytes received, and the last ones of whole lines.
    recent: Vec<u8>,
    whole: Vec<u8>,
}

/// Drops all but the last `TAIL` bytes.
fn keep_last(bytes: &mut Vec<u8>) {
    bytes.drain(..bytes.len().saturating_sub(TAIL));
}

/// Marks the beginning of a line that was too long to keep. JSON cannot begin like this.
pub(super) const TOO_LONG: &[u8] = b"\x00\x00too long\x00";
/// Bytes kept of such a line: its offset may be among them.
const KEPT: usize = 128;

impl Lines {
    /// Creates an assembler for lines of at most about `longest` bytes.
    pub(super) fn new(longest: usize) -> Self {
        let (waiting, recent, whole) = (Vec::new(), Vec::new(), Vec::new());
        Self { waiting, length: 0, longest, recent, whole }
    }

    fn is_too_long(&self) -> bool {
        self.length > self.longest as u64
    }

    /// Adds a chunk, and appends the lines that are now whole to a batch. Returns the number of
    /// their bytes as they arrived.
    pub(super) fn add(&mut self, chunk: &[u8], batch: &mut Vec<u8>) -> u64 {
        let end = chunk.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        // `lines` completes the waiting line and may hold more; `rest` begins the next one.
        let (mut lines, rest) = chunk.split_at(end);
        let mut whole = 0;
        if !lines.is_empty() {
            self.recent.extend(lines);
            keep_last(&mut self.recent);
            // A line ends here, so the position counts these bytes.
            self.whole.clone_from(&self.recent);
            whole = self.length + end as u64;
            // Only the beginning of the waiting line was kept, without an end: put the mark before
            // it, and drop the rest of the line from this chunk.
            if self.is_too_long() {
                batch.extend(TOO_LONG);
                let end = lines.iter().position(|&byte| byte == b'\n').unwrap_or(0);
                lines = &lines[end..];
            }
            batch.append(&mut self.waiting);
            batch.extend(lines);
            self.length = 0;
        }
        self.recent.extend(rest);
        keep_last(&mut self.recent);
        if !self.is_too_long() {
            self.waiting.extend(rest);
        }
        self.length += rest.len() as u64;
        if self.is_too_long() {
            // The rest of the line is only counted, so its memory is bounded whatever the input
            // sends.
            self.waiting.truncate(KEPT);
            self.waiting.shrink_to_fit();
        }
        whole
    }

    /// Appends the last line if it lacks its end but is valid JSON, and returns the number of its
    /// bytes. Otherwise the writer was cut off within it, and may send it again.
    pub(super) fn end(&mut self, batch: &mut Vec<u8>) -> u64 {
        if self.is_too_long() || serde_json::from_slice::<IgnoredAny>(&self.waiting).is_err() {
            return 0;
        }
        batch.append(&mut self.waiting);
        batch.push(b'\n');
        self.whole.clone_from(&self.recent);
        std::mem::take(&mut self.length)
    }

    /// The last bytes of whole lines.
    pub(super) fn tail(&self) -> Tail {
        Tail::of(&self.whole)
    }

    /// Bytes of the line whose end has not arrived.
    pub(super) fn unfinished(&self) -> u64 {
        self.length
    }
}
