//! Filter, smoother, decoder, simulation: one algorithm a file. `step` holds
//! what they share: a prediction, a checked diagonal, a normaliser.

// Streams, batches, paths, learning, many: the order in which the docs of `Hmm`
// list them.
mod filter;
mod filter_state;

mod fixed_lag;
mod fixed_lag_state;

mod pruned;

mod online_viterbi;
mod online_viterbi_state;

mod filtering;

mod smoother;

mod checkpoints;
mod entropy;

mod viterbi;

mod k_best;

mod beam;

mod sampler;

mod simulate;

mod baum_welch;
mod labelled;
mod learnable;
mod lockstep;
mod many;

mod backward;
mod block;
mod by_blocks;
mod bytes;
mod evidence;
mod frontier;
mod held;
mod pairs;
mod posteriors;
mod scores;
mod small;
mod step;

pub use baum_welch::{Learned, Learning, StopReason};
pub use beam::BeamPath;
pub use checkpoints::{Order, SmoothedStep};
pub use filter::Filter;
pub use filter_state::FilterState;
pub(crate) use filter_state::MOST_STEPS;
pub use filtering::Filtering;
pub use fixed_lag::FixedLag;
pub use fixed_lag_state::FixedLagState;
pub use labelled::Labelled;
pub use learnable::{LearnLikelihood, LearnTransition};
pub use online_viterbi::OnlineViterbi;
#[cfg(feature = "serde")]
pub(crate) use online_viterbi_state::Node;
pub use online_viterbi_state::OnlineViterbiState;
pub use pairs::{Move, MoveCounts, Pairs};
pub use posteriors::Posteriors;
#[cfg(feature = "serde")]
pub(crate) use pruned::Envelope;
pub use pruned::{Certificate, PrunedFilter, PrunedFilterState, Pruning};
pub use sampler::PathSampler;
#[cfg(feature = "serde")]
pub(crate) use scores::TakenOut;
pub use simulate::Simulation;
pub use smoother::Smoothing;
pub use viterbi::ViterbiPath;

/// A sum of many logarithms that keeps what rounding would lose (Neumaier
/// 1974), so that a million steps do not drift.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LogSum {
    pub(crate) sum: f64,
    pub(crate) lost: f64,
}

impl LogSum {
    #[inline]
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// The same with nothing that is not looked at: a NaN is what was lost of infinity.
    fn known(self) -> Self {
        if self.sum.is_finite() { self } else { Self { sum: self.sum, lost: 0.0 } }
    }

    fn value(self) -> f64 {
        // Beyond the range of a double nothing was lost but the number itself.
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}
