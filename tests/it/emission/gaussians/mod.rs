//! Gaussian families and their kin.

mod gaussian;
mod kit;
mod mixture;
mod regression;
mod student_t;
