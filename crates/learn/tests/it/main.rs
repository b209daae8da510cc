//! Tests of the public interface. What several topics need is in `kit`.
//!
//! Properties run on 128 random cases each, or as many as the environment variable
//! `WAYFIX_CASES` says.

use wayfix_test_kit as kit;

mod families;
mod information;
mod jackknife;
mod model_choice;
mod operators;
#[cfg(feature = "serde")]
mod persistence;
mod published;
