//! Guides: from image descriptors to a position, and the formulas.

#[doc = include_str!("formulas.md")]
pub mod formulas {}
#[doc = include_str!("from_descriptors.md")]
pub mod from_descriptors {}
