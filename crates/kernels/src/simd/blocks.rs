//! Slices as blocks of eight; the last one may be partial.
#![allow(unsafe_code, reason = "a hint that takes an address")]

use super::{Eight, Simd};

/// A slice in blocks of eight, and the rest.
pub(crate) type Blocks<'a> = (&'a [Eight], &'a [f64]);
pub(crate) type BlocksMut<'a> = (&'a mut [Eight], &'a mut [f64]);

/// Loads the block with this number, or the rest.
#[inline(always)]
pub(crate) fn row_block<S: Simd>(s: S, (blocks, rest): Blocks<'_>, number: usize) -> S::V {
    // One comparison is the check of the index, and tells whole blocks from the rest.
    match blocks.get(number) {
        Some(block) => s.load(block),
        None => s.load_partial(rest),
    }
}

/// Loads as [`row_block`], and asks the caches for a block further on: for vectors that are new in
/// each step and are read beside many other streams, such as those of a matrix, so that the
/// processor does not detect one more. With `BEYOND` it also asks for blocks beyond the vector,
/// which belong to the next row if rows are contiguous.
#[inline(always)]
pub(crate) fn row_block_ahead<S: Simd, const BEYOND: bool>(
    s: S,
    blocks: Blocks<'_>,
    number: usize,
) -> S::V {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        /// Distance in blocks from a load to the block that is asked for: more than the time of a
        /// cache miss, in steps on a large map (16 was fastest on Zen 4, 48 nearly as fast).
        const AHEAD: usize = 16;
        let number = number + AHEAD;
        let number = if BEYOND { number } else { number.min(blocks.0.len()) };
        let ahead = blocks.0.as_ptr().wrapping_add(number);
        // SAFETY: a hint, part of all x86-64 processors. It takes any address, and reads nothing
        // that a program could see.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(ahead.cast()) };
    }
    row_block(s, blocks, number)
}

/// Stores to the block with this number, or to the rest.
#[inline(always)]
pub(crate) fn store<S: Simd>(s: S, (blocks, rest): &mut BlocksMut<'_>, number: usize, v: S::V) {
    match blocks.get_mut(number) {
        Some(block) => s.store(v, block),
        None => s.store_partial(v, rest),
    }
}
