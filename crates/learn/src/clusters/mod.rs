//! Clusters of observations, and families fitted to them as starting points of learning.
//!
//! Files, each of which uses only those before it: `k_means`, `kinds` (what a start clusters by),
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
