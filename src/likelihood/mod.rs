//! Likelihood operators: from an observation to a diagonal, `b_i` = p(y | state i).
//!
//! [`Likelihood`] is the trait, [`Diagonal`] the values that it returns at any scale.
//! Pruned routines ask for [`LocalLikelihood`], simulation for [`SampleObservation`],
//! learning for [`LearnLikelihood`].
//!
//! | for | take |
//! |---|---|
//! | symbols, such as the place that a classifier names | [`TableLikelihood`] |
//! | likelihoods, or their logarithms, computed elsewhere | [`LikelihoodVector`] |
//! | likelihoods of a few states among many | [`SparseLikelihood`], with [`SparseObservation`] |
//! | a function of observation and state | [`LogLikelihoodFn`] |
//! | observations that may be missing | [`OptionalLikelihood`] |
//! | several sensors | [`FusedLikelihood`] |
//! | a sensor that sees only part of a state | [`GroupedLikelihood`], with [`Groups`] |
//! | several references for each state | [`PooledLikelihood`] |
//!
//! Sensors of vehicles are in [`observation`](crate::observation).

mod diagonal;
mod function;
mod fused;
mod grouped;
mod learn;
mod local;
mod optional;
mod owned;
mod pooled;
mod reestimate;
mod shared;
mod sparse;
mod table;
mod vector;

pub use crate::error::TableError;
pub use crate::groups::{GroupError, Groups};
pub(crate) use diagonal::Values;
pub use diagonal::{Diagonal, Scratch};
pub use function::LogLikelihoodFn;
pub use fused::FusedLikelihood;
pub use grouped::GroupedLikelihood;
pub use learn::LearnLikelihood;
pub use local::{LocalLikelihood, Unlisted};
pub use optional::OptionalLikelihood;
pub use pooled::PooledLikelihood;
pub use sparse::{SparseLikelihood, SparseObservation};
pub use table::TableLikelihood;
pub use vector::LikelihoodVector;

use rand::Rng;

use crate::error::LikelihoodError;

/// A likelihood operator B(y): turns one observation into a diagonal with
/// `b_i` = p(y | `X_k` = i) (paper eq. 7, which means `X_k`).
///
/// The diagonal may have any positive scale, as long as it is the same for all
/// states: posteriors do not depend on it, and the log-likelihood is that of
/// the diagonal as it is given, with the log factor added back.
///
/// A sensor behind a reference, `Box`, `Rc` or `Arc` is a sensor too: share one
/// among models, or choose one at run time as `Box<dyn Likelihood<…>>`.
///
/// # Implement it yourself
///
/// A sensor that tells odd places from even ones, nine times out of ten:
///
/// ```
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// struct Odd(usize);
///
/// impl Likelihood for Odd {
///     type Observation = bool;
///     fn states(&self) -> usize {
///         self.0
///     }
///     fn diagonal<'a>(&'a self, &odd: &bool, scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let b = scratch.values(self.0);
///         for (i, b) in b.iter_mut().enumerate() {
///             *b = if (i % 2 == 1) == odd { 0.9 } else { 0.1 };
///         }
///         Ok(Diagonal::linear(b))
///     }
/// }
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.5; 2]; 2])?, Odd(2))?;
/// # let mut filter = hmm.filter();
/// # filter.step(&true)?;
/// # assert!((filter.belief().as_slice()[1] - 0.9).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Likelihood {
    /// What is observed at a step.
    type Observation: ?Sized;

    /// The number of states, n.
    fn states(&self) -> usize;

    /// The diagonal of B(y), n values.
    ///
    /// It may point into `self`, into the observation, or into `scratch`,
    /// which keeps its memory from step to step. Whoever calls this checks
    /// what comes back: an implementation need not look for NaN.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] when there is no likelihood for this observation.
    /// A sensor's own errors go into [`LikelihoodError::Sensor`].
    fn diagonal<'a>(
        &'a self,
        observation: &'a Self::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError>;

    /// The diagonal with one value for each group of states, and the groups, if all states
    /// of a group have the same likelihood; `None`, as by default, if there are no groups.
    /// It must equal [`diagonal`](Self::diagonal), and saves writing a value for each state.
    fn by_groups<'a>(
        &'a self,
        observation: &'a Self::Observation,
        scratch: &'a mut Scratch,
    ) -> Option<Result<(Diagonal<'a>, &'a Groups), LikelihoodError>> {
        let _ = (observation, scratch);
        None
    }

    /// Whether likelihoods are at hand, so that to ask for them costs nothing: the
    /// smoother then does so a second time, in place of a product with A. False,
    /// unless an implementation says otherwise.
    fn is_at_hand(&self) -> bool {
        false
    }
}

/// A likelihood that can also draw observations, for simulation.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix::likelihood::SampleObservation;
/// use wayfix::TableLikelihood;
///
/// let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.0, 1.0]])?;
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// assert_eq!(table.sample(1, &mut rng), 1);
/// # Ok::<(), wayfix::likelihood::TableError>(())
/// ```
pub trait SampleObservation: Likelihood<Observation: Sized> {
    /// Draws what is observed in `state`, which is below
    /// [`states`](Likelihood::states); for others a table panics.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Self::Observation;
}
