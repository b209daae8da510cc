//! Likelihood operators: from an observation to a diagonal, `b_i` = p(y | state i).
//!
//! [`Likelihood`] is the trait, [`Diagonal`] the values that it returns, at any scale. Pruned
//! algorithms require [`LocalLikelihood`]; simulation requires [`SampleObservation`] or, if
//! observations depend on earlier ones, [`SampleNext`]; learning requires [`LearnLikelihood`].
//!
//! | for | use |
//! |---|---|
//! | symbols, such as the place that a classifier names | [`TableLikelihood`] |
//! | likelihoods, or their logarithms, computed elsewhere | [`LikelihoodVector`] |
//! | likelihoods of a few states among many | [`SparseLikelihood`], with [`SparseObservation`] |
//! | symbols that each speak for a few states among many, such as tags | [`SparseTableLikelihood`] |
//! | a function of observation and state | [`LogLikelihoodFn`] |
//! | a place that is known at some steps (a toll gate, a label) | [`OptionalLikelihood`] of a [`SparseLikelihood`], with [`SparseObservation::known`] |
//! | observations that may be missing | [`OptionalLikelihood`] |
//! | several sensors | [`FusedLikelihood`]; for families that are learned, in one row of numbers, `Product` of wayfix-learn |
//! | a sensor that sees only part of a state | [`GroupedLikelihood`], with [`Groups`] |
//! | several references for each state | [`PooledLikelihood`] |
//!
//! Sensors of vehicles are in [`observation`](crate::observation). [`kit`] tests sensors of your own.

mod diagonal;
mod function;
mod fused;
mod grouped;
pub mod kit;
mod learn;
mod local;
mod maximize;
mod next;
mod optional;
mod owned;
mod pooled;
mod shared;
mod sparse;
mod sparse_table;
pub(crate) mod table;
mod vector;

pub use self::diagonal::Scratch;
pub use crate::groups::Groups;
pub use diagonal::Diagonal;
pub(crate) use diagonal::Values;
pub use function::LogLikelihoodFn;
pub use fused::FusedLikelihood;
#[doc(hidden)]
pub use fused::product_of;
pub use grouped::GroupedLikelihood;
pub use learn::LearnLikelihood;
pub use local::LocalLikelihood;
pub(crate) use local::check_local;
#[doc(hidden)]
pub use maximize::shares;
pub use next::SampleNext;
pub use optional::OptionalLikelihood;
pub use pooled::PooledLikelihood;
pub use sparse::{SparseLikelihood, SparseObservation};
pub use sparse_table::SparseTableLikelihood;
pub use table::TableLikelihood;
pub use vector::LikelihoodVector;

use std::borrow::Borrow;

use rand::Rng;

use crate::error::LikelihoodError;

/// A likelihood operator B(y), which turns one observation into a diagonal with `b_i` = p(y |
/// `X_k` = i). (Paper eq. 7, which conditions on the previous state but means `X_k`.)
///
/// The diagonal may have any positive scale, as long as it is the same for all states: posteriors
/// do not depend on it. The log-likelihood is computed from the diagonal as it is, with the log
/// factor added back.
///
/// A reference, `Box`, `Rc` or `Arc` of a sensor is a sensor, too: models can share one, or choose
/// one at run time as `Box<dyn Likelihood<…>>`.
///
/// # Implement it yourself
///
/// A sensor that distinguishes odd places from even ones, correctly nine times out of ten
/// ([`kit`] has tests for it):
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
    /// Observation of one step.
    type Observation: ?Sized;

    /// Number of states, n.
    fn states(&self) -> usize;

    /// Returns the diagonal of B(y), n values.
    ///
    /// It may borrow from `self`, from the observation, or from `scratch`, which keeps its memory
    /// from step to step. The caller checks the values: an implementation need not look for NaN.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if the observation has no valid likelihood. A sensor's own errors go
    /// into [`LikelihoodError::Sensor`], by [`LikelihoodError::sensor`].
    fn diagonal<'a>(
        &'a self,
        observation: &'a Self::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError>;

    /// Returns a diagonal with one value per group of states, and the groups, if all states of a
    /// group have the same likelihood; by default `None`.
    ///
    /// It must agree with [`diagonal`](Self::diagonal), and saves writing one value per state.
    fn by_groups<'a>(
        &'a self,
        observation: &'a Self::Observation,
        scratch: &'a mut Scratch,
    ) -> Option<Result<(Diagonal<'a>, &'a Groups), LikelihoodError>> {
        let _ = (observation, scratch);
        None
    }

    /// True if likelihoods are stored, so that asking for them costs nothing: the smoother then
    /// asks a second time instead of computing a product with A. False by default.
    fn is_precomputed(&self) -> bool {
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
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
pub trait SampleObservation: Likelihood {
    /// An observation by value: `usize` for symbols, `Vec<f64>` for vectors.
    type Sample: Borrow<Self::Observation>;

    /// Draws an observation in `state`, which is below [`states`](Likelihood::states). A table
    /// panics for other states.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Self::Sample;
}
