//! Loops over vectors, compiled for each instruction set and chosen by what the machine has.
//!
//! | folder | |
//! |---|---|
//! | `simd` | vectors of eight doubles: AVX-512, AVX2, portable |
//! | `layout` | matrices in memory |
//! | `ops` | steps of the recursions, over the semirings |
//! | `memory`, `parallel` | alignment and large pages; parts for several threads |
//!
//! Sums run in eight lanes, in an order that does not depend on the instruction set: all give the
//! same bits. (Natural logarithms are those of the platform.)
//!
//! [`limits`](crate::limits) proves which numbers can occur, and why no digit is lost unnoticed;
//! [`limits`]; what loops compute is derived in the guide, `src/guide/formulas.md`, derives the formulas. Comments in loops name the part of
//! either that they rely on.
//!
//! Unsafe code is in `simd` (instructions), `layout/entries` (indices that are checked when a
//! matrix is built) and `memory` (a system call). Each block states its invariant.

#![allow(
    missing_docs,
    missing_debug_implementations,
    reason = "no promise is made to anyone but the crates of this workspace"
)]

mod layout;
pub mod limits;
mod memory;
mod ops;
mod parallel;
mod simd;
mod vector;

#[cfg(test)]
mod tests;

pub use layout::*;
pub use memory::{Aligned, in_large_pages};
pub use ops::*;
pub use simd::{Eight, LANES};
pub use simd::{Simd, WithSimd, run};
pub use vector::{any_tiny, dot, lift, log_sum, normalize, sum};
