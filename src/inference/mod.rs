//! Algorithms of [`Hmm`](crate::Hmm), with their options and results: filters, smoothers,
//! decoders, simulation and learning.
//!
//! | call | result | cost of a step |
//! |---|---|---|
//! | [`Hmm::filter`](crate::Hmm::filter) | [`Filter`], a stream; saved as a [`FilterSnapshot`] | a product |
//! | [`Hmm::fixed_lag`](crate::Hmm::fixed_lag) | [`FixedLag`], a stream; saved as a [`FixedLagSnapshot`] | a product, and O(L) products to smooth |
//! | [`Hmm::pruned_filter`](crate::Hmm::pruned_filter) | [`PrunedFilter`], a stream with a [`Certificate`], by [`Pruning`] | the entries of the active states |
//! | [`Hmm::online_viterbi`](crate::Hmm::online_viterbi) | [`OnlineViterbi`], a stream | a max-product |
//! | [`Hmm::forward`](crate::Hmm::forward) | [`FilteredSequence`], with [`Posteriors`] | a product |
//! | [`Hmm::smooth`](crate::Hmm::smooth) | [`SmoothedSequence`], with [`Posteriors`] | two products |
//! | [`Hmm::smooth_each`](crate::Hmm::smooth_each) | [`SmoothedStep`]s, in an [`Order`], with [`Pairs`] | three products |
//! | [`Hmm::viterbi`](crate::Hmm::viterbi), [`Hmm::k_best`](crate::Hmm::k_best) | [`ViterbiPath`] | a max-product, or k |
//! | [`Hmm::beam_viterbi`](crate::Hmm::beam_viterbi) | [`BeamPath`] | the entries of the states in the beam |
//! | [`Trellis`]: states that differ from step to step | [`SmoothedTrellis`], [`ViterbiPath`] | the moves between the states of two steps |
//! | [`Hmm::path_sampler`](crate::Hmm::path_sampler) | [`PathSampler`] | a product |
//! | [`Hmm::smooth_map_all`](crate::Hmm::smooth_map_all) and the like | the results of many sequences, to a visitor | that of one sequence, or less |
//! | [`Hmm::smooth_all`](crate::Hmm::smooth_all) and the like | the results of many sequences, in a vector | the same |
//! | [`Hmm::simulate`](crate::Hmm::simulate) | [`Simulation`] | the entries out of a state |
//! | [`Hmm::learn`](crate::Hmm::learn) | [`LearnedModel`], by [`LearningOptions`] | three products in each iteration |
//! | [`Hmm::learn_best`](crate::Hmm::learn_best), from several starts | [`Restarts`] | as often |
//! | [`Hmm::expectations`](crate::Hmm::expectations), [`Hmm::reestimate`](crate::Hmm::reestimate): an iteration in parts | [`Expectations`] | three products |
//! | [`LearnedModel::criteria`], [`ModelSelection`]: to choose among models | [`Criteria`] | nothing; learning of all candidates and folds |
//! | [`Hmm::jackknife`](crate::Hmm::jackknife): standard errors of what was learned | [`StandardErrors`] | learning, for each group of sequences |
//! | [`Hmm::learn_labelled`](crate::Hmm::learn_labelled) | a model, from [`LabelledSequence`]s | one count |
//!
//! [`formulas`](crate::guide::formulas) derives each algorithm;
//! [`performance`](crate::guide::performance) says what limits its speed.

// One algorithm per file; `step` has their common parts: prediction, checked diagonal,
// normaliser.
mod filter;
mod filter_snapshot;

mod fixed_lag;
mod fixed_lag_snapshot;

mod pruned;

mod online_viterbi;
mod online_viterbi_snapshot;

mod filtering;

mod smoother;

mod checkpoints;
mod entropy;

mod viterbi;

mod k_best;

mod beam;

mod trellis;

mod sampler;

mod simulate;

mod batch;
mod baum_welch;
mod criteria;
mod expectations;
mod few;
pub(crate) mod in_parallel;
mod jackknife;
mod labelled;
mod many;
mod plan;
mod restarts;

mod active_set;
mod backward;
mod block;
mod by_blocks;
#[cfg(feature = "matching")]
pub(crate) mod bytes;
#[cfg(not(feature = "matching"))]
mod bytes;
mod evidence;
mod form;
mod pairs;
mod posteriors;
mod scores;
mod step;

pub use crate::error::{LearnError, SequenceError, SnapshotError};
pub use baum_welch::{LearnedModel, LearningOptions, StopReason};
pub use beam::BeamPath;
pub use checkpoints::{Order, SmoothedStep};
pub use criteria::{Candidate, Criteria, HeldOut, ModelSelection};
pub use expectations::Expectations;
pub use filter::Filter;
pub use filter_snapshot::FilterSnapshot;
pub(crate) use filter_snapshot::MOST_STEPS;
pub use filtering::FilteredSequence;
pub use fixed_lag::FixedLag;
pub use fixed_lag_snapshot::FixedLagSnapshot;
pub use jackknife::StandardErrors;
pub use labelled::LabelledSequence;
pub use online_viterbi::OnlineViterbi;
#[cfg(feature = "serde")]
pub(crate) use online_viterbi_snapshot::Node;
pub use online_viterbi_snapshot::OnlineViterbiSnapshot;
pub use pairs::Pairs;
pub use posteriors::Posteriors;
#[cfg(feature = "serde")]
pub(crate) use pruned::Envelope;
pub use pruned::{Certificate, PrunedFilter, PrunedFilterSnapshot, Pruning};
pub use restarts::Restarts;
pub use sampler::PathSampler;
#[cfg(feature = "serde")]
pub(crate) use scores::TakenOut;
pub use simulate::Simulation;
pub use smoother::SmoothedSequence;
pub use trellis::{SmoothedTrellis, Trellis, TrellisPairs};
pub use viterbi::ViterbiPath;

/// Compensated sum of many logarithms (Neumaier 1974), so that a million steps do not drift.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LogSum {
    pub(crate) sum: f64,
    pub(crate) lost: f64,
}

impl LogSum {
    #[inline]
    pub(crate) fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// Clears the compensation of an infinite sum, which is NaN and unused.
    fn known(self) -> Self {
        if self.sum.is_finite() { self } else { Self { sum: self.sum, lost: 0.0 } }
    }

    /// True if sum and compensation together are finite; both may be damaged.
    fn is_finite(self) -> bool {
        self.sum.is_finite() && (self.sum + self.lost).is_finite()
    }

    pub(crate) fn value(self) -> f64 {
        // An infinite sum has no meaningful compensation.
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}
