//! Work on each of many drives, in parallel with the feature `rayon`.

use super::MatchMemory;

/// Results for all items, in their order, each computed by one thread with a memory.
pub(super) fn each<T: Sync, R: Send>(
    items: &[T],
    memory: &mut MatchMemory,
    work: impl Fn(&T, &mut MatchMemory) -> R + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use std::sync::{Mutex, PoisonError};

        use rayon::prelude::*;

        // Memories go from item to item, so that there are no more than threads.
        let spare = Mutex::new(vec![std::mem::take(memory)]);
        let lock = || spare.lock().unwrap_or_else(PoisonError::into_inner);
        let work = |item: &T| {
            let mut memory = lock().pop().unwrap_or_default();
            let result = work(item, &mut memory);
            lock().push(memory);
            result
        };
        let results = items.par_iter().map(work).collect();
        *memory = lock().pop().unwrap_or_default();
        results
    }
    #[cfg(not(feature = "rayon"))]
    items.iter().map(|item| work(item, memory)).collect()
}
