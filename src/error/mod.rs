//! Errors of models and inference, of operators, sensors and learning, one enum per concern, and the payloads
//! that all errors share. Those of maps are defined in their module.
//!
//! A message says what was found, where, and what was expected, and ends with the message of its
//! cause. Since the text includes the cause, `source` returns the cause's own source, so that a
//! printed chain repeats nothing: a cause that may have a source is wrapped in [`At`] or
//! [`Failed`]. States and symbols are counted from 0, as in slices; steps from 1, as in
//! `y_1 … y_T`.

mod hmm;
mod learn;
mod likelihood;
mod payload;
mod transition;

pub use hmm::HmmError;
pub use learn::{LearnError, SequenceError};
pub use likelihood::LikelihoodError;
#[doc(hidden)]
pub use payload::Number;
pub use payload::{At, Disagreement, Failed, OutOfRange};
pub use transition::TransitionError;
