//! Families of observations.

mod counts_and_directions;
mod gaussians;
mod product;
mod start;
