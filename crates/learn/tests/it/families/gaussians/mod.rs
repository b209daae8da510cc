//! Gaussian families and their relatives.

mod autoregressive;
mod gaussian;
mod kit;
mod mixture;
mod regression;
mod student_t;
