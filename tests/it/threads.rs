//! Pools of threads.

/// Runs work in a pool of this many threads.
pub(crate) fn with_threads<R: Send>(threads: usize, work: impl Fn() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
