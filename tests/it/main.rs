//! Tests of the public interface. Helpers for several topics are in `kit`.
//!
//! Properties run on 256 random cases each, or on the number in the environment variable
//! `WAYFIX_CASES`.

mod kit;

mod bad_input;
mod beam;
mod canberra;
mod cells;
mod controls;
mod descriptors;
mod edge_cases;
#[cfg(feature = "emission")]
mod emission;
mod enumeration;
mod evaluate;
mod evidence;
#[cfg(feature = "faer")]
mod faer;
mod fitted_turning;
mod information;
mod invariants;
mod large;
mod layers;
mod learning;
mod lockstep;
mod long_sequences;
mod many;
mod map;
mod map_files;
#[cfg(feature = "matching")]
mod matching;
mod model_choice;
mod motion;
mod network_cleaning;
mod no_control;
mod operators;
#[cfg(feature = "serde")]
mod persistence;
mod place_recognition;
mod pruned;
#[cfg(feature = "emission")]
mod published;
mod recognition;
mod reference_cases;
#[cfg(feature = "roads")]
mod road_import;
mod routines;
mod segments;
mod sensors;
mod shortest_path;
mod silent_states;
mod simulation;
mod single;
mod small;
mod snapshots;
mod stationary;
mod steps_in_logs;
mod streams;
mod trellis;
mod visited;
mod wide_range;
