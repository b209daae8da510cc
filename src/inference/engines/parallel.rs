//! Work on many items, in parallel with the feature `rayon`.
//!
//! Results come in the order of the items, and none depends on the number of threads.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

/// Maps items in parallel. Each result is computed by one thread, with scratch that is reused from
/// item to item: `run` must not depend on what it holds.
pub fn map<T: Send, M: Default, R: Send>(
    items: Vec<T>,
    run: impl Fn(T, &mut M) -> R + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        // Memory is created for each batch of items that a thread takes, not for each item.
        items.into_par_iter().map_init(M::default, |scratch, item| run(item, scratch)).collect()
    }
    #[cfg(not(feature = "rayon"))]
    {
        let mut scratch = M::default();
        items.into_iter().map(|item| run(item, &mut scratch)).collect()
    }
}

/// Processes items, and passes the results to `take` in the order of the items, on the caller's
/// thread, until none are left or `take` breaks. At most `ahead` items for each thread are in
/// progress or waiting to be taken.
pub fn in_order<T: Send, R: Send, Stop>(
    mut items: impl Iterator<Item = T>,
    ahead: usize,
    run: impl Fn(T) -> R + Sync,
    mut take: impl FnMut(R) -> ControlFlow<Stop>,
) -> ControlFlow<Stop> {
    #[cfg(feature = "rayon")]
    {
        threads::in_order(&mut items, ahead, &run, &mut take)
    }
    #[cfg(not(feature = "rayon"))]
    {
        let _ = ahead;
        items.try_for_each(|item| take(run(item)))
    }
}

/// Pool of unused scratch, for whichever thread needs some next.
#[derive(Debug)]
pub struct ScratchPool<T>(Mutex<Vec<T>>);

impl<T> Default for ScratchPool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

/// Memory is not copied: a clone starts empty.
impl<T> Clone for ScratchPool<T> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl<T> ScratchPool<T> {
    /// Takes scratch out of the pool, if there is any.
    pub fn pop(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }

    /// Returns scratch to the pool.
    pub fn push(&self, scratch: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

#[cfg(feature = "rayon")]
mod threads {
    use std::collections::VecDeque;
    use std::ops::ControlFlow;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
    use std::time::Duration;

    use rayon::Yield;

    /// Time after which a waiting thread of the pool looks for work again.
    const NAP: Duration = Duration::from_micros(100);

    /// Guard that, when dropped (also by a panic), tells items that have not begun that nobody
    /// waits for them.
    struct Stopped<'a>(&'a AtomicBool);

    impl Drop for Stopped<'_> {
        fn drop(&mut self) {
            self.0.store(true, Ordering::Relaxed);
        }
    }

    pub(super) fn in_order<T: Send, R: Send, Stop>(
        items: &mut impl Iterator<Item = T>,
        ahead: usize,
        run: &(impl Fn(T) -> R + Sync),
        take: &mut impl FnMut(R) -> ControlFlow<Stop>,
    ) -> ControlFlow<Stop> {
        // Bounds the number of waiting results: behind one long item, all others could pile up.
        let most = ahead * rayon::current_num_threads();
        let stopped = &AtomicBool::new(false);
        let mut items = items.fuse();
        // First in, first out, so that the item that the caller waits for begins before all later
        // ones.
        rayon::in_place_scope_fifo(|scope| {
            let _stopped = Stopped(stopped);
            let mut under_way = VecDeque::with_capacity(most);
            loop {
                let next = if under_way.len() < most { items.next() } else { None };
                if let Some(item) = next {
                    let (sender, receiver) = sync_channel(1);
                    scope.spawn_fifo(move |_| {
                        if !stopped.load(Ordering::Relaxed) {
                            // Sending fails if the caller has stopped in the meantime.
                            _ = sender.send(run(item));
                        }
                    });
                    under_way.push_back(receiver);
                } else {
                    let Some(first) = under_way.pop_front() else {
                        return ControlFlow::Continue(());
                    };
                    // No result means that the work has panicked, which the scope propagates.
                    let Some(result) = wait(&first) else { return ControlFlow::Continue(()) };
                    take(result)?;
                }
                // Results that are ready are taken before another item begins, which may then reuse
                // their memory.
                while let Some(Ok(result)) = under_way.front().map(Receiver::try_recv) {
                    under_way.pop_front();
                    take(result)?;
                }
            }
        })
    }

    /// Waits for a result. A thread of the pool works meanwhile, since it may be the only one.
    fn wait<R>(receiver: &Receiver<R>) -> Option<R> {
        if rayon::current_thread_index().is_none() {
            // A thread outside the pool just sleeps: all threads of the pool are available for
            // work.
            return receiver.recv().ok();
        }
        loop {
            match receiver.try_recv() {
                Ok(result) => return Some(result),
                Err(TryRecvError::Disconnected) => return None,
                Err(TryRecvError::Empty) => {}
            }
            if rayon::yield_now() != Some(Yield::Executed) {
                match receiver.recv_timeout(NAP) {
                    Ok(result) => return Some(result),
                    Err(RecvTimeoutError::Disconnected) => return None,
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        }
    }
}
