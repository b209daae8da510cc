//! Sensors that are made of others.

mod confusion;
mod groups;
mod pooled;
