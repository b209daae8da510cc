//! AVX2 and AVX-512.

use super::{Eight, LANES, Lanes};
#[allow(clippy::wildcard_imports, reason = "instructions name themselves")]
use std::arch::{asm, x86_64::*};

/// There is AVX2. Two registers of four doubles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx2(pub(super) ());

/// There are AVX-512 F and VL, and AVX2. One register of eight doubles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx512(pub(super) ());

type Two = (__m256d, __m256d);

/// Whether eight doubles are a line of a cache.
#[inline(always)]
fn is_line(eight: &Eight) -> bool {
    eight.as_ptr().addr().is_multiple_of(size_of::<Eight>())
}

// SAFETY, for all blocks below: `self` proves that the instructions are here;
// pointers come from references to arrays of the size that is read or
// written, or to slices, with masks of their length; indices of gathers are the caller's.

impl Lanes for Avx2 {
    type V = Two;
    type M = Two;
    /// As 64-bit lanes.
    type I = (__m256i, __m256i);

    #[inline(always)]
    fn splat(self, x: f64) -> Two {
        let four = unsafe { _mm256_set1_pd(x) };
        (four, four)
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> Two {
        unsafe { (_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[4..].as_ptr())) }
    }
    #[inline(always)]
    fn load_single(self, x: &[f32; LANES]) -> Two {
        unsafe {
            let (low, high) = (_mm_loadu_ps(x.as_ptr()), _mm_loadu_ps(x[4..].as_ptr()));
            (_mm256_cvtps_pd(low), _mm256_cvtps_pd(high))
        }
    }
    #[inline(always)]
    fn store(self, v: Two, out: &mut Eight) {
        unsafe {
            _mm256_storeu_pd(out.as_mut_ptr(), v.0);
            _mm256_storeu_pd(out[4..].as_mut_ptr(), v.1);
        }
    }
    #[inline(always)]
    fn stream(self, v: Two, out: &mut Eight) {
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
    fn add(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_add_pd(a.0, b.0), _mm256_add_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn sub(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_sub_pd(a.0, b.0), _mm256_sub_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn mul(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_mul_pd(a.0, b.0), _mm256_mul_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn div(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_div_pd(a.0, b.0), _mm256_div_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn min(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_min_pd(a.0, b.0), _mm256_min_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn max(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_max_pd(a.0, b.0), _mm256_max_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn less(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_cmp_pd::<_CMP_LT_OQ>(a.0, b.0), _mm256_cmp_pd::<_CMP_LT_OQ>(a.1, b.1)) }
    }
    #[inline(always)]
    fn equal(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_cmp_pd::<_CMP_EQ_OQ>(a.0, b.0), _mm256_cmp_pd::<_CMP_EQ_OQ>(a.1, b.1)) }
    }
    #[inline(always)]
    fn and(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_and_pd(a.0, b.0), _mm256_and_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn or(self, a: Two, b: Two) -> Two {
        unsafe { (_mm256_or_pd(a.0, b.0), _mm256_or_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn any(self, m: Two) -> bool {
        unsafe { _mm256_movemask_pd(_mm256_or_pd(m.0, m.1)) != 0 }
    }
    #[inline(always)]
    fn all(self, m: Two) -> bool {
        unsafe { _mm256_movemask_pd(_mm256_and_pd(m.0, m.1)) == 0b1111 }
    }
    #[inline(always)]
    fn select(self, m: Two, a: Two, b: Two) -> Two {
        unsafe { (_mm256_blendv_pd(b.0, a.0, m.0), _mm256_blendv_pd(b.1, a.1, m.1)) }
    }
    #[inline(always)]
    fn transpose(self, rows: [Two; LANES]) -> [Two; LANES] {
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
    unsafe fn gather(self, x: &[f64], indices: &[u32; LANES]) -> Two {
        // SAFETY: the caller's; indices are numbers with a sign.
        unsafe {
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_i32gather_pd::<8>(x.as_ptr(), low), _mm256_i32gather_pd::<8>(x.as_ptr(), high))
        }
    }
    #[inline(always)]
    fn turn(self) {
        // SAFETY: nothing, which nobody can tell.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn indices(self, indices: &[u32; LANES]) -> Self::I {
        unsafe {
            let low = _mm_loadu_si128(indices.as_ptr().cast());
            let high = _mm_loadu_si128(indices[4..].as_ptr().cast());
            (_mm256_cvtepu32_epi64(low), _mm256_cvtepu32_epi64(high))
        }
    }
    #[inline(always)]
    fn ramp(self, base: u32) -> Self::I {
        unsafe {
            let base = _mm256_set1_epi64x(i64::from(base));
            let (low, high) = (_mm256_setr_epi64x(0, 1, 2, 3), _mm256_setr_epi64x(4, 5, 6, 7));
            (_mm256_add_epi64(base, low), _mm256_add_epi64(base, high))
        }
    }
    #[inline(always)]
    fn index_less(self, a: Self::I, b: Self::I) -> Two {
        unsafe {
            let (low, high) = (_mm256_cmpgt_epi64(b.0, a.0), _mm256_cmpgt_epi64(b.1, a.1));
            (_mm256_castsi256_pd(low), _mm256_castsi256_pd(high))
        }
    }
    #[inline(always)]
    fn select_index(self, m: Two, a: Self::I, b: Self::I) -> Self::I {
        unsafe {
            let m = (_mm256_castpd_si256(m.0), _mm256_castpd_si256(m.1));
            (_mm256_blendv_epi8(b.0, a.0, m.0), _mm256_blendv_epi8(b.1, a.1, m.1))
        }
    }
    #[inline(always)]
    fn store_index(self, i: Self::I, out: &mut [u32; LANES]) {
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

impl Lanes for Avx512 {
    type V = __m512d;
    type M = __mmask8;
    type I = __m256i;

    #[inline(always)]
    fn splat(self, x: f64) -> __m512d {
        unsafe { _mm512_set1_pd(x) }
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> __m512d {
        unsafe { _mm512_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    fn load_single(self, x: &[f32; LANES]) -> __m512d {
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
    fn add(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_add_pd(a, b) }
    }
    #[inline(always)]
    fn sub(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_sub_pd(a, b) }
    }
    #[inline(always)]
    fn mul(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_mul_pd(a, b) }
    }
    #[inline(always)]
    fn div(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_div_pd(a, b) }
    }
    #[inline(always)]
    fn min(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_min_pd(a, b) }
    }
    #[inline(always)]
    fn max(self, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_max_pd(a, b) }
    }
    #[inline(always)]
    fn less(self, a: __m512d, b: __m512d) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn equal(self, a: __m512d, b: __m512d) -> __mmask8 {
        unsafe { _mm512_cmp_pd_mask::<_CMP_EQ_OQ>(a, b) }
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
    fn any(self, m: __mmask8) -> bool {
        m != 0
    }
    #[inline(always)]
    fn all(self, m: __mmask8) -> bool {
        m == __mmask8::MAX
    }
    #[inline(always)]
    fn select(self, m: __mmask8, a: __m512d, b: __m512d) -> __m512d {
        unsafe { _mm512_mask_blend_pd(m, b, a) }
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
        // SAFETY: the caller's; indices are numbers with a sign.
        unsafe {
            let indices = _mm256_loadu_si256(indices.as_ptr().cast());
            _mm512_i32gather_pd::<8>(indices, x.as_ptr())
        }
    }
    #[inline(always)]
    fn turn(self) {
        // SAFETY: nothing, which nobody can tell.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn indices(self, indices: &[u32; LANES]) -> __m256i {
        unsafe { _mm256_loadu_si256(indices.as_ptr().cast()) }
    }
    #[inline(always)]
    fn ramp(self, base: u32) -> __m256i {
        unsafe {
            let base = _mm256_set1_epi32(base.cast_signed());
            _mm256_add_epi32(base, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
        }
    }
    #[inline(always)]
    fn index_less(self, a: __m256i, b: __m256i) -> __mmask8 {
        unsafe { _mm256_cmplt_epu32_mask(a, b) }
    }
    #[inline(always)]
    fn select_index(self, m: __mmask8, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_mask_blend_epi32(m, b, a) }
    }
    #[inline(always)]
    fn store_index(self, i: __m256i, out: &mut [u32; LANES]) {
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), i) }
    }
    #[inline(always)]
    fn load_part(self, x: &[f64]) -> __m512d {
        let mask = part(x.len());
        // SAFETY: lanes beyond the slice are not read.
        unsafe { _mm512_maskz_loadu_pd(mask, x.as_ptr()) }
    }
    #[inline(always)]
    fn store_part(self, v: __m512d, out: &mut [f64]) {
        let mask = part(out.len());
        // SAFETY: lanes beyond the slice are not written.
        unsafe { _mm512_mask_storeu_pd(out.as_mut_ptr(), mask, v) }
    }
}

/// Four rows of four become columns.
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

/// Four rows of four quarters become columns.
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

/// A mask of the first lanes.
#[inline(always)]
fn part(count: usize) -> __mmask8 {
    if count < LANES { (1 << count) - 1 } else { __mmask8::MAX }
}
