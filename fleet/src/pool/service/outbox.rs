//! Answers on their way to a connection.
//!
//! The run never waits for a connection: it leaves answers here, and a thread of the connection
//! sends them. While many answers wait, no more lines of that connection are read. So a client that
//! never reads stalls itself, and takes memory for at most [`MANY`] bytes of answers plus those to
//! [`AHEAD`] chunks of lines.

use std::io::Write;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::seats::Seat;

/// Bytes of unsent answers above which no more lines are read.
const MANY: usize = 1 << 20;

/// Maximum number of chunks of lines waiting to be answered.
const AHEAD: usize = 4;

/// Answers not sent yet.
#[derive(Debug)]
pub(super) struct Outbox {
    state: Mutex<State>,
    changed: Condvar,
    /// Held as long as answers may come.
    _seat: Arc<Seat>,
}

#[derive(Debug, Default)]
struct State {
    waiting: Vec<u8>,
    /// Bytes waiting or being sent.
    unsent: usize,
    /// Chunks of lines read but not answered.
    chunks: usize,
    /// True if no more will come.
    is_closed: bool,
    /// True if the other end is gone.
    is_gone: bool,
}

impl Outbox {
    pub(super) fn new(seat: Arc<Seat>) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), _seat: seat }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues answers for sending.
    pub(super) fn put(&self, answers: &[u8]) {
        let mut state = self.lock();
        if state.is_gone || answers.is_empty() {
            return;
        }
        state.waiting.extend(answers);
        state.unsent += answers.len();
        self.changed.notify_all();
    }

    /// Records that no more will come.
    pub(super) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }

    /// Drops what is waiting, and whatever may come.
    pub(super) fn abandon(&self) {
        let mut state = self.lock();
        *state = State { is_closed: true, is_gone: true, ..State::default() };
        self.changed.notify_all();
    }

    /// True if everything has been sent, or the other end is gone.
    pub(super) fn is_done(&self) -> bool {
        let state = self.lock();
        state.is_gone || (state.is_closed && state.unsent == 0)
    }

    /// Waits until another chunk of lines may be read, and counts it.
    pub(super) fn wait_for_room(&self) {
        let state = self.lock();
        // Without `is_gone`, a reader could wait forever for a sender that has given up.
        let is_full =
            |state: &mut State| (state.unsent > MANY || state.chunks >= AHEAD) && !state.is_gone;
        let state = self.changed.wait_while(state, is_full);
        state.unwrap_or_else(PoisonError::into_inner).chunks += 1;
    }

    /// Records that a chunk of lines has been answered.
    pub(super) fn answered(&self) {
        let mut state = self.lock();
        state.chunks = state.chunks.saturating_sub(1);
        self.changed.notify_all();
    }

    /// Waits until everything has been sent, or until a deadline.
    pub(super) fn wait_until_done(&self, until: Instant) {
        while !self.is_done() {
            let rest = until.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return;
            }
            let state = self.lock();
            let busy = |state: &mut State| state.unsent > 0 && !state.is_gone;
            drop(self.changed.wait_timeout_while(state, rest, busy));
        }
    }

    /// Sends answers until no more come, or the other end is gone.
    pub(super) fn send(&self, mut stream: impl Write) {
        loop {
            let state = self.lock();
            let is_idle = |state: &mut State| state.waiting.is_empty() && !state.is_closed;
            let state = self.changed.wait_while(state, is_idle);
            let mut state = state.unwrap_or_else(PoisonError::into_inner);
            // Written without the lock, so the run can go on leaving answers; they are sent
            // together next time.
            let answers = std::mem::take(&mut state.waiting);
            drop(state);
            // Closed, and nothing left to send.
            if answers.is_empty() {
                return;
            }
            if stream.write_all(&answers).is_err() {
                self.abandon();
                return;
            }
            let mut state = self.lock();
            state.unsent = state.unsent.saturating_sub(answers.len());
            self.changed.notify_all();
        }
    }
}
