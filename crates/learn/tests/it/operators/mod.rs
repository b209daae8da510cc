//! Operators against the dense matrices that define them.

mod generator;
mod logit;
