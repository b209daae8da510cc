//! Sensors that are composed of others, and sensors that list a few states.

mod confusion;
mod groups;
mod pooled;
mod sparse;
