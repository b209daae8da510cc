//! Streaming filter for very large maps: it follows the active states, and proves a bound on its
//! distance from the exact filter (section 13 of the [formulas](crate::guide::formulas)).
//!
//! The invariant is that of [`Envelope`]: lower and upper bounds on the exact belief, up to one
//! factor. The numbers have a scheme of their own, beside the forms of `limits`. An estimate
//! with bounds has one form: it is always lifted, by 2^900 instead of 2^1000, since upper bounds
//! may be far above one. A loss is not noticed and taken again in logarithms, but counted:
//! each number that may have lost digits, or has become 0, adds more than that to its bound.
//! So no state needs a logarithm, and a belief that nothing is known of shows in its bound. Entries
//! beyond doubles, which a filter takes in logarithms, are taken as powers of two with a common one
//! taken out.

pub(crate) mod active_set;
mod advance;
mod certificate;
mod envelope;
mod moves;
mod snapshot;
mod step;
mod weights;
mod wide;

use std::mem;
use std::ops::{Deref, RangeInclusive};

use self::active_set::ActiveSet;
use crate::belief::Belief;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::likelihood::{LocalLikelihood, Scratch};
use crate::transition::TransitionEntries;
pub use certificate::{Certificate, Pruning};
pub use snapshot::PrunedFilterSnapshot;

pub(crate) use envelope::Envelope;
use moves::Bounds;
use step::LARGEST_SHARE;
use wide::Wide;

/// Streaming filter for very large models, which follows only an active set of states, and proves
/// after every step a bound on the total variation between its belief and that of the exact
/// [`Filter`](crate::Filter).
///
/// A step costs O(entries into and out of the active states, and those for which the sensor
/// speaks), whatever n is: on a map of ten million places about as much as on one of thirty
/// thousand. It allocates nothing, unless the active set is larger than ever before. Memory: 4 n
/// bytes and n bits to know which states are active, and some 80 bytes for each of these, as many
/// as there ever were.
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
/// States with less than a part of the tolerance after a step are dropped, and counted: upper
/// bounds on the mass that was dropped, or comes from dropped mass, are kept for each active
/// state, and for all others together. The bound is their sum, which also counts rounding;
/// section 13 of the [formulas](crate::guide::formulas) proves it. As the bound nears the
/// tolerance, less is dropped, and more states are active.
///
/// The bound depends on the sensor's bound for the states that it is not asked for
/// ([`LocalLikelihood`]): where observations speak against these, it falls, and recovers after a
/// time of doubt as soon as most of the belief is in one state. Where it cannot be held, as under
/// [`Pruning::most_active`], or when a vehicle turns up where no path had led, the
/// [`Certificate`] of the step says so. That is no error: the belief is still the best estimate.
///
/// # Wide priors
///
/// All states that the prior allows are active at first. From a uniform prior the first steps
/// cost O(n), until the sensor has told some places from the others. While more than a fifth of
/// all states are active, a step computes its sums by three or four products with the whole
/// matrix, if it is stored ([`Transition::stored`](crate::Transition::stored)) and the same at
/// all steps; that is faster than lists, and proves the same up to rounding. The filter has 40 n
/// bytes more of memory from then on.
///
/// Likelihoods are taken as the sensor gives them, divided by a factor near the largest of those
/// to which the belief leads; for one outside the range of `f64` beside them, a bound is counted.
/// Probabilities below 1e-290 of the whole are dropped, and counted too: a sensor that
/// contradicts the belief by more than that leaves nothing proven, and the bound says so.
#[derive(Debug, Clone)]
pub struct PrunedFilter<M> {
    model: M,
    pruning: Pruning,
    /// Bounds on an operator that is the same at all steps.
    bounds: Option<Bounds>,
    steps: usize,
    belief: Envelope,
    bound: f64,
    /// Lower bound on ln p(y_1 … y_k); the upper bound adds `log_excess` and the deficit.
    log: LogSum,
    log_excess: LogSum,
    /// True if nothing is known of the likelihood any more.
    log_lost: bool,
    /// Part of the tolerance that a step may drop.
    share: f64,
    next: Envelope,
    active_set: ActiveSet,
    wide: Wide,
    wanted: Vec<usize>,
    values: Vec<f64>,
    scratch: Scratch,
}

/// # Streams
impl<A: TransitionEntries, B: LocalLikelihood> Hmm<A, B> {
    /// Returns a streaming filter for very large models at the prior, which follows only an
    /// active set of states, proves its distance from the exact filter, and borrows the model.
    /// O(n + E), to look through the entries once.
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
    /// Creates a filter at the prior, with any pointer to a model. O(n + E), to look through the
    /// entries once.
    #[must_use]
    pub fn new(model: M, pruning: Pruning) -> Self {
        let mut filter = Self {
            pruning,
            bounds: Bounds::constant(model.transition()),
            steps: 0,
            belief: Envelope::default(),
            bound: 0.0,
            log: LogSum::default(),
            log_excess: LogSum::default(),
            log_lost: false,
            share: LARGEST_SHARE,
            next: Envelope::default(),
            active_set: ActiveSet::new(model.states()),
            wide: Wide::default(),
            wanted: Vec::new(),
            values: Vec::new(),
            scratch: Scratch::default(),
            model,
        };
        filter.restart();
        filter
    }

    /// Returns to the prior, with no steps taken. O(n).
    pub fn restart(&mut self) {
        let Self { model, belief, next, active_set, .. } = self;
        next.start(model.prior().belief().as_slice());
        // The places of the old states are cleared one by one, not all n.
        active_set.follow(&belief.states, &next.states);
        mem::swap(belief, next);
        (self.steps, self.share, self.bound) = (0, LARGEST_SHARE, 0.0);
        (self.log, self.log_excess) = (LogSum::default(), LogSum::default());
        self.log_lost = false;
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost.
    /// Steps and log-likelihood stay; the bound is that of an exact belief again. O(n).
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), InferenceError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "belief", found, expected });
        }
        // The likelihood so far keeps the uncertainty of the belief that is replaced.
        self.log_excess.add(self.belief.deficit().ln_1p());
        self.next.start(belief.as_slice());
        self.active_set.follow(&self.belief.states, &self.next.states);
        mem::swap(&mut self.belief, &mut self.next);
        (self.share, self.bound) = (LARGEST_SHARE, 0.0);
        Ok(())
    }

    /// Certificate of the present belief.
    #[must_use]
    pub fn certificate(&self) -> Certificate {
        Certificate::of(self.bound, self.pruning)
    }

    /// Active states, in ascending order.
    #[must_use]
    pub fn active(&self) -> &[usize] {
        &self.belief.states
    }

    /// Probabilities of the active states, in the same order; they sum to one.
    #[must_use]
    pub fn probabilities(&self) -> &[f64] {
        &self.belief.estimate
    }

    /// Most probable state; ties go to the lowest. O(active states).
    #[must_use]
    pub fn mode(&self) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (&state, &p) in self.belief.states.iter().zip(&self.belief.estimate) {
            // Only a greater one replaces, so that ties go to the lowest state.
            if p > best.1 {
                best = (state, p);
            }
        }
        best.0
    }

    /// Probability of one state, 0 if it is not active, or `None` if there is no such state.
    #[must_use]
    pub fn probability(&self, state: usize) -> Option<f64> {
        let followed = || self.active_set.place(state).map_or(0.0, |at| self.belief.estimate[at]);
        (state < self.model.states()).then(followed)
    }

    /// Interval that contains ln p(y_1 … y_k), up to rounding, over the observations so far.
    #[must_use]
    pub fn log_likelihood(&self) -> RangeInclusive<f64> {
        if self.log_lost {
            return f64::NEG_INFINITY..=f64::INFINITY;
        }
        // s absorbs one factor for all states; what is missing of Σ s α beside the lower bounds is
        // the deficit.
        let low = self.log.value();
        low..=low + self.log_excess.value() + self.belief.deficit().ln_1p()
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }
}
