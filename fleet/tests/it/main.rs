//! Tests of files against the library.

mod bad_input;
mod equality;
mod files;
mod identity;
mod kit;
mod learn;
mod memory;
mod observations;
mod pool;
mod resume;
<<<<<<< HEAD
mod skip;
=======
mod service;
>>>>>>> a2d22ef (Fleet: live as a service: snapshots while it runs with the position of the input, an end in order, times that forget, order and step, models exchanged, figures)
