//! wayfix
mod belief;
mod error;
mod hmm;
mod inference;
mod kernels;
mod likelihood;
mod random;
mod transition;

pub mod canberra;
pub mod evaluate;
pub mod map;
pub mod observation;

pub use belief::{Belief, BeliefView};
pub use error::{
    BeliefError, EvaluationError, HmmError, InferenceError, LikelihoodError, MapError,
    ObservationError, TableError, TransitionError, TurningError,
};
pub use hmm::{Hmm, Prior};
pub use inference::{Filter, FilterState, Posteriors, Simulation, Smoothing, ViterbiPath};
pub use likelihood::{
    Diagonal, FusedLikelihood, Likelihood, LikelihoodVector, LogLikelihoodFn, OptionalLikelihood,
    SampleObservation, Scratch, TableLikelihood,
};
pub use transition::{
    DenseTransition, SparseTransition, SwitchedTransition, Transition, TransitionEntries,
};
