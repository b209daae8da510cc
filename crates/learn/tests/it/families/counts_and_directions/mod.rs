//! Families of counts, durations and directions.

mod densities;
mod digits;
mod extremes;
mod kit;
mod learning;
mod named;
mod samples;
mod zeros;
