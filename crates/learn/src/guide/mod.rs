//! Guides: the names of depmixS4, momentuHMM and others of R.

#[doc = include_str!("from_depmixs4_and_momentuhmm.md")]
pub mod from_depmixs4_and_momentuhmm {}
