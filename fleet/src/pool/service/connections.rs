//! Inputs of a run: standard input or a file, and connections.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::input::{Lines, STANDARD, Source};
use super::listen::Peer;
use super::position::{Position, Tail};
use crate::pool::VehicleId;

/// Time that connections get to take their last answers.
const PATIENCE: Duration = Duration::from_secs(2);
/// Maximum number and length of client names.
const MOST_NAMES: usize = 10_000;
const LONGEST_NAME: usize = 256;

/// A batch of whole lines that have arrived.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) text: Vec<u8>,
    /// For each piece of the text, its end and its input.
    pieces: Vec<(usize, Source)>,
    /// Bytes of the lines as they arrived.
    pub(super) bytes: u64,
    /// Inputs that have ended: these are their last lines.
    ended: Vec<Source>,
}

/// A line and its input.
#[derive(Debug, Clone, Copy)]
pub(super) struct Text<'a> {
    pub(super) source: Source,
    pub(super) line: &'a [u8],
}

impl Batch {
    pub(super) fn clear(&mut self) {
        self.text.clear();
        self.pieces.clear();
        self.ended.clear();
        self.bytes = 0;
    }

    /// The lines in order of arrival.
    pub(super) fn lines(&self) -> impl Iterator<Item = Text<'_>> {
        let mut begin = 0;
        let pieces = self.pieces.iter().map(move |&(end, source)| {
            let text = &self.text[begin..end];
            begin = end;
            (source, text)
        });
        pieces.flat_map(|(source, text)| {
            let lines = text.split_inclusive(|&byte| byte == b'\n');
            lines.map(move |line| Text { source, line: line.strip_suffix(b"\n").unwrap_or(line) })
        })
    }
}

/// The open inputs.
#[derive(Debug)]
pub(super) struct Connections {
    open: HashMap<Source, Input>,
    /// Connections whose last answers are being sent.
    closing: Vec<Peer>,
    longest: usize,
}

#[derive(Debug)]
struct Input {
    lines: Lines,
    /// Name that the client gave itself.
    name: Option<String>,
    /// None for standard input.
    peer: Option<Peer>,
}

impl Connections {
    /// Begins with standard input or a file; lines may have about `longest` bytes.
    pub(super) fn new(longest: usize) -> Self {
        let standard = Input { lines: Lines::new(longest), name: None, peer: None };
        Self { open: HashMap::from([(STANDARD, standard)]), closing: Vec::new(), longest }
    }

    /// Number of inputs.
    pub(super) fn len(&self) -> usize {
        self.open.len()
    }

    pub(super) fn open(&mut self, source: Source, peer: Peer) {
        let lines = Lines::new(self.longest);
        self.open.insert(source, Input { lines, name: None, peer: Some(peer) });
    }

    /// Adds a chunk to a batch.
    pub(super) fn add(&mut self, source: Source, chunk: &[u8], batch: &mut Batch) {
        // A connection that was cut off is gone, but its chunks may still be in the queue.
        if let Some(input) = self.open.get_mut(&source) {
            batch.bytes += input.lines.add(chunk, &mut batch.text);
            batch.pieces.push((batch.text.len(), source));
        }
    }

    /// Tail of the whole lines of standard input or a file.
    pub(super) fn tail(&self) -> Option<Tail> {
        self.open.get(&STANDARD).map(|input| input.lines.tail())
    }

    /// Adds the last line of an input. Returns the number of bytes after it, which are of a line
    /// that was cut off.
    pub(super) fn end(&mut self, source: Source, batch: &mut Batch) -> u64 {
        let Some(input) = self.open.get_mut(&source) else { return 0 };
        batch.bytes += input.lines.end(&mut batch.text);
        batch.pieces.push((batch.text.len(), source));
        batch.ended.push(source);
        input.lines.unfinished()
    }

    /// Lets connections whose lines are answered read on, and closes those whose last lines are.
    pub(super) fn answered(&mut self, batch: &Batch) {
        // One piece per chunk: this balances `wait_for_room`.
        for (_, source) in &batch.pieces {
            if let Some(peer) = self.open.get(source).and_then(|input| input.peer.as_ref()) {
                peer.outbox.answered();
            }
        }
        self.closing.retain(|peer| !peer.outbox.is_done());
        for source in &batch.ended {
            if let Some(peer) = self.open.remove(source).and_then(|input| input.peer) {
                // Moved to `closing`, since answers are still on their way. The name is free now.
                peer.outbox.close();
                self.closing.push(peer);
            }
        }
    }

    /// Ends all connections, once they have taken their last answers or had time to.
    pub(super) fn end_all(&mut self) {
        let open = self.open.drain().filter_map(|(_, input)| input.peer);
        self.closing.extend(open.inspect(|peer| peer.outbox.close()));
        // One deadline for all, so that many silent connections do not delay the end.
        let until = Instant::now() + PATIENCE;
        for peer in self.closing.drain(..) {
            peer.outbox.wait_until_done(until);
            peer.cut();
        }
    }

    /// Sends answers to the inputs that they are for, line by line; some of these may be gone.
    pub(super) fn answer(&self, texts: &[Vec<u8>], sources: &[Source]) {
        let mut sources = sources.iter().copied();
        for text in texts {
            // Answers for the same connection usually follow one another, so send runs of lines
            // rather than single ones.
            let (mut begin, mut end, mut last) = (0, 0, None);
            for line in text.split_inclusive(|&byte| byte == b'\n') {
                let source = sources.next();
                if source != last {
                    self.send(last, &text[begin..end]);
                    (begin, last) = (end, source);
                }
                end += line.len();
            }
            self.send(last, &text[begin..end]);
        }
    }

    fn send(&self, source: Option<Source>, answers: &[u8]) {
        let input = source.and_then(|source| self.open.get(&source));
        if let Some(peer) = input.and_then(|input| input.peer.as_ref()) {
            peer.outbox.put(answers);
        }
    }

    /// Names a connection, and cuts off another that has the name, which is returned: a client that
    /// comes back after a broken connection replaces its former self.
    pub(super) fn name(
        &mut self,
        source: Source,
        name: &str,
        position: &Position,
    ) -> Result<Option<Source>, &'static str> {
        if source == STANDARD {
            return Err("`client` is for connections");
        }
        if name.len() > LONGEST_NAME {
            return Err("the name is longer than 256 bytes");
        }
        // Names are kept for good, since a client may come back any time; so their number must be
        // bounded.
        if position.clients.len() >= MOST_NAMES && !position.clients.contains_key(name) {
            return Err("10,000 clients have names already");
        }
        let has_name = |input: &Input| input.name.as_deref() == Some(name);
        let mut others = self.open.iter();
        let before = others.find(|(other, input)| **other != source && has_name(input));
        let before = before.map(|(&before, _)| before);
        if let Some(peer) = before.and_then(|before| self.open.remove(&before)?.peer) {
            peer.cut();
        }
        if let Some(input) = self.open.get_mut(&source) {
            input.name = Some(name.to_owned());
        }
        Ok(before)
    }

    /// Records the last offset of an input. Connections without a name have none that could be
    /// asked for later.
    pub(super) fn note(&self, source: Source, offset: VehicleId, position: &mut Position) {
        if source == STANDARD {
            position.offset = Some(offset);
        } else if let Some(name) = self.open.get(&source).and_then(|input| input.name.as_ref()) {
            match position.clients.get_mut(name) {
                Some(last) => *last = offset,
                None => _ = position.clients.insert(name.clone(), offset),
            }
        }
    }
}
