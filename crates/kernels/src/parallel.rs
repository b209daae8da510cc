//! Loops over many lines, in parts that several threads can share.
//!
//! Where parts end, and how their results are joined, depends only on the number of lines: results
//! are the same to the bit for any number of threads, and without the feature `rayon`.

use super::simd::{LANES, WithSimd, run};

/// Lines of a part: a multiple of eight.
pub(super) const PART: usize = 4096 * LANES;

/// Fewest lines for several threads: waking them takes time.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 3 * PART;

/// Kernel over independent lines.
pub(crate) trait Splits: WithSimd<Output: Send> + Sized + Send {
    /// Number of lines.
    fn lines(&self) -> usize;

    /// Splits before this line, a multiple of eight.
    fn split(self, at: usize) -> (Self, Self);

    /// Joins the results of two parts.
    fn join(first: Self::Output, second: Self::Output) -> Self::Output;
}

/// Runs a kernel with the chosen instructions, on several threads if there are many lines.
#[inline(always)]
pub(crate) fn run_in_parts<K: Splits>(kernel: K) -> K::Output {
    // This test comes first, as most models are one part, and should pay nothing for the others.
    let lines = kernel.lines();
    if lines <= PART {
        return run(kernel);
    }
    #[cfg(feature = "rayon")]
    if lines >= PARALLEL {
        return on_threads(kernel);
    }
    in_turn(kernel)
}

/// Splits in the middle, at the end of a part.
fn halves<K: Splits>(kernel: K) -> (K, K) {
    // Half of the parts, rounded up: at least one, and less than all, as there are two or more. It
    // depends only on the number of lines, so that any number of threads adds sums in one order.
    let middle = kernel.lines().div_ceil(2 * PART) * PART;
    kernel.split(middle)
}

pub(super) fn in_turn<K: Splits>(kernel: K) -> K::Output {
    if kernel.lines() <= PART {
        return run(kernel);
    }
    // Not all lines in one run: that would add sums in another order than threads do.
    let (first, second) = halves(kernel);
    K::join(in_turn(first), in_turn(second))
}

#[cfg(feature = "rayon")]
fn on_threads<K: Splits>(kernel: K) -> K::Output {
    if kernel.lines() <= PART {
        return run(kernel);
    }
    let (first, second) = halves(kernel);
    let (first, second) = rayon::join(|| on_threads(first), || on_threads(second));
    K::join(first, second)
}
