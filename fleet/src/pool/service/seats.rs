//! Seats for connections: a bound on their number.
//!
//! A connection may be silent for as long as it likes: a gate may have no vehicle for hours. But
//! one whose other end lost power is silent, too, and so are those of somebody who only opens them.
//! So once all seats are taken, the connection that has been silent longest makes room.

use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use super::listen::Stream;

/// Maximum number of connections, each with two threads and a line that may wait for its end.
const MOST: usize = 256;
/// Silence after which a connection may have to make room.
const SILENCE: Duration = Duration::from_secs(30);

/// A connection's right to exist, until it is dropped.
#[derive(Debug)]
pub(super) struct Seat {
    stream: Arc<Stream>,
    heard: Mutex<Instant>,
}

impl Seat {
    /// Records that the connection sent something.
    pub(super) fn heard(&self) {
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    fn silence(&self) -> Duration {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
    }
}

/// All seats.
#[derive(Debug)]
pub(super) struct Seats {
    taken: Vec<Weak<Seat>>,
    most: usize,
    silence: Duration,
}

impl Default for Seats {
    fn default() -> Self {
        Self { taken: Vec::new(), most: MOST, silence: SILENCE }
    }
}

impl Seats {
    /// Gives a connection a seat. If none is free, the connection that has been silent longest is
    /// ended; if even that one was heard from lately, the new one gets none.
    pub(super) fn take(&mut self, stream: &Arc<Stream>) -> Option<Arc<Seat>> {
        // A seat is free once all threads of its connection have dropped it.
        self.taken.retain(|seat| seat.strong_count() > 0);
        if self.taken.len() >= self.most {
            let seats = self.taken.iter().enumerate();
            let known = seats.filter_map(|(at, seat)| Some((at, seat.upgrade()?)));
            let (at, seat) = known.max_by_key(|(_, seat)| seat.silence())?;
            if seat.silence() < self.silence {
                return None;
            }
            seat.stream.shut();
            // Its threads end soon after `shut`. For that moment there may be one more connection
            // than seats.
            self.taken.swap_remove(at);
        }
        let seat = Arc::new(Seat { stream: Arc::clone(stream), heard: Mutex::new(Instant::now()) });
        self.taken.push(Arc::downgrade(&seat));
        Some(seat)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read;
    use std::os::unix::net::UnixStream;

    use super::*;

    #[test]
    fn one_that_is_silent_makes_room() {
        let pair = || UnixStream::pair().map(|(near, far)| (Arc::new(Stream::File(near)), far));
        let mut seats = Seats { taken: Vec::new(), most: 2, silence: Duration::ZERO };
        let ((a, mut far_a), (b, _far_b), (c, _far_c)) =
            (pair().unwrap(), pair().unwrap(), pair().unwrap());
        let (seat_a, seat_b) = (seats.take(&a).unwrap(), seats.take(&b).unwrap());
        seat_b.heard();
        let seat_c = seats.take(&c).unwrap();
        assert_eq!(far_a.read(&mut [0]).unwrap(), 0, "the first was silent for longest");
        drop(seat_a);

        seats.silence = Duration::from_mins(1);
        assert!(seats.take(&a).is_none(), "all have been heard of lately");
        drop(seat_c);
        assert!(seats.take(&a).is_some());
        assert_eq!(seats.taken.iter().filter(|seat| seat.strong_count() > 0).count(), 1);
    }
}
