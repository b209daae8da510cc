//! AVX2 and AVX-512.
//!
//! Methods call intrinsics that need instructions beyond those of every x86-64 processor. The
//! invariant that makes these calls sound: a value of [`Avx2`] or [`Avx512`] exists only after
//! `Isa::is_here` has detected the instructions, as only `run_unchecked` makes one, whose caller
//! has. "`self` proves AVX2" in the comments below means this.

mod avx2;
mod avx512;

pub(crate) use avx2::Avx2;
pub(crate) use avx512::Avx512;
