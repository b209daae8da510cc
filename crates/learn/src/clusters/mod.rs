//! Clusters of observations, and families from them to begin learning with.
//!
//! Files, each of which stands on those before it: `k_means`, `kinds` (of clusters to begin with),
//! `observations`, `fit` (a family from clusters) and `parts` (the parts of a mixture).

mod fit;
mod k_means;
mod kinds;
mod observations;
mod parts;

pub use fit::StartFromClusters;
pub(super) use fit::{Outcome, ROUNDS};
pub use kinds::StartKind;
pub use observations::Clusters;
