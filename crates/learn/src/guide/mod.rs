//! Guides: the names of hmmlearn, and of depmixS4, momentuHMM and others of R; labels in rows; stored models.

#[doc = include_str!("from_depmixs4_and_momentuhmm.md")]
pub mod from_depmixs4_and_momentuhmm {}

#[doc = include_str!("from_hmmlearn.md")]
pub mod from_hmmlearn {}

#[doc = include_str!("labels.md")]
pub mod labels {}

#[doc = include_str!("storing.md")]
pub mod storing {}
