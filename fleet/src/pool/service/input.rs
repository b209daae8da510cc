//! Input that comes in chunks, as whole lines.

use std::io::{self, Read};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// Bytes that are read at once.
const CHUNK: usize = 1 << 18;
/// Chunks that wait while others are worked on.
const WAITING: usize = 16;

/// What the run waits for.
#[derive(Debug)]
pub(super) enum Event {
    Chunk(io::Result<Vec<u8>>),
    /// The input has ended.
    End,
    /// Something is asked for.
    Wake,
}

/// Reads an input on a thread of its own, which ends with the process at the latest.
pub(super) fn read_ahead(
    mut input: impl Read + Send + 'static,
) -> (SyncSender<Event>, Receiver<Event>) {
    let (sender, receiver) = sync_channel(WAITING);
    let events = sender.clone();
    thread::spawn(move || {
        loop {
            let mut chunk = vec![0; CHUNK];
            let chunk = match input.read(&mut chunk) {
                Ok(0) => {
                    _ = sender.send(Event::End);
                    return;
                }
                Ok(count) => {
                    chunk.truncate(count);
                    Ok(chunk)
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => Err(error),
            };
            let is_error = chunk.is_err();
            if sender.send(Event::Chunk(chunk)).is_err() || is_error {
                return;
            }
        }
    });
    (events, receiver)
}

/// Chunks that become whole lines.
pub(super) struct Lines {
    /// Begin of a line whose end has not come.
    waiting: Vec<u8>,
    /// True if the begin of the line has been dropped.
    is_too_long: bool,
    longest: usize,
    /// Bytes of whole lines so far, and of that which is not whole.
    pub(super) whole: u64,
    rest: u64,
}

/// Stands for a line that is too long to be kept: no line of JSON begins so.
pub(super) const TOO_LONG: &[u8] = b"\x00";

impl Lines {
    /// Lines of at most so many bytes, after so many bytes of others.
    pub(super) fn new(longest: usize, whole: u64) -> Self {
        Self { waiting: Vec::new(), is_too_long: false, longest, whole, rest: 0 }
    }

    /// Adds what has come, and appends the lines that are whole to a batch.
    pub(super) fn add(&mut self, chunk: &[u8], batch: &mut Vec<u8>) {
        let whole = chunk.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        let (mut lines, rest) = chunk.split_at(whole);
        if !lines.is_empty() {
            self.whole += self.rest + whole as u64;
            self.rest = 0;
        }
        self.rest += rest.len() as u64;
        if self.is_too_long && !lines.is_empty() {
            let end = lines.iter().position(|&byte| byte == b'\n').unwrap_or(0);
            batch.extend(TOO_LONG);
            lines = &lines[end..];
            self.is_too_long = false;
        }
        if !lines.is_empty() {
            batch.append(&mut self.waiting);
            batch.extend(lines);
        }
        if !self.is_too_long {
            self.waiting.extend(rest);
        }
        if self.waiting.len() > self.longest {
            self.waiting = Vec::new();
            self.is_too_long = true;
        }
    }

    /// Appends the last line, if it has no end.
    pub(super) fn end(&mut self, batch: &mut Vec<u8>) {
        self.whole += std::mem::take(&mut self.rest);
        batch.append(&mut self.waiting);
        if self.is_too_long {
            batch.extend(TOO_LONG);
        }
    }
}
