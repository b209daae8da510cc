//! What is stored comes back to the bit, and what does not describe a model is refused.

mod motion;
mod names;
mod recognition;
