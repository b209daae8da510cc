//! Turning probabilities of a map: by a rule, from frequencies, or learned.

mod fit;
mod probabilities;
mod rule;

pub use probabilities::{FittedTurn, TurningProbabilities};
pub use rule::{ByClass, TurningRule};
