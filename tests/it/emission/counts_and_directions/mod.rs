//! Families of counts, durations and directions.

mod densities;
mod extremes;
mod kit;
mod learning;
mod named;
mod samples;
