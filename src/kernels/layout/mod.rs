//! Layouts of matrices: sparse lines in slices of eight or groups, and dense columns or panels.

mod build;
mod dense;
mod entries;
mod panels;
mod sliced;
mod values;

pub(crate) use dense::Dense;
pub(crate) use panels::{Panels, store_indices};
#[cfg(test)]
pub(in crate::kernels) use sliced::Arrangement;
pub(crate) use sliced::Sliced;
pub(crate) use values::{EntryValues, Packed, Width};
