//! AVX2 and AVX-512.
//!
//! Methods call intrinsics that need instructions beyond those of every x86-64 processor. The
//! invariant that makes these calls sound: a value of [`Avx2`] or [`Avx512`] exists only after
//! `Isa::is_here` has detected the instructions, as only `run_unchecked` makes one, whose caller
//! has. "`self` proves AVX2" in the comments below means this.

mod avx2;
mod avx512;

#[allow(clippy::wildcard_imports, reason = "intrinsics carry the names of instructions")]
use std::arch::x86_64::*;
use std::sync::OnceLock;

pub(crate) use avx2::Avx2;
pub(crate) use avx512::Avx512;

use super::{Eight, LANES};

/// True if gather instructions are faster than eight loads. On AMD's processors (Zen 1 to 5) they
/// are microcode: loads take 25% less time for a whole Viterbi step, 7 to 14% for a smoother.
pub(super) fn gathers() -> bool {
    static GATHERS: OnceLock<bool> = OnceLock::new();
    *GATHERS.get_or_init(|| {
        #[allow(unused_unsafe, reason = "safe in later versions of the standard library")]
        // SAFETY: all x86-64 processors have this instruction, and leaf 0 of it.
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
/// All indices must be within the allocation of `x`, and the processor must have AVX2.
#[inline(always)]
unsafe fn load_four(x: *const f64, [a, b, c, d]: [u32; 4]) -> __m256d {
    // SAFETY: the caller promises that indices are within the allocation of x, where all four loads
    // are of one double. It calls from a method of a proof of AVX2, which the insertion needs.
    unsafe {
        // Two pairs: a load into each half of a register, and the halves are put together. Four loads
        // and three instructions take less time than a gather in microcode.
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
