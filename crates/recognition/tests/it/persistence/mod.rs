//! What is stored comes back to the bit, and what is no model is refused.

mod motion;
mod names;
mod recognition;
