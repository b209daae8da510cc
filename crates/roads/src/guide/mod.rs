//! Guides: from GPS points to a route.

#[cfg(feature = "csv")]
#[doc = include_str!("from_gps.md")]
pub mod from_gps {}
