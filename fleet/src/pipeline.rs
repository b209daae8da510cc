//! Parallel work on items, with results taken in the order of the items.
//!
//! Each item travels with the sender of a channel of its own, and the receivers wait in a queue in
//! the order of the items. So the order holds by construction, however long each item takes, and
//! the length of the queue bounds the memory.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

/// Works on items with `threads` threads, and takes the results in the order of the items. Items
/// are read and results taken on the caller's thread.
///
/// At most `ahead` items per thread are in flight or wait to be taken. An item that is an error
/// ends the work, after the results of all items before it.
///
/// # Errors
///
/// The first error of an item or of `take`, in the order of the items.
pub(crate) fn in_order<T: Send, R: Send, E>(
    items: impl Iterator<Item = Result<T, E>>,
    threads: usize,
    ahead: usize,
    work: impl Fn(T) -> R + Sync,
    mut take: impl FnMut(R) -> Result<(), E>,
) -> Result<(), E> {
    let most = threads.max(1) * ahead.max(1);
    let (jobs, to_do) = channel::<(T, SyncSender<R>)>();
    let to_do = Mutex::new(to_do);
    thread::scope(|scope| {
        // `jobs` is moved in, so that it is dropped at the end of this closure, also on an early
        // return: the workers then find the channel closed and end, and the scope can join them.
        let jobs = jobs;
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let Some((item, sender)) = next(&to_do) {
                    // After an error nobody receives the result.
                    _ = sender.send(work(item));
                }
            });
        }
        let mut under_way: VecDeque<Receiver<R>> = VecDeque::with_capacity(most);
        // After an error no more items are read, but those in flight are still taken.
        let mut items = items.fuse();
        let mut ended = None;
        loop {
            // Keep the workers busy first. Only with a full queue, or no more items, wait for the
            // oldest result.
            let next = if ended.is_none() && under_way.len() < most { items.next() } else { None };
            match next {
                Some(Ok(item)) => {
                    // With room for one result, a worker never waits for the caller.
                    let (sender, receiver) = sync_channel(1);
                    if jobs.send((item, sender)).is_err() {
                        return Ok(()); // every thread has panicked, which the scope passes on
                    }
                    under_way.push_back(receiver);
                }
                Some(Err(error)) => ended = Some(error),
                None => {
                    let Some(first) = under_way.pop_front() else { break };
                    // Without a result, the work has panicked, which the scope passes on.
                    let Ok(result) = first.recv() else { return Ok(()) };
                    take(result)?;
                }
            }
            // Take what is ready in order without waiting, so that results do not pile up while
            // reading is slow.
            while let Some(Ok(result)) = under_way.front().map(Receiver::try_recv) {
                under_way.pop_front();
                take(result)?;
            }
        }
        ended.map_or(Ok(()), Err)
    })
}

fn next<T>(to_do: &Mutex<Receiver<T>>) -> Option<T> {
    // The lock is held while waiting for an item. Other idle workers then wait for the lock, which
    // has the same effect; busy workers hold no lock.
    to_do.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_the_order_and_ends_with_the_first_error() {
        for threads in 1..4 {
            let mut taken = Vec::new();
            let items = (0..100).map(|k| if k == 70 { Err(k) } else { Ok(k) });
            let work = |k: u64| {
                thread::sleep(std::time::Duration::from_micros(k * 37 % 100));
                2 * k
            };
            let done = in_order(items, threads, 3, work, |twice| {
                taken.push(twice);
                Ok(())
            });
            assert_eq!(done, Err(70));
            assert!(taken.iter().copied().eq((0..70).map(|k| 2 * k)));
        }
    }

    #[test]
    fn stops_when_a_result_is_refused() {
        let mut taken = 0;
        let done = in_order(
            (0_u32..).map(Ok),
            2,
            2,
            |k| k,
            |k| {
                taken += 1;
                if k == 9 { Err("enough") } else { Ok(()) }
            },
        );
        assert_eq!((done, taken), (Err("enough"), 10));
    }
}
