//! Streaming filter for very large maps: follows only the active states, and proves a bound on its
//! distance from the exact filter (section 13 of the [formulas](crate::guide::formulas)).
//!
//! The invariant is that of [`Envelope`]: lower and upper bounds on the exact belief, up to one
//! common factor.
//!
//! Underflow is handled differently than by [`limits`](wayfix_kernels::limits). There is one form only:
//! products are always lifted, by 2^900 instead of 2^1000, since upper bounds may be far above one.
//! A loss does not lead to a step in logarithms but is counted: every number that may have lost
//! digits, or has become 0, adds more than the loss to its bound. So no state needs a logarithm,
//! and if nothing is known of a belief, its bound says so. Entries beyond doubles, for which an
//! exact filter uses logarithms, are used as powers of two with a common one taken out.

pub(crate) mod active_set;
mod advance;
mod certificate;
mod envelope;
mod exact;
mod moves;
pub(crate) mod snapshot;
mod step;
mod weights;
mod wide;

use std::ops::Deref;

use crate::belief::Belief;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::likelihood::LocalLikelihood;
use crate::transition::TransitionEntries;
pub use certificate::{Certificate, Pruning};
pub use snapshot::PrunedFilterSnapshot;

use moves::Bounds;
use step::PrunedScratch;

/// Streaming filter for very large models, which follows only an active set of states. After every
/// step it proves a bound on the total variation between its belief and that of the exact
/// [`Filter`](crate::Filter).
///
/// A step costs O(entries into and out of the active states and the states that the sensor names),
/// regardless of n: about as much on a map of ten million places as on one of thirty thousand. It
/// allocates nothing unless the active set is larger than ever before. Memory: 4 n bytes and n bits
/// to know which states are active, and some 80 bytes for each active state, at their largest
/// number so far.
///
/// ```
/// use wayfix::inference::Pruning;
/// use wayfix::likelihood::SparseObservation;
/// use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition};
///
/// // A loop of a hundred thousand places: stay, or move on by one.
/// let n = 100_000;
/// let moves = (0..n).flat_map(|j| [(j, j, 0.5), ((j + 1) % n, j, 0.5)]);
/// let motion = SparseTransition::from_triplets(n, moves)?;
/// let prior = Prior::AtFirstObservation(Belief::certain(n, 7)?);
/// let hmm = Hmm::new(prior, motion, SparseLikelihood::new(n))?;
///
/// let mut filter = hmm.pruned_filter(Pruning { tolerance: 1e-6, ..Pruning::default() });
/// for place in [7, 8, 8, 90_000, 9] {
///     // A camera that is right nine times out of ten.
///     let seen = SparseObservation::new(vec![(place, 0.9)], 0.1 / n as f64)?;
///     let certificate = filter.step(&seen)?;
///     assert!(certificate.holds() && certificate.bound() <= 1e-6);
/// }
/// assert_eq!(filter.mode(), 9);
/// assert!(filter.active().len() < 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Pruning and the bound
///
/// States whose probability after a step is below a small part of the tolerance are dropped, and
/// counted: upper bounds on the mass that was dropped, or stems from dropped mass, are kept for
/// each active state and for all others together. The bound is their sum and includes rounding;
/// section 13 of the [formulas](crate::guide::formulas) proves it. As the bound approaches the
/// tolerance, less is dropped and more states are active.
///
/// The bound depends on the sensor's own bound for the states that it is not asked about
/// ([`LocalLikelihood`]). It falls while observations speak against those states, and recovers
/// after a period of doubt as soon as most of the belief is in one state. If it cannot be kept
/// within the tolerance, as under [`Pruning::most_active`] or when a vehicle turns up where no path
/// led, the [`Certificate`] of the step says so. That is not an error: the belief is still the best
/// estimate.
///
/// # Wide priors
///
/// At first all states that the prior allows are active. From a uniform prior the first steps
/// cost O(n), until the sensor has told some places from the others. As long as nothing has been
/// dropped and more than a fiftieth of all states are active, a step is that of an exact
/// [`Filter`](crate::Filter), at less than twice its cost after the first one; meanwhile nothing is
/// dropped. This requires a stored matrix ([`Transition::stored`](crate::Transition::stored)) that
/// is the same at all steps, and some 90 n additional bytes of memory. If more than a fifth of all
/// states become active after something was dropped, a step computes its sums by three or four
/// products with that matrix, and takes 40 n additional bytes.
///
/// Likelihoods are used as the sensor gives them, divided by a factor near the largest among the
/// states that the belief leads to. For likelihoods outside the range of `f64` after the division,
/// a bound is counted. Probabilities below 1e-290 of the whole are dropped, and counted too: a
/// sensor that contradicts the belief by more than that leaves nothing proven, and the bound says
/// so.
///
/// A filter dereferences to its state, a [`PrunedFilterSnapshot`]: `filter.certificate()`,
/// `filter.active()` and `filter.mode()` are methods of that.
#[derive(Debug, Clone)]
pub struct PrunedFilter<M> {
    model: M,
    /// Bounds on the operator, if it is the same at all steps.
    bounds: Option<Bounds>,
    state: PrunedFilterSnapshot,
    scratch: PrunedScratch,
}

impl<M> Deref for PrunedFilter<M> {
    type Target = PrunedFilterSnapshot;

    fn deref(&self) -> &PrunedFilterSnapshot {
        &self.state
    }
}

/// # Streams
impl<A: TransitionEntries, B: LocalLikelihood> Hmm<A, B> {
    /// Returns a streaming filter for very large models at the prior, which follows only an
    /// active set of states, proves a bound on its distance from the exact filter, and borrows the
    /// model. O(n + E), for one look at every entry.
    #[must_use]
    pub fn pruned_filter(&self, pruning: Pruning) -> PrunedFilter<&Self> {
        PrunedFilter::new(self, pruning)
    }
}

impl<M, A, B> PrunedFilter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: LocalLikelihood,
{
    /// Creates a filter at the prior, with any pointer to a model. O(n + E), for one look at every
    /// entry.
    #[must_use]
    pub fn new(model: M, pruning: Pruning) -> Self {
        let states = model.states();
        let scratch = PrunedScratch::new(states);
        let bounds = Bounds::constant(model.transition());
        let state = PrunedFilterSnapshot::start(states, pruning);
        let mut filter = Self { model, bounds, state, scratch };
        filter.restart();
        filter
    }

    /// Goes back to the prior, before the first step. O(n).
    pub fn restart(&mut self) {
        let Self { model, state, scratch, .. } = self;
        scratch.next.start(model.prior().belief().as_slice());
        let start = PrunedFilterSnapshot::start(state.states, state.pruning);
        scratch.replace(state, &start);
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost. The
    /// number of steps and the log-likelihood do not change; the bound is again that of an exact
    /// belief. O(n).
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if the belief has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), InferenceError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "belief", found, expected });
        }
        let Self { state, scratch, .. } = self;
        let mut log_excess = state.log_excess;
        // The interval of the likelihood stays: ln(1 + D), the deficit of the old belief, becomes
        // part of the accumulated excess, since the new belief has none.
        log_excess.add(state.belief.deficit().ln_1p());
        scratch.next.start(belief.as_slice());
        let PrunedFilterSnapshot { share, bound, belief, .. } =
            PrunedFilterSnapshot::start(expected, state.pruning);
        let log_excess = log_excess.known();
        let start = PrunedFilterSnapshot { belief, bound, log_excess, share, ..*state };
        scratch.replace(state, &start);
        Ok(())
    }

    /// Probability of one state: 0 if it is not active, `None` if it does not exist.
    #[must_use]
    pub fn probability(&self, state: usize) -> Option<f64> {
        let place = |state| self.scratch.active_set.place(state);
        let followed = || place(state).map_or(0.0, |at| self.state.belief.estimate[at]);
        (state < self.model.states()).then(followed)
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }
}
