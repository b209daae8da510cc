//! Errors of models, observations, learning and snapshots, one enum per concern, and the payloads
//! that all errors share. Errors of maps and of sensors are defined in their own modules.
//!
//! A message says what was found, where, and what was expected, and ends with the message of its
//! cause. Since the text includes the cause, `source` returns the cause's own source, so that a
//! printed chain repeats nothing: a cause that may have a source is wrapped in [`At`] or
//! [`Failed`]. States and symbols are counted from 0, as in slices; steps from 1, as in
//! `y_1 … y_T`.

mod belief;
mod hmm;
mod inference;
mod learn;
mod likelihood;
mod payload;
mod snapshot;
mod table;
mod transition;

pub use belief::BeliefError;
pub use hmm::HmmError;
pub use inference::InferenceError;
pub use learn::{LearnError, SequenceError};
pub use likelihood::LikelihoodError;
#[doc(hidden)]
pub use payload::Number;
pub use payload::{At, Count, Disagreement, Failed, Parameter};
pub use snapshot::SnapshotError;
pub use table::TableError;
pub use transition::TransitionError;
