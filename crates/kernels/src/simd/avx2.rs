//! AVX2: eight doubles in two registers of four.

#[allow(clippy::wildcard_imports, reason = "intrinsics carry the names of instructions")]
use std::arch::{asm, x86_64::*};

use super::{Eight, LANES, Simd};

/// Proof of AVX2. True if gathers are instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx2(pub(super) bool);

type Pair = (__m256d, __m256d);

/// Methods that are one intrinsic, for both registers of a pair.
macro_rules! pairwise {
    ($($name:ident: $intrinsic:path;)*) => {$(
        #[inline(always)]
        fn $name(self, a: Pair, b: Pair) -> Pair {
            // SAFETY: `self` proves AVX2, which has all intrinsics that the macro is called with;
            // they touch no memory.
            unsafe { ($intrinsic(a.0, b.0), $intrinsic(a.1, b.1)) }
        }
    )*};
}

impl Simd for Avx2 {
    type V = Pair;
    type M = Pair;
    /// As 64-bit lanes.
    type I = (__m256i, __m256i);

    pairwise! {
        add: _mm256_add_pd;
        sub: _mm256_sub_pd;
        mul: _mm256_mul_pd;
        div: _mm256_div_pd;
        min: _mm256_min_pd;
        max: _mm256_max_pd;
        lt: _mm256_cmp_pd::<_CMP_LT_OQ>;
        eq: _mm256_cmp_pd::<_CMP_EQ_OQ>;
        and: _mm256_and_pd;
        or: _mm256_or_pd;
    }

    #[inline(always)]
    fn bits(self, m: Pair) -> u8 {
        // SAFETY: `self` proves AVX2; the instructions touch no memory.
        unsafe { (_mm256_movemask_pd(m.0) | _mm256_movemask_pd(m.1) << 4).cast_unsigned() as u8 }
    }
    #[inline(always)]
    fn any(self, m: Pair) -> bool {
        // SAFETY: `self` proves AVX2; the instructions touch no memory.
        unsafe { _mm256_movemask_pd(_mm256_or_pd(m.0, m.1)) != 0 }
    }
    #[inline(always)]
    fn split_exponent(self, v: Pair) -> (Pair, Pair) {
        // SAFETY: `split_four` requires only AVX2, which `self` proves.
        unsafe {
            let (low, high) = (split_four(v.0), split_four(v.1));
            ((low.0, high.0), (low.1, high.1))
        }
    }

    #[inline(always)]
    fn power_of_two(self, n: Pair) -> Pair {
        // SAFETY: `self` proves AVX2; the instructions touch no memory.
        unsafe {
            // The last bits are those of n: shifted to the exponent and added to the bits of 1,
            // they make 2^n.
            let one = _mm256_castpd_si256(_mm256_set1_pd(1.0));
            let power = |n: __m256d| {
                let exponent = _mm256_slli_epi64::<52>(_mm256_castpd_si256(n));
                _mm256_castsi256_pd(_mm256_add_epi64(exponent, one))
            };
            (power(n.0), power(n.1))
        }
    }
    #[inline(always)]
    fn splat(self, x: f64) -> Pair {
        // SAFETY: `self` proves AVX2; the instruction touches no memory.
        let four = unsafe { _mm256_set1_pd(x) };
        (four, four)
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> Pair {
        // SAFETY: `self` proves AVX2. The reference is to eight doubles; one load reads the first
        // four, the other the last four, at any alignment.
        unsafe { (_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[4..].as_ptr())) }
    }
    #[inline(always)]
    fn store(self, v: Pair, out: &mut Eight) {
        // SAFETY: `self` proves AVX2. The reference is to eight doubles and unique; each store
        // writes four of them, at any alignment.
        unsafe {
            _mm256_storeu_pd(out.as_mut_ptr(), v.0);
            _mm256_storeu_pd(out[4..].as_mut_ptr(), v.1);
        }
    }
    #[inline(always)]
    fn stream(self, v: Pair, out: &mut Eight) {
        if is_line(out) {
            // SAFETY: `self` proves AVX2, and the reference is to eight doubles. `is_line` has
            // found them on a cache line, so that both halves are aligned to 32 bytes, as these
            // stores need. `fence`, which follows the last, orders them before later stores.
            unsafe {
                _mm256_stream_pd(out.as_mut_ptr(), v.0);
                _mm256_stream_pd(out[4..].as_mut_ptr(), v.1);
            }
        } else {
            self.store(v, out);
        }
    }
    #[inline(always)]
    fn fence(self) {
        // SAFETY: SSE, which all x86-64 processors have, contains this barrier.
        unsafe { _mm_sfence() }
    }
    #[inline(always)]
    fn select(self, m: Pair, a: Pair, b: Pair) -> Pair {
        // SAFETY: `self` proves AVX2; the instruction touches no memory. (It reads only the sign of
        // a lane, and comparisons set all bits.)
        unsafe { (_mm256_blendv_pd(b.0, a.0, m.0), _mm256_blendv_pd(b.1, a.1, m.1)) }
    }
    #[inline(always)]
    fn broadcast_lanes(self, v: Pair) -> [Pair; LANES] {
        // SAFETY: `splat_four` requires only AVX2, which `self` proves.
        unsafe {
            let [a, b, c, d] = splat_four(v.0);
            let [e, f, g, h] = splat_four(v.1);
            [(a, a), (b, b), (c, c), (d, d), (e, e), (f, f), (g, g), (h, h)]
        }
    }
    #[inline(always)]
    fn transpose(self, rows: [Pair; LANES]) -> [Pair; LANES] {
        let [a, b, c, d, e, f, g, h] = rows;
        // SAFETY: `transpose_four` requires only AVX2, which `self` proves.
        unsafe {
            // Quarters of four rows and four columns: those off the diagonal swap places.
            let (top, below) =
                (transpose_four(a.0, b.0, c.0, d.0), transpose_four(e.0, f.0, g.0, h.0));
            let (top_right, below_right) =
                (transpose_four(a.1, b.1, c.1, d.1), transpose_four(e.1, f.1, g.1, h.1));
            let mut columns = [a; LANES];
            for r in 0..4 {
                columns[r] = (top[r], below[r]);
                columns[r + 4] = (top_right[r], below_right[r]);
            }
            columns
        }
    }
    #[inline(always)]
    fn gathers(self) -> bool {
        self.0
    }
    #[inline(always)]
    unsafe fn gather<const INSTRUCTION: bool>(self, x: &[f64], indices: &[u32; LANES]) -> Pair {
        // SAFETY: `self` proves AVX2. The caller promises that all indices are below the number of
        // values of x, so that `load_four` and the gathers read values of x, and that this is below
        // 2^31, so that gathers, which take indices with a sign, see none as negative. The loads of
        // indices read four each of eight.
        unsafe {
            if !INSTRUCTION {
                let (x, first) = (x.as_ptr(), indices.as_ptr());
                return (load_four(x, first), load_four(x, first.add(4)));
            }
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_i32gather_pd::<8>(x.as_ptr(), low), _mm256_i32gather_pd::<8>(x.as_ptr(), high))
        }
    }
    #[inline(always)]
    fn no_unroll(self) {
        // SAFETY: the assembly is empty: it reads and writes nothing, as its options say.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn load_indices(self, indices: &[u32; LANES]) -> Self::I {
        // SAFETY: `self` proves AVX2. The reference is to eight indices; each load reads four of
        // them, at any alignment.
        unsafe {
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_cvtepu32_epi64(low), _mm256_cvtepu32_epi64(high))
        }
    }
    #[inline(always)]
    fn iota(self, base: u32) -> Self::I {
        // SAFETY: `self` proves AVX2; the instructions touch no memory.
        unsafe {
            let base = _mm256_set1_epi64x(i64::from(base));
            let (low, high) = (_mm256_setr_epi64x(0, 1, 2, 3), _mm256_setr_epi64x(4, 5, 6, 7));
            (_mm256_add_epi64(base, low), _mm256_add_epi64(base, high))
        }
    }
    #[inline(always)]
    fn lt_index(self, a: Self::I, b: Self::I) -> Pair {
        // SAFETY: `self` proves AVX2; the instruction touches no memory. (The comparison
        // is signed. Indices have 32 bits, so no lane of 64 is negative.)
        unsafe {
            let (low, high) = (_mm256_cmpgt_epi64(b.0, a.0), _mm256_cmpgt_epi64(b.1, a.1));
            (_mm256_castsi256_pd(low), _mm256_castsi256_pd(high))
        }
    }
    #[inline(always)]
    fn select_index(self, m: Pair, a: Self::I, b: Self::I) -> Self::I {
        // SAFETY: `self` proves AVX2; the instruction touches no memory.
        unsafe {
            let m = (_mm256_castpd_si256(m.0), _mm256_castpd_si256(m.1));
            (_mm256_blendv_epi8(b.0, a.0, m.0), _mm256_blendv_epi8(b.1, a.1, m.1))
        }
    }
    #[inline(always)]
    fn store_indices(self, i: Self::I, out: &mut [u32; LANES]) {
        // SAFETY: `self` proves AVX2. The reference is to eight indices, 32 bytes, and unique; the
        // store writes as many, at any alignment.
        unsafe {
            // The low halves of the lanes of each vector, in order and twice: the blend takes the
            // first copy of `low` and the second of `high`.
            let even = _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6);
            let low = _mm256_permutevar8x32_epi32(i.0, even);
            let high = _mm256_permutevar8x32_epi32(i.1, even);
            let all = _mm256_blend_epi32::<0b1111_0000>(low, high);
            _mm256_storeu_si256(out.as_mut_ptr().cast(), all);
        }
    }
}

/// Splats each of four lanes.
#[inline]
#[target_feature(enable = "avx2")]
fn splat_four(v: __m256d) -> [__m256d; 4] {
    [
        _mm256_permute4x64_pd::<0x00>(v),
        _mm256_permute4x64_pd::<0x55>(v),
        _mm256_permute4x64_pd::<0xaa>(v),
        _mm256_permute4x64_pd::<0xff>(v),
    ]
}

/// Exponents and mantissas of four numbers.
#[inline]
#[target_feature(enable = "avx2")]
fn split_four(v: __m256d) -> (__m256d, __m256d) {
    // The double 2^52 + e has the exponent e in its last bits. So the conversion from integers,
    // which AVX2 lacks for 64 bits, is a subtraction. Numbers are positive: no sign is among the
    // shifted bits.
    let whole = _mm256_set1_pd((1_u64 << 52) as f64);
    let bits = _mm256_castpd_si256(v);
    let exponent = _mm256_or_pd(_mm256_castsi256_pd(_mm256_srli_epi64::<52>(bits)), whole);
    let exponent = _mm256_sub_pd(exponent, _mm256_add_pd(whole, _mm256_set1_pd(1023.0)));
    let fraction = _mm256_set1_epi64x((u64::MAX >> 12).cast_signed());
    let mantissa = _mm256_castsi256_pd(_mm256_and_si256(bits, fraction));
    (exponent, _mm256_or_pd(mantissa, _mm256_set1_pd(1.0)))
}

/// Transposes four rows of four.
#[inline]
#[target_feature(enable = "avx2")]
fn transpose_four(a: __m256d, b: __m256d, c: __m256d, d: __m256d) -> [__m256d; 4] {
    let (even, odd) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
    let (even_after, odd_after) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
    [
        _mm256_permute2f128_pd::<0x20>(even, even_after),
        _mm256_permute2f128_pd::<0x20>(odd, odd_after),
        _mm256_permute2f128_pd::<0x31>(even, even_after),
        _mm256_permute2f128_pd::<0x31>(odd, odd_after),
    ]
}

/// True if eight doubles are a cache line.
#[inline(always)]
pub(super) fn is_line(eight: &Eight) -> bool {
    eight.as_ptr().addr().is_multiple_of(size_of::<Eight>())
}

/// Four values at the four indices that `first` points to, by loads.
///
/// # Safety
///
/// `first` must point to four indices, all within the allocation of `x`, and the processor must have
/// AVX2.
#[inline(always)]
pub(super) unsafe fn load_four(x: *const f64, first: *const u32) -> __m256d {
    // SAFETY: the caller promises four indices, that is two pairs, and that they are within the
    // allocation of x. Each of the four loads reads one double there. The call comes from a method
    // of a proof of AVX2, which the insertion needs.
    unsafe {
        // Two pairs: a load into each half of a register, and the halves are put together. Four
        // loads and three instructions take less time than a gather in microcode. Indices come two
        // at a time, since loads are the bottleneck: 8% of a product on a large map (Zen 4).
        let pair = |pair: *const u32| {
            let both = pair.cast::<u64>().read_unaligned();
            let at = |index: u64| x.add(index as usize);
            _mm_loadh_pd(_mm_load_sd(at(both & u64::from(u32::MAX))), at(both >> 32))
        };
        let (low, high) = (pair(first), pair(first.add(2)));
        _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(low), high)
    }
}
