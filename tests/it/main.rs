//! Tests of the public interface. Helpers for several topics are in `kit`.
//!
//! Properties run on 128 random cases each, or on the number in the environment variable
//! `WAYFIX_CASES`.

use wayfix_test_kit as kit;

mod bad_input;
mod beam;
mod canberra;
mod controls;
mod distracted;
mod edge_cases;
mod enumeration;
mod evaluate;
mod evidence;
#[cfg(feature = "faer")]
mod faer;
mod in_parallel;
mod invariants;
mod large;
mod layers;
mod learning;
mod lockstep;
mod long_sequences;
mod many;
mod map;
mod map_files;
mod no_control;
mod operators;
mod own_operators;
#[cfg(feature = "serde")]
mod persistence;
mod pruned;
mod reference_cases;
mod routines;
mod segments;
mod sensors;
mod shortest_path;
mod silent_states;
mod simulation;
mod small;
mod snapshots;
mod stationary;
mod steps_in_logs;
mod streams;
#[cfg(feature = "rayon")]
mod threads;
mod trellis;

mod wide_range;
