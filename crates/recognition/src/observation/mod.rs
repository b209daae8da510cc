//! Sensors of views: descriptors of images, their distances to references, and the odds of each.
//!
//! [`ReferenceDescriptors`] computes the distance to each reference, [`Standardizer`] the scores, and
//! [`MatchOdds`] the odds of each reference; [`view_change`] says whether the view has changed.

mod descriptors;
mod error;
mod neighbours;
mod odds;
mod rows;
mod standardizer;
mod view;

pub(crate) use descriptors::check_descriptor;
pub use descriptors::{Distance, ReferenceDescriptors};
pub use error::ViewError;
pub(crate) use neighbours::bound_by_neighbours;
pub use odds::MatchOdds;
pub(crate) use rows::{RowScratch, change, row_scores, within};
pub(crate) use standardizer::Spread;
pub use standardizer::Standardizer;
pub use view::{ViewComparison, view_change};
