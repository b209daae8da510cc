//! AVX2 and AVX-512.

use super::{Eight, LANES, Simd};
#[allow(clippy::wildcard_imports, reason = "intrinsics carry the names of instructions")]
use std::arch::{asm, x86_64::*};
use std::sync::OnceLock;

/// Proof of AVX2: two registers of four doubles. True if gathers are instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx2(pub(super) bool);

/// Proof of AVX-512 F and VL, and AVX2: one register of eight doubles. True if gathers are
/// instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx512(pub(super) bool);

type Pair = (__m256d, __m256d);

/// True if gather instructions are faster than eight loads. On AMD's processors (Zen 1 to 5) they
/// are microcode: loads take 25% less time for a whole Viterbi step, 7 to 14% for a smoother.
pub(super) fn gathers() -> bool {
    static GATHERS: OnceLock<bool> = OnceLock::new();
    *GATHERS.get_or_init(|| {
        #[allow(unused_unsafe, reason = "safe in later versions of the standard library")]
        // SAFETY: all x86-64 processors have this instruction.
        let vendor = unsafe { __cpuid(0) };
        // "Auth" of AuthenticAMD, "Hygo" of HygonGenuine, in the order of bytes in a register.
        ![u32::from_le_bytes(*b"Auth"), u32::from_le_bytes(*b"Hygo")].contains(&vendor.ebx)
    })
}

/// True if eight doubles are a cache line.
#[inline(always)]
fn is_line(eight: &Eight) -> bool {
    eight.as_ptr().addr().is_multiple_of(size_of::<Eight>())
}

/// Four values at these indices, by loads.
///
/// # Safety
///
/// All indices must be within the allocation of `x`.
#[inline(always)]
unsafe fn load_four(x: *const f64, [a, b, c, d]: [u32; 4]) -> __m256d {
    // SAFETY: the indices are the caller's; AVX2 is proved by the caller's token.
    unsafe {
        let at = |i: u32| x.add(i as usize);
        let low = _mm_loadh_pd(_mm_load_sd(at(a)), at(b));
        let high = _mm_loadh_pd(_mm_load_sd(at(c)), at(d));
        _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(low), high)
    }
}

/// The lower and upper half of eight indices.
#[inline(always)]
fn halves([a, b, c, d, e, f, g, h]: [u32; LANES]) -> ([u32; 4], [u32; 4]) {
    ([a, b, c, d], [e, f, g, h])
}

// SAFETY, for all blocks below: `self` exists only after detection of the instructions
// (`run_unchecked`); pointers come from references to arrays of the size that is read or
// written, or to slices with masks of their length; indices of gathers are the caller's.

/// Methods that are one intrinsic, for both registers of a pair.
macro_rules! pairwise {
    ($($name:ident: $intrinsic:path;)*) => {$(
        #[inline(always)]
        fn $name(self, a: Pair, b: Pair) -> Pair {
            unsafe { ($intrinsic(a.0, b.0), $intrinsic(a.1, b.1)) }
        }
    )*};
}

/// Methods that are one intrinsic.
macro_rules! single {
    ($($name:ident: $intrinsic:path, $in:ty => $out:ty;)*) => {$(
        #[inline(always)]
        fn $name(self, a: $in, b: $in) -> $out {
            unsafe { $intrinsic(a, b) }
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
        unsafe { (_mm256_movemask_pd(m.0) | _mm256_movemask_pd(m.1) << 4).cast_unsigned() as u8 }
    }
    #[inline(always)]
    fn any(self, m: Pair) -> bool {
        unsafe { _mm256_movemask_pd(_mm256_or_pd(m.0, m.1)) != 0 }
    }
    #[inline(always)]
    fn split_exponent(self, v: Pair) -> (Pair, Pair) {
        unsafe {
            let (low, high) = (split_four(v.0), split_four(v.1));
            ((low.0, high.0), (low.1, high.1))
        }
    }

    #[inline(always)]
    fn splat(self, x: f64) -> Pair {
        let four = unsafe { _mm256_set1_pd(x) };
        (four, four)
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> Pair {
        unsafe { (_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[4..].as_ptr())) }
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32; LANES]) -> Pair {
        unsafe {
            let (low, high) = (_mm_loadu_ps(x.as_ptr()), _mm_loadu_ps(x[4..].as_ptr()));
            (_mm256_cvtps_pd(low), _mm256_cvtps_pd(high))
        }
    }
    #[inline(always)]
    fn store(self, v: Pair, out: &mut Eight) {
        unsafe {
            _mm256_storeu_pd(out.as_mut_ptr(), v.0);
            _mm256_storeu_pd(out[4..].as_mut_ptr(), v.1);
        }
    }
    #[inline(always)]
    fn stream(self, v: Pair, out: &mut Eight) {
        if is_line(out) {
            // SAFETY: the halves of a line are aligned as they must be.
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
        unsafe { _mm_sfence() }
    }
    #[inline(always)]
    fn select(self, m: Pair, a: Pair, b: Pair) -> Pair {
        unsafe { (_mm256_blendv_pd(b.0, a.0, m.0), _mm256_blendv_pd(b.1, a.1, m.1)) }
    }
    #[inline(always)]
    fn broadcast_lanes(self, v: Pair) -> [Pair; LANES] {
        unsafe {
            let [a, b, c, d] = splat_four(v.0);
            let [e, f, g, h] = splat_four(v.1);
            [(a, a), (b, b), (c, c), (d, d), (e, e), (f, f), (g, g), (h, h)]
        }
    }
    #[inline(always)]
    fn transpose(self, rows: [Pair; LANES]) -> [Pair; LANES] {
        let [a, b, c, d, e, f, g, h] = rows;
        unsafe {
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
    unsafe fn gather(self, x: &[f64], indices: &[u32; LANES]) -> Pair {
        let (low, high) = halves(*indices);
        // SAFETY: the caller has checked the indices.
        unsafe {
            if !self.0 {
                return (load_four(x.as_ptr(), low), load_four(x.as_ptr(), high));
            }
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_i32gather_pd::<8>(x.as_ptr(), low), _mm256_i32gather_pd::<8>(x.as_ptr(), high))
        }
    }
    #[inline(always)]
    fn no_unroll(self) {
        // SAFETY: the assembly is empty.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn load_indices(self, indices: &[u32; LANES]) -> Self::I {
        unsafe {
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_cvtepu32_epi64(low), _mm256_cvtepu32_epi64(high))
        }
    }
    #[inline(always)]
    fn iota(self, base: u32) -> Self::I {
        unsafe {
            let base = _mm256_set1_epi64x(i64::from(base));
            let (low, high) = (_mm256_setr_epi64x(0, 1, 2, 3), _mm256_setr_epi64x(4, 5, 6, 7));
            (_mm256_add_epi64(base, low), _mm256_add_epi64(base, high))
        }
    }
    #[inline(always)]
    fn lt_index(self, a: Self::I, b: Self::I) -> Pair {
        unsafe {
            let (low, high) = (_mm256_cmpgt_epi64(b.0, a.0), _mm256_cmpgt_epi64(b.1, a.1));
            (_mm256_castsi256_pd(low), _mm256_castsi256_pd(high))
        }
    }
    #[inline(always)]
    fn select_index(self, m: Pair, a: Self::I, b: Self::I) -> Self::I {
        unsafe {
            let m = (_mm256_castpd_si256(m.0), _mm256_castpd_si256(m.1));
            (_mm256_blendv_epi8(b.0, a.0, m.0), _mm256_blendv_epi8(b.1, a.1, m.1))
        }
    }
    #[inline(always)]
    fn store_indices(self, i: Self::I, out: &mut [u32; LANES]) {
        unsafe {
            // The low halves of the lanes, in order.
            let even = _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6);
            let low = _mm256_permutevar8x32_epi32(i.0, even);
            let high = _mm256_permutevar8x32_epi32(i.1, even);
            let all = _mm256_blend_epi32::<0b1111_0000>(low, high);
            _mm256_storeu_si256(out.as_mut_ptr().cast(), all);
        }
    }
}

impl Simd for Avx512 {
    type V = __m512d;
    type M = __mmask8;
    type I = __m256i;

    single! {
        add: _mm512_add_pd, __m512d => __m512d;
        sub: _mm512_sub_pd, __m512d => __m512d;
        mul: _mm512_mul_pd, __m512d => __m512d;
        div: _mm512_div_pd, __m512d => __m512d;
        min: _mm512_min_pd, __m512d => __m512d;
        max: _mm512_max_pd, __m512d => __m512d;
        lt: _mm512_cmp_pd_mask::<_CMP_LT_OQ>, __m512d => __mmask8;
        eq: _mm512_cmp_pd_mask::<_CMP_EQ_OQ>, __m512d => __mmask8;
        lt_index: _mm256_cmplt_epu32_mask, __m256i => __mmask8;
    }

    #[inline(always)]
    fn and(self, a: __mmask8, b: __mmask8) -> __mmask8 {
        a & b
    }
    #[inline(always)]
    fn or(self, a: __mmask8, b: __mmask8) -> __mmask8 {
        a | b
    }
    #[inline(always)]
    fn bits(self, m: __mmask8) -> u8 {
        m
    }
    #[inline(always)]
    fn split_exponent(self, v: __m512d) -> (__m512d, __m512d) {
        unsafe {
            let mantissa = _mm512_getmant_pd::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(v);
            (_mm512_getexp_pd(v), mantissa)
        }
    }

    #[inline(always)]
    fn splat(self, x: f64) -> __m512d {
        unsafe { _mm512_set1_pd(x) }
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> __m512d {
        unsafe { _mm512_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32; LANES]) -> __m512d {
        unsafe { _mm512_cvtps_pd(_mm256_loadu_ps(x.as_ptr())) }
    }
    #[inline(always)]
    fn store(self, v: __m512d, out: &mut Eight) {
        unsafe { _mm512_storeu_pd(out.as_mut_ptr(), v) }
    }
    #[inline(always)]
    fn stream(self, v: __m512d, out: &mut Eight) {
        if is_line(out) {
            // SAFETY: a line is aligned as it must be.
            unsafe { _mm512_stream_pd(out.as_mut_ptr(), v) }
        } else {
            self.store(v, out);
        }
    }
    #[inline(always)]
    fn fence(self) {
        unsafe { _mm_sfence() }
    }
    #[inline(always)]
    fn select(self, m: __mmask8, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_mask_blend_pd(m, b, a) }
    }
    #[inline(always)]
    fn broadcast_lanes(self, v: __m512d) -> [__m512d; LANES] {
        let mut lanes = [v; LANES];
        for (l, lane) in (0..).zip(&mut lanes) {
            *lane = unsafe { _mm512_permutexvar_pd(_mm512_set1_epi64(l), v) };
        }
        lanes
    }
    #[inline(always)]
    fn transpose(self, rows: [__m512d; LANES]) -> [__m512d; LANES] {
        let [a, b, c, d, e, f, g, h] = rows;
        unsafe {
            // Pairs of rows: their even elements, and their odd ones.
            let even = transpose_quarters(
                _mm512_unpacklo_pd(a, b),
                _mm512_unpacklo_pd(c, d),
                _mm512_unpacklo_pd(e, f),
                _mm512_unpacklo_pd(g, h),
            );
            let odd = transpose_quarters(
                _mm512_unpackhi_pd(a, b),
                _mm512_unpackhi_pd(c, d),
                _mm512_unpackhi_pd(e, f),
                _mm512_unpackhi_pd(g, h),
            );
            [even[0], odd[0], even[1], odd[1], even[2], odd[2], even[3], odd[3]]
        }
    }
    #[inline(always)]
    unsafe fn gather(self, x: &[f64], indices: &[u32; LANES]) -> __m512d {
        // SAFETY: the caller has checked the indices.
        unsafe {
            if !self.0 {
                let (low, high) = halves(*indices);
                let (low, high) = (load_four(x.as_ptr(), low), load_four(x.as_ptr(), high));
                return _mm512_insertf64x4::<1>(_mm512_castpd256_pd512(low), high);
            }
            let indices = _mm256_loadu_si256(indices.as_ptr().cast());
            _mm512_i32gather_pd::<8>(indices, x.as_ptr())
        }
    }
    #[inline(always)]
    fn no_unroll(self) {
        // SAFETY: the assembly is empty.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn load_indices(self, indices: &[u32; LANES]) -> __m256i {
        unsafe { _mm256_loadu_si256(indices.as_ptr().cast()) }
    }
    #[inline(always)]
    fn iota(self, base: u32) -> __m256i {
        unsafe {
            let base = _mm256_set1_epi32(base.cast_signed());
            _mm256_add_epi32(base, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
        }
    }
    #[inline(always)]
    fn select_index(self, m: __mmask8, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_mask_blend_epi32(m, b, a) }
    }
    #[inline(always)]
    fn store_indices(self, i: __m256i, out: &mut [u32; LANES]) {
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), i) }
    }
    #[inline(always)]
    fn load_partial(self, x: &[f64]) -> __m512d {
        let mask = part(x.len());
        // SAFETY: lanes beyond the slice are not read.
        unsafe { _mm512_maskz_loadu_pd(mask, x.as_ptr()) }
    }
    #[inline(always)]
    fn store_partial(self, v: __m512d, out: &mut [f64]) {
        let mask = part(out.len());
        // SAFETY: lanes beyond the slice are not written.
        unsafe { _mm512_mask_storeu_pd(out.as_mut_ptr(), mask, v) }
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
    // 2^52 + e as a double has e in its last bits.
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

/// Transposes four rows of four quarters.
#[inline]
#[target_feature(enable = "avx512f")]
fn transpose_quarters(a: __m512d, b: __m512d, c: __m512d, d: __m512d) -> [__m512d; 4] {
    let first = (_mm512_shuffle_f64x2::<0x88>(a, b), _mm512_shuffle_f64x2::<0x88>(c, d));
    let second = (_mm512_shuffle_f64x2::<0xdd>(a, b), _mm512_shuffle_f64x2::<0xdd>(c, d));
    [
        _mm512_shuffle_f64x2::<0x88>(first.0, first.1),
        _mm512_shuffle_f64x2::<0x88>(second.0, second.1),
        _mm512_shuffle_f64x2::<0xdd>(first.0, first.1),
        _mm512_shuffle_f64x2::<0xdd>(second.0, second.1),
    ]
}

/// Mask of the first lanes.
#[inline(always)]
fn part(count: usize) -> __mmask8 {
    if count < LANES { (1 << count) - 1 } else { __mmask8::MAX }
}
