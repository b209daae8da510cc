//! Guides: from image descriptors to a position.

#[doc = include_str!("from_descriptors.md")]
pub mod from_descriptors {}
