//! Clusters of observations, and families from them to begin learning with.
//!
//! Files, each of which stands on those before it: `k_means`, `observations`, `fit` (a family from
//! clusters) and `parts` (the parts of a mixture).

mod fit;
mod k_means;
mod observations;
mod parts;

pub use fit::StartFromClusters;
pub(super) use fit::{Outcome, ROUNDS};
pub use observations::Clusters;
