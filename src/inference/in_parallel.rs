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
