//! wayfix
mod belief;
mod error;
mod hmm;
mod inference;
mod kernels;
mod likelihood;
mod random;
mod transition;

pub use belief::{Belief, BeliefView};
pub use error::{
    BeliefError, EvaluationError, HmmError, InferenceError, LikelihoodError, MapError,
    ObservationError, TableError, TransitionError, TurningError,
};
pub use hmm::{Hmm, Prior};
pub use inference::{Filter, FilterState, Posteriors, Simulation, Smoothed, ViterbiPath};
pub use likelihood::{
    Diagonal, FusedLikelihood, Likelihood, LikelihoodVector, LogLikelihoodFn, LogLikelihoodVector,
    OptionalLikelihood, SampleObservation, Scratch, TableLikelihood,
};
pub use transition::{
    DenseTransition, SparseTransition, SwitchedTransition, Transition, TransitionEntries,
};
