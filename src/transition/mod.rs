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
//! | moves that depend on inputs: the time of day, the weather, a dose | [`LogitTransition`] |
//! | measurements between two steps, by their likelihood for each move | [`EvidenceTransition`] |
//! | a vehicle that may turn up anywhere | [`RestartTransition`] |
//! | stays of any distribution (semi-Markov), given or learned | [`DwellTransition`] |
//! | two chains side by side | [`KroneckerTransition`] |
//! | observations only every few steps | [`PowerTransition`] |
//! | observations at irregular times, with gaps | [`GeneratorTransition`] |
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

pub mod buffers;
pub(crate) mod check;
mod compressed;
mod constrained;
mod dense;
mod displaced;
mod dwell;
mod entries;
mod evidence;
mod jump;
mod kronecker;
mod learn;
pub mod log;
mod maximize;
mod measured;
mod moves;
mod no_control;
mod operator;
mod power;
mod reorder;
mod restart;
mod shared;
mod sparse;
mod stationary;
mod stored;
mod switched;
mod validate;
mod weights;
mod window;

pub use buffers::with_scratch;
use check::check_columns;
pub use check::{check_count, check_probability, check_slices, check_sum};
pub use compressed::Compressed;
pub use constrained::ConstrainedTransition;
pub use dense::DenseTransition;
pub use dwell::{Durations, DwellTransition};
pub use entries::TransitionEntries;
pub use entries::best_of;
use entries::merge;
pub use evidence::EvidenceTransition;
pub(crate) use jump::{Jumps, scaled, times};
pub use kronecker::KroneckerTransition;
pub use learn::LearnTransition;
pub(crate) use measured::{Measured, MoveLikelihood};
pub use moves::{Move, MoveCounts};
pub use no_control::NoControl;
pub use operator::Transition;
pub use power::PowerTransition;
pub use restart::RestartTransition;
pub(crate) use shared::delegate;
pub use sparse::SparseTransition;
pub(crate) use stationary::{Stationary, the_control};
pub use stored::Stored;
pub use switched::SwitchedTransition;
pub(crate) use validate::validate;
pub use validate::{refuse_evidence, validate_with};
pub use window::WindowTransition;
