//! A routine for each of many sequences, in parallel with the feature `rayon`.

use crate::error::{InferenceError, SequenceError};

/// Results of all sequences, in order.
pub(super) type Results<R> = Vec<Result<R, SequenceError>>;

/// Applies a routine to each sequence. Each result is computed by one thread, and does not depend
/// on the number of threads.
pub(super) fn each<S: Sync, R: Send>(
    sequences: &[S],
    routine: impl Fn(&S) -> Result<R, InferenceError> + Sync,
) -> Results<R> {
    let one = |(sequence, s): (usize, &S)| {
        routine(s).map_err(|source| SequenceError { sequence, source })
    };
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        sequences.par_iter().enumerate().map(one).collect()
    }
    #[cfg(not(feature = "rayon"))]
    sequences.iter().enumerate().map(one).collect()
}

/// Maps items, each by one thread with memory of its own, in parallel with the feature `rayon`.
pub(super) fn map<T: Send, M: Default, R: Send>(
    items: Vec<T>,
    work: impl Fn(T, &mut M) -> R + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        items.into_par_iter().map_init(M::default, |memory, item| work(item, memory)).collect()
    }
    #[cfg(not(feature = "rayon"))]
    {
        let mut memory = M::default();
        items.into_iter().map(|item| work(item, &mut memory)).collect()
    }
}
