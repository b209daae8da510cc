//! Sensors that are made of others, and those that list a few states.

mod confusion;
mod groups;
mod pooled;
mod sparse;
