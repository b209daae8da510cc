//! Families of observations.

mod counts_and_directions;
mod fits;
mod gaussians;
mod product;
#[cfg(feature = "csv")]
mod series;
mod start;
mod start_parameters;
