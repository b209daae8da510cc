//! Layouts of matrices: sparse lines in slices of eight or groups, and dense columns or panels.

mod build;
mod dense;
mod entries;
mod panels;
mod sliced;
mod values;

pub use dense::Dense;
pub use panels::{Panels, store_indices};
#[cfg(test)]
pub(crate) use sliced::Arrangement;
pub use sliced::Sliced;
pub use values::{EntryValues, Packed};
