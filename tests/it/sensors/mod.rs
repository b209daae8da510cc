//! Sensors that are made of others.

mod groups;
mod pooled;
