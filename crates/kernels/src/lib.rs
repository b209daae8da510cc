//! The inner loops of [wayfix](https://docs.rs/wayfix): products of stochastic matrices with vectors,
//! and the steps of the recursions of hidden Markov models around them.
//!
//! **This crate makes no promise of stability.** Any release may change or remove any item, so
//! `wayfix` pins it by exact version, and documents its own interface. What follows is for readers
//! of the source.
//!
//! | module | content | uses |
//! |---|---|---|
//! | `limits` | the range of doubles, and proofs that no digit is lost unnoticed | |
//! | `simd` | eight doubles: AVX-512, AVX2, portable; parts for several threads | |
//! | `vector` | alignment and large pages; plain loops | `simd` |
//! | `semiring`, `log2` | sums of products and maxima of sums; logarithms of the latter | `simd` |
//! | `layout` | matrices in memory, and their products | all of these |
//! | `ops` | steps of the recursions | all of these |
//!
//! Sums run in eight lanes, in an order that does not depend on the instruction set: all give the
//! same bits. (Natural logarithms are those of the platform.)
//!
//! The range of numbers is derived in [`limits`], the recursions in the guide of `wayfix`,
//! `src/guide/formulas.md`. Comments in loops name the part of either that they rely on.
//!
//! Unsafe code is in `simd` (instructions), `layout/product.rs` (indices that are checked when a
//! matrix is built) and `vector.rs` (a system call). Each block states its invariant.

#![allow(
    missing_docs,
    missing_debug_implementations,
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    clippy::return_self_not_must_use,
    reason = "no promise is made to anyone but the crates of this workspace"
)]

mod layout;
pub mod limits;
mod log2;
mod ops;
mod semiring;
mod simd;
mod vector;

#[cfg(test)]
mod tests;

pub use layout::*;
pub use log2::{ln_to_log2, log2, log2_in_place, on_grid};
pub use ops::*;
pub use semiring::{MaxPlus, SumProduct};
pub use simd::{Eight, LANES, Simd, WithSimd, run};
pub use vector::{Aligned, Packed, in_large_pages};
pub use vector::{any_tiny, dot, lift, log_sum, normalize, sum};
