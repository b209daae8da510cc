//! AVX-512 F and VL: eight doubles in one register, and a mask of eight bits.

#[allow(clippy::wildcard_imports, reason = "intrinsics carry the names of instructions")]
use std::arch::{asm, x86_64::*};

use super::avx2::{is_line, load_four};
use super::{Eight, LANES, Simd};

/// Proof of AVX-512 F and VL, and AVX2. True if gathers are instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Avx512(pub(super) bool);

/// Methods that are one intrinsic.
macro_rules! single {
    ($($name:ident: $intrinsic:path, $in:ty => $out:ty;)*) => {$(
        #[inline(always)]
        fn $name(self, a: $in, b: $in) -> $out {
            // SAFETY: `self` proves AVX-512 F and VL, which have all intrinsics that the macro is
            // called with; the instruction touches no memory.
            unsafe { $intrinsic(a, b) }
        }
    )*};
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
        // SAFETY: `self` proves AVX-512 F; the instruction touches no memory.
        unsafe {
            let mantissa = _mm512_getmant_pd::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(v);
            (_mm512_getexp_pd(v), mantissa)
        }
    }

    #[inline(always)]
    fn power_of_two(self, n: __m512d) -> __m512d {
        // SAFETY: `self` proves AVX-512 F; the instructions touch no memory.
        unsafe {
            // The last bits are those of n: shifted to the exponent and added to the bits of 1,
            // they make 2^n.
            let exponent = _mm512_slli_epi64::<52>(_mm512_castpd_si512(n));
            let one = _mm512_castpd_si512(_mm512_set1_pd(1.0));
            _mm512_castsi512_pd(_mm512_add_epi64(exponent, one))
        }
    }
    #[inline(always)]
    fn splat(self, x: f64) -> __m512d {
        // SAFETY: `self` proves AVX-512 F; the instruction touches no memory.
        unsafe { _mm512_set1_pd(x) }
    }
    #[inline(always)]
    fn load(self, x: &Eight) -> __m512d {
        // SAFETY: `self` proves AVX-512 F. The load reads the eight doubles of the reference, at
        // any alignment.
        unsafe { _mm512_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: __m512d, out: &mut Eight) {
        // SAFETY: `self` proves AVX-512 F. The store writes the eight doubles of a unique
        // reference, at any alignment.
        unsafe { _mm512_storeu_pd(out.as_mut_ptr(), v) }
    }
    #[inline(always)]
    fn stream(self, v: __m512d, out: &mut Eight) {
        if is_line(out) {
            // SAFETY: `self` proves AVX-512 F, and the reference is to eight doubles. `is_line` has
            // found them on a cache line: aligned to 64 bytes, as this store needs. `fence`, which
            // follows the last, orders them before later stores.
            unsafe { _mm512_stream_pd(out.as_mut_ptr(), v) }
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
    fn select(self, m: __mmask8, a: __m512d, b: __m512d) -> __m512d {
        // SAFETY: `self` proves AVX-512 F; the instruction touches no memory.
        unsafe { _mm512_mask_blend_pd(m, b, a) }
    }
    #[inline(always)]
    fn broadcast_lanes(self, v: __m512d) -> [__m512d; LANES] {
        let mut lanes = [v; LANES];
        for (l, lane) in (0..).zip(&mut lanes) {
            // SAFETY: `self` proves AVX-512 F; the instruction touches no memory.
            *lane = unsafe { _mm512_permutexvar_pd(_mm512_set1_epi64(l), v) };
        }
        lanes
    }
    #[inline(always)]
    fn transpose(self, rows: [__m512d; LANES]) -> [__m512d; LANES] {
        let [a, b, c, d, e, f, g, h] = rows;
        // SAFETY: `self` proves AVX-512 F, which `transpose_quarters` requires; the instructions
        // touch no memory.
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
    fn gathers(self) -> bool {
        self.0
    }
    #[inline(always)]
    unsafe fn gather<const INSTRUCTION: bool>(self, x: &[f64], indices: &[u32; LANES]) -> __m512d {
        // SAFETY: `self` proves AVX-512 F and AVX2. The caller promises that all indices are below
        // the number of values of x, so that `load_four` and the gather read values of x, and that
        // this is below 2^31, so that the gather, which takes indices with a sign, sees none as
        // negative. The loads of indices read the eight of the reference, `load_four` four each.
        unsafe {
            if !INSTRUCTION {
                let (x, first) = (x.as_ptr(), indices.as_ptr());
                let (low, high) = (load_four(x, first), load_four(x, first.add(4)));
                return _mm512_insertf64x4::<1>(_mm512_castpd256_pd512(low), high);
            }
            let indices = _mm256_loadu_si256(indices.as_ptr().cast());
            _mm512_i32gather_pd::<8>(indices, x.as_ptr())
        }
    }
    #[inline(always)]
    fn no_unroll(self) {
        // SAFETY: the assembly is empty: it reads and writes nothing, as its options say.
        unsafe { asm!("", options(nomem, nostack, preserves_flags)) }
    }
    #[inline(always)]
    fn load_indices(self, indices: &[u32; LANES]) -> __m256i {
        // SAFETY: `self` proves AVX2. The load reads the eight indices of the reference, 32 bytes,
        // at any alignment.
        unsafe { _mm256_loadu_si256(indices.as_ptr().cast()) }
    }
    #[inline(always)]
    fn iota(self, base: u32) -> __m256i {
        // SAFETY: `self` proves AVX2; the instructions touch no memory.
        unsafe {
            let base = _mm256_set1_epi32(base.cast_signed());
            _mm256_add_epi32(base, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
        }
    }
    #[inline(always)]
    fn select_index(self, m: __mmask8, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: `self` proves AVX-512 VL; the instruction touches no memory.
        unsafe { _mm256_mask_blend_epi32(m, b, a) }
    }
    #[inline(always)]
    fn store_indices(self, i: __m256i, out: &mut [u32; LANES]) {
        // SAFETY: `self` proves AVX2. The store writes the eight indices of a unique reference, 32
        // bytes, at any alignment.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), i) }
    }
    #[inline(always)]
    fn load_partial(self, x: &[f64]) -> __m512d {
        let mask = part(x.len());
        // SAFETY: `self` proves AVX-512 F. The mask has a bit for each value of the slice, up to
        // eight; the other lanes are not read, and don't fault.
        unsafe { _mm512_maskz_loadu_pd(mask, x.as_ptr()) }
    }
    #[inline(always)]
    fn store_partial(self, v: __m512d, out: &mut [f64]) {
        let mask = part(out.len());
        // SAFETY: `self` proves AVX-512 F. The mask has a bit for each place of the slice, which is
        // unique, up to eight; the other lanes are not written, and don't fault.
        unsafe { _mm512_mask_storeu_pd(out.as_mut_ptr(), mask, v) }
    }
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
