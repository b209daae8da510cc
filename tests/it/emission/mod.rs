//! Families of observations.

mod gaussians;
