//! Transition operators: linear maps on distributions, with columns that sum
//! to one (paper eq. 6).
//!
//! [`Transition`] is a pair of products, `A x` and `A' x`: enough for filter and smoother.
//! [`TransitionEntries`] lists the entries into and out of a state, for decoding, sampling
//! and learning, and [`LearnTransition`] estimates the operator from [`MoveCounts`].
//!
//! | for | take |
//! |---|---|
//! | few moves out of each state (a map) | [`SparseTransition`] |
//! | moves between most pairs of states | [`DenseTransition`] |
//! | the same moves from every place of a line or a loop | [`WindowTransition`] |
//! | a matrix for each value of a control | [`SwitchedTransition`] |
//! | measurements between two steps, by their likelihood for each move | [`EvidenceTransition`] |
//! | a vehicle that may turn up anywhere | [`RestartTransition`] |
//! | stays of any distribution (semi-Markov) | [`DwellTransition`] |
//! | two chains side by side | [`KroneckerTransition`] |
//! | observations only every few steps | [`PowerTransition`] |
//! | moves that share a parameter, to be learned | [`TiedTransition`] |
//!
//! # Silent states
//!
//! A state that emits nothing and takes no step, as profile models have them, is composed into the
//! moves between emitting states. With P[from → to] from emitting (e) and silent (s) states, A
//! is the transpose of P_ee + P_es (I − P_ss)⁻¹ P_se, and the prior p_e + p_s (I − P_ss)⁻¹ P_se.
//! Learning then estimates the composed moves, and the visits to silent states are not decoded.
//!
//! ```
//! use wayfix::DenseTransition;
//!
//! // Two places (0, 1), and a silent ferry (2) that leads on to 1, or back to 0.
//! let p = [[0.5, 0.2, 0.3], [0.4, 0.6, 0.0], [0.25, 0.75, 0.0]]; // [from][to]
//! let mut moves = [[0.0; 2]; 2]; // [to][from]
//! for from in 0..2 {
//!     // Where it goes by silent states: their visits, step by step, until none is left.
//!     let mut on_ferry = p[from][2];
//!     moves.iter_mut().zip(p[from]).for_each(|(row, p)| row[from] += p);
//!     while on_ferry > 1e-18 {
//!         moves.iter_mut().zip(p[2]).for_each(|(row, p)| row[from] += on_ferry * p);
//!         on_ferry *= p[2][2];
//!     }
//! }
//! let a = DenseTransition::from_rows(&moves)?;
//! assert!((a.get(0, 0) - 0.575).abs() < 1e-15 && (a.get(1, 0) - 0.425).abs() < 1e-15);
//! # Ok::<(), wayfix::TransitionError>(())
//! ```
//!
//! A step without an observation is something else: [`Filter::predict`](crate::Filter::predict), or
//! [`OptionalLikelihood`](crate::OptionalLikelihood).
//!
//! Motion of vehicles is in [`motion`](crate::motion), maps of roads are in [`map`](crate::map).
//! Wrapping operators take any operator, or require [`TransitionEntries`] where they need single
//! entries. [`Stored`] matrices have faster loops.

pub(crate) mod buffers;
mod check;
mod compressed;
mod dense;
mod dwell;
mod entries;
mod evidence;
mod jump;
mod kronecker;
mod learn;
pub(crate) mod log;
mod maximize;
mod measured;
mod moves;
mod no_control;
mod operator;
mod power;
mod reorder;
mod restart;
mod shared;
mod single;
mod sparse;
mod stored;
mod switched;
mod tied;
mod validate;
mod weights;
mod window;

pub use buffers::with_scratch;
use check::check_columns;
pub(crate) use check::{check_count, check_probability, check_slices, check_sum};
#[cfg(feature = "places")]
pub(crate) use compressed::Compressed;
pub use dense::DenseTransition;
pub use dwell::DwellTransition;
pub use entries::TransitionEntries;
pub(crate) use entries::best_of;
use entries::merge;
pub use evidence::EvidenceTransition;
#[cfg(feature = "places")]
pub(crate) use jump::{Jumps, scaled, times};
pub use kronecker::KroneckerTransition;
pub use learn::LearnTransition;
#[cfg(feature = "places")]
pub(crate) use measured::{Measured, MoveLikelihood};
pub(crate) use moves::sort;
pub use moves::{Move, MoveCounts};
pub(crate) use no_control::NoControl;
pub use operator::Transition;
pub use power::PowerTransition;
pub use restart::RestartTransition;
pub(crate) use shared::delegate;
pub use sparse::SparseTransition;
pub use stored::Stored;
pub use switched::SwitchedTransition;
pub use tied::TiedTransition;
pub(crate) use validate::validate;
use validate::{refuse_evidence, validate_with};
pub use window::WindowTransition;
