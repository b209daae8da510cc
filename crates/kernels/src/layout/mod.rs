//! Matrices in memory and their products: sparse lines in slices of eight or groups, dense columns,
//! and panels of logarithms.

mod dense;
mod panels;
mod product;
mod sliced;

pub use dense::Dense;
pub use panels::Panels;
pub use product::{Maxima, Product, RowSums, Sink};
pub(crate) use product::{ProductRows, SparseRows};
#[cfg(test)]
pub(crate) use sliced::Arrangement;
pub use sliced::{EntryValues, Sliced};
