//! Operations on eight doubles that all instruction sets have ([`Simd`]), and slices as blocks of
//! eight; the last one may be partial.
//!
//! The only unsafe operations are a gather, whose caller vouches for the indices, and a hint to the
//! caches, which takes an address.

/// Number of lanes of a vector.
pub const LANES: usize = 8;

/// Eight doubles.
pub type Eight = [f64; LANES];

/// Operations on vectors of eight doubles (`V`), masks (`M`) and vectors of eight indices (`I`).
pub trait Simd: Copy {
    type V: Copy;
    type M: Copy;
    type I: Copy;

    fn splat(self, x: f64) -> Self::V;
    fn load(self, x: &Eight) -> Self::V;
    fn store(self, v: Self::V, out: &mut Eight);
    /// Stores past the caches if `out` is a cache line, for results that are not read soon: the
    /// line need not be fetched. [`fence`](Self::fence) must follow the last one.
    #[inline(always)]
    fn stream(self, v: Self::V, out: &mut Eight) {
        self.store(v, out);
    }
    /// Orders streamed stores before all later ones.
    #[inline(always)]
    fn fence(self) {}
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// Lane-wise minimum; `b` if one is NaN.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// Lane-wise maximum; `b` if one is NaN.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// a < b, false if one is NaN.
    fn lt(self, a: Self::V, b: Self::V) -> Self::M;
    /// a = b, false if one is NaN.
    fn eq(self, a: Self::V, b: Self::V) -> Self::M;
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// Bit l is that of lane l.
    fn bits(self, m: Self::M) -> u8;
    #[inline(always)]
    fn any(self, m: Self::M) -> bool {
        self.bits(m) != 0
    }
    #[inline(always)]
    fn all(self, m: Self::M) -> bool {
        self.bits(m) == u8::MAX
    }
    /// Mask of the lanes above 0 and below a limit.
    #[inline(always)]
    fn is_small(self, v: Self::V, limit: f64) -> Self::M {
        self.and(self.lt(v, self.splat(limit)), self.lt(self.splat(0.0), v))
    }
    /// `a` where the mask is set, else `b`.
    fn select(self, m: Self::M, a: Self::V, b: Self::V) -> Self::V;
    /// Exponents, as doubles, and mantissas from 1 to 2, of normal positive numbers.
    fn split_exponent(self, v: Self::V) -> (Self::V, Self::V);
    /// 2^n of integers from −1022 to 1023, given as n + 1.5 · 2^52.
    fn power_of_two(self, n: Self::V) -> Self::V;

    /// True if there is an instruction for `gather`, which is faster than loads.
    #[inline(always)]
    fn gathers(self) -> bool {
        false
    }
    /// `x[index]` for each of eight indices, by one instruction or by loads.
    ///
    /// # Safety
    ///
    /// All indices must be below `x.len()`, which must not exceed 2^31 − 1.
    #[allow(unsafe_code, reason = "an index is not checked: that would cost a fifth of a product")]
    unsafe fn gather<const INSTRUCTION: bool>(self, x: &[f64], indices: &[u32; LANES]) -> Self::V;

    /// Keeps the compiler from unrolling a loop of few turns: it does not duplicate assembly, even
    /// if empty.
    #[inline(always)]
    fn no_unroll(self) {}

    fn load_indices(self, indices: &[u32; LANES]) -> Self::I;
    /// base, base + 1, … base + 7.
    fn iota(self, base: u32) -> Self::I;
    /// a < b, for indices below 2^31.
    fn lt_index(self, a: Self::I, b: Self::I) -> Self::M;
    fn select_index(self, m: Self::M, a: Self::I, b: Self::I) -> Self::I;
    fn store_indices(self, i: Self::I, out: &mut [u32; LANES]);

    /// Splats each lane.
    fn broadcast_lanes(self, v: Self::V) -> [Self::V; LANES];

    /// Transposes: lane l of result r is lane r of row l.
    fn transpose(self, rows: [Self::V; LANES]) -> [Self::V; LANES];

    #[inline(always)]
    fn to_array(self, v: Self::V) -> Eight {
        // Through memory, which the compiler replaces by moves between registers where it can.
        let mut out = [0.0; LANES];
        self.store(v, &mut out);
        out
    }

    /// Loads up to eight values, 0 in the other lanes.
    #[inline(always)]
    fn load_partial(self, x: &[f64]) -> Self::V {
        // A copy, as eight doubles may reach beyond the vector.
        let mut eight = [0.0; LANES];
        eight[..x.len()].copy_from_slice(x);
        self.load(&eight)
    }

    /// Stores as many lanes as there is room for, up to eight.
    #[inline(always)]
    fn store_partial(self, v: Self::V, out: &mut [f64]) {
        out.copy_from_slice(&self.to_array(v)[..out.len()]);
    }
}

/// Sum over the lanes, in pairs.
#[inline(always)]
pub(crate) fn total([a, b, c, d, e, f, g, h]: Eight) -> f64 {
    // The parentheses fix the order: the sum is the same to the bit with any instructions, and in
    // the scalar loops of `vector`.
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

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
        #[allow(unsafe_code, reason = "a hint that takes an address")]
        // SAFETY: a hint, part of all x86-64 processors. It takes any address, and reads nothing
        // that a program could see.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(ahead.cast());
        }
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

/// Stores indices to the block with this number, or to the rest.
#[inline(always)]
pub(crate) fn store_indices<S: Simd>(
    s: S,
    (blocks, rest): &mut (&mut [[u32; LANES]], &mut [u32]),
    block: usize,
    indices: S::I,
) {
    if let Some(block) = blocks.get_mut(block) {
        s.store_indices(indices, block);
    } else {
        // Lanes beyond the last row have an index, too: only those of rows are copied.
        let mut last = [0; LANES];
        s.store_indices(indices, &mut last);
        rest.copy_from_slice(&last[..rest.len()]);
    }
}
