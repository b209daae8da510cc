//! Transition operators: linear maps on distributions, with columns that sum
//! to one (paper eq. 6).
//!
//! [`Transition`] is a pair of products, `A x` and `A' x`: enough for filter and smoother.
//! [`TransitionEntries`] lists the entries into and out of a state, for decoding, sampling
//! and learning, and [`LearnTransition`] estimates the operator from [`MoveCounts`]. Operators of
//! your own find memory, checks and a test of all their methods in [`kit`].
//!
//! | for | take |
//! |---|---|
//! | few moves out of each state (a map) | [`SparseTransition`] |
//! | moves between most pairs of states | [`DenseTransition`] |
//! | the same moves from every place of a line or a loop | [`WindowTransition`] |
//! | a matrix for each value of a control | [`SwitchedTransition`] |
//! | moves that depend on inputs: the time of day, the weather, a dose | `LogitTransition` of wayfix-learn |
//! | measurements between two steps, by their likelihood for each move | [`EvidenceTransition`] |
//! | a vehicle that may turn up anywhere | [`RestartTransition`] |
//! | stays of any distribution (semi-Markov), given or learned | [`DwellTransition`] |
//! | a sensor that for a while follows something else | [`DistractedTransition`] |
//! | two chains side by side | [`KroneckerTransition`] |
//! | observations only every few steps | [`SparseTransition::power`] |
//! | observations at irregular times, with gaps | `GeneratorTransition` of wayfix-learn |
//! | moves that are known, share a parameter or have prior counts, in learning | [`ConstrainedTransition`] |
//!
//! Silent states, which emit nothing and take no step, are folded into the moves between emitting
//! ones before an operator is built: a [chapter](crate::guide::silent_states) shows how. A step
//! without an observation is something else: [`Filter::predict`](crate::Filter::predict), or
//! [`OptionalLikelihood`](crate::OptionalLikelihood).
//!
//! Motion of vehicles is in [`motion`](crate::motion), maps of roads are in [`map`](crate::map).
//! Wrappers take any operator, or require [`TransitionEntries`] where they need single entries.
//! Inference has faster loops for [`Stored`] matrices.

#[doc(hidden)]
#[allow(missing_docs, reason = "hidden: what the sibling crates share has no promise")]
pub mod buffers;
pub(crate) mod check;
mod compressed;
mod constrained;
mod dense;
mod displaced;
mod distracted;
mod dwell;
mod entries;
mod evidence;
mod jump;
pub mod kit;
mod kronecker;
mod learn;
#[doc(hidden)]
pub mod log;
mod maximize;
mod measured;
mod moves;
mod operator;
mod reorder;
mod restart;
mod shared;
mod sparse;
mod stationary;
mod switched;
mod validate;
mod weights;
mod window;

use check::check_columns;
pub(crate) use check::{check_count, check_probability, check_slices, check_sum};
#[doc(hidden)]
pub use compressed::Compressed;
pub use constrained::ConstrainedTransition;
pub use dense::DenseTransition;
pub use distracted::{DistractedTransition, Distraction, DistractionRates};
pub use dwell::{Durations, DwellTransition};
pub use entries::TransitionEntries;
pub(crate) use entries::{best_of, merge};
pub use evidence::EvidenceTransition;
pub(crate) use jump::{Jumps, product_or_zero, scale_belief};
pub use kronecker::KroneckerTransition;
pub use learn::{LearnFromMoves, LearnTransition};
pub(crate) use measured::{MoveLikelihood, WithMoveLikelihood};
pub use moves::{Move, MoveCounts};
pub(crate) use operator::constant_control;
pub use operator::{NoControl, Stored, Transition};
pub use restart::RestartTransition;
pub(crate) use shared::delegate;
pub use sparse::SparseTransition;
pub(crate) use stationary::{Stationary, stationary_control};
pub use switched::SwitchedTransition;
pub(crate) use validate::validate;
#[doc(hidden)]
pub use validate::{refuse_evidence, validate_with};
pub use window::WindowTransition;
