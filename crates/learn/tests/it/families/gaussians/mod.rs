//! Gaussian families and their kin.

mod autoregressive;
mod gaussian;
mod kit;
mod mixture;
mod regression;
mod student_t;
