//! Layouts of matrices: sparse lines in slices of eight or one by one, and dense columns.

mod dense;
mod entries;
mod sliced;
mod values;

pub(crate) use dense::{Dense, store_indices};
#[cfg(test)]
pub(in crate::kernels) use dense::{DenseMaximize, DenseMultiply, DenseTranspose};
pub(crate) use sliced::{EntryValues, Sliced};
pub(crate) use values::{Packed, Width};
