//! Operators against the dense matrices that define them, by [`assert_operator`].
//!
//! [`assert_operator`]: crate::kit::assert_operator

pub(crate) mod distance;
mod distracted;
mod durations;
mod dwell;
mod evidence;
mod faults;
mod kronecker;
mod nested;
mod off_map;
mod power;
mod restart;
mod weights;
mod window;
