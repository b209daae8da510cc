//! Algorithms of [`Hmm`](crate::Hmm), with their options and results: filters, smoothers,
//! decoders, simulation and learning.
//!
//! Nothing here knows what a state or an observation is: an algorithm asks a
//! [`Transition`](crate::Transition) for products and entries, and a
//! [`Likelihood`](crate::Likelihood) for one diagonal a step.
//!
//! | call | result | cost of a step |
//! |---|---|---|
//! | [`Hmm::filter`](crate::Hmm::filter) | [`Filter`], a stream; saved as a [`FilterSnapshot`] | a product |
//! | [`Hmm::fixed_lag`](crate::Hmm::fixed_lag) | [`FixedLag`], a stream; saved as a [`FixedLagSnapshot`] | a product, and O(L) products to smooth |
//! | [`Hmm::pruned_filter`](crate::Hmm::pruned_filter) | [`PrunedFilter`], a stream with a [`Certificate`], by [`Pruning`] | the entries of the active states |
//! | [`Hmm::online_viterbi`](crate::Hmm::online_viterbi) | [`OnlineViterbi`], a stream | a max-product |
//! | [`Distractor::new`] | [`Distractor`], a stream: what a distracted sensor follows | a product |
//! | [`Hmm::forward`](crate::Hmm::forward) | [`FilteredSequence`], with [`Posteriors`] | a product |
//! | [`Hmm::smooth`](crate::Hmm::smooth) | [`SmoothedSequence`], with [`Posteriors`] | two products |
//! | [`Hmm::smooth_each`](crate::Hmm::smooth_each) | [`SmoothedStep`]s, in an [`Order`], with moves | three products |
//! | [`Hmm::viterbi`](crate::Hmm::viterbi), [`Hmm::k_best`](crate::Hmm::k_best) | [`ViterbiPath`] | a max-product, or k |
//! | [`Hmm::beam_viterbi`](crate::Hmm::beam_viterbi) | [`BeamPath`] | the entries of the states in the beam |
//! | [`Trellis`]: a different set of states at each step | [`SmoothedTrellis`], [`ViterbiPath`] | the moves between the states of two steps |
//! | [`Hmm::path_sampler`](crate::Hmm::path_sampler) | [`PathSampler`] | a product |
//! | [`Hmm::smooth_all`](crate::Hmm::smooth_all) and the like | the results of many sequences, in a vector | that of one sequence, or less |
//! | [`Hmm::simulate`](crate::Hmm::simulate) | [`Simulation`] | the entries out of a state |
//! | [`Hmm::learn`](crate::Hmm::learn) | [`LearnedModel`], by [`LearningOptions`] | three products in each iteration |
//! | [`Hmm::learn_best`](crate::Hmm::learn_best), from several starts | [`LearnedModel`] | at most that, for each start |
//! | [`Hmm::expectations`](crate::Hmm::expectations), [`Hmm::maximize`](crate::Hmm::maximize): an iteration in parts | [`Expectations`] | three products |
//! | [`LearnedModel::criteria`]: to choose among models | [`Criteria`] | none |
//! | [`Hmm::fit`](crate::Hmm::fit) | a model, from [`LabelledSequence`]s | one count |
//!
//! [`formulas`](crate::guide::formulas) derives each algorithm;
//! [`performance`](crate::guide::performance) says what limits its speed.

mod decoding;
pub(crate) mod engines;
mod learning;
mod pruned;
mod sequences;
mod step;
pub(crate) mod streams;
mod trellis;

pub use self::learning::e_step::Expectations;
pub use self::learning::learned_model::Criteria;
pub use self::pruned::beam::BeamPath;
pub use self::sequences::forward_backward::FilteredSequence;
pub use self::sequences::forward_backward::Posteriors;
pub use self::sequences::forward_backward::SmoothedSequence;
pub use self::sequences::paths::PathSampler;
pub use crate::error::{LearnError, SequenceError};
pub use crate::free_parameters::{Displacement, FreeParameters};
pub use crate::hmm::ModelPointer;
pub use decoding::viterbi::ViterbiPath;
pub use learning::learned_model::{LearnedModel, LearningOptions};
pub use pruned::{Certificate, PrunedFilter, PrunedFilterSnapshot, Pruning};
pub use sequences::simulation::{LabelledSequence, Simulation};
pub use sequences::smooth_each::{Order, SmoothedStep};
pub use step::state::FilterSnapshot;
pub use streams::distractor::Distractor;
pub use streams::filter::Filter;
pub use streams::fixed_lag::{FixedLag, FixedLagSnapshot};
pub use streams::online_viterbi::{OnlineViterbi, OnlineViterbiSnapshot};
pub use trellis::{SmoothedTrellis, Trellis};

pub use sequences::left_out::left_out;
pub use step::state::LogSum;
pub use step::state::MOST_STEPS;

pub use trellis::{Scale, TrellisForward};
