//! Loops over vectors, for the instruction set of the machine.
//!
//! | folder | |
//! |---|---|
//! | `simd` | vectors of eight doubles: AVX-512, AVX2, portable |
//! | `layout` | matrices in memory |
//! | `ops` | steps of the recursions, over the semirings |
//! | `memory`, `parallel` | alignment and large pages; parts for several threads |
//!
//! Sums run in eight lanes, in an order that depends on no instruction set: results are the same
//! to the bit with each. (Natural logarithms are those of the platform.)
//!
//! Which numbers can come up, and why no digit of one is lost unnoticed, is proved in
//! [`limits`]; what loops compute is derived in the guide, `src/guide/formulas.md`.
//! Comments in loops name the part of either that they rely on.
//!
//! Unsafe code is in `simd` (instructions), `layout/entries` (indices that were checked before)
//! and `memory` (a system call). Each block says which invariant it relies on.

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
