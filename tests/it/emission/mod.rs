//! Families of observations.

mod counts_and_directions;
mod gaussians;
mod start;
mod start_parameters;
