//! Gaussian families and their kin.

mod gaussian;
mod kit;
mod mixture;
mod student_t;
