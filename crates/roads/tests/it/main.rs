//! Tests of the public interface. What several topics need is in `kit`.
//!
//! Properties run on 128 random cases each, or as many as the environment variable
//! `WAYFIX_CASES` says.

use wayfix_test_kit as kit;

mod cells;
mod fitted_turning;
mod matching;
mod network_cleaning;
mod road_import;
#[cfg(feature = "rayon")]
mod threads;
