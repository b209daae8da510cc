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
//!
//! Values of a user's sensor are unchecked; those of this crate's tables come `Checked`, with their
//! maximum, so that a step does not look at them again. The diagonal of a sparse observation is
//! written over that of the previous step: all n states are written only if the value of the
//! unlisted ones changes.

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

pub use crate::groups::Groups;
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

use crate::error::{LikelihoodError, OutOfRange};
use wayfix_kernels as kernels;
use wayfix_kernels::{Valid, limits};

/// A likelihood operator B(y), which turns one observation into a diagonal with `b_i` = p(y |
/// `X_k` = i). (Paper eq. 7, which conditions on the previous state but means `X_k`.)
///
/// The diagonal may have any positive scale, as long as it is the same for all states: posteriors
/// do not depend on it. The log-likelihood is computed from the diagonal as it is, with the log
/// factor added back.
///
/// A reference, `Box`, `Rc` or `Arc` of a sensor is also a sensor: models can share one, or choose
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

/// Diagonal of B(y): one likelihood per state, as numbers or as logarithms, with an optional
/// common log factor.
///
/// The values are borrowed, so a table returns its column without copying.
#[derive(Debug, Clone, Copy)]
pub struct Diagonal<'a> {
    pub(crate) values: Values<'a>,
    pub(crate) log_factor: f64,
}

/// Values of a diagonal, in one of three forms.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Values<'a> {
    /// Likelihoods, unchecked.
    Linear(&'a [f64]),
    /// Natural logarithms of likelihoods, unchecked.
    Log(&'a [f64]),
    /// Valid likelihoods with their maximum and, if available, their base-2 logarithms.
    Checked { linear: &'a [f64], largest: f64, log2: Option<&'a [f64]> },
}

impl<'a> Diagonal<'a> {
    /// Creates a diagonal from likelihoods, each finite and at least 0.
    #[inline]
    #[must_use]
    pub fn linear(values: &'a [f64]) -> Self {
        Self::of(Values::Linear(values))
    }

    /// Creates a diagonal from natural logarithms of likelihoods, each at most 1e300 in
    /// magnitude, or −∞ (a likelihood of exactly 0).
    ///
    /// The whole range is usable: differences beyond the exponent range of a double are handled
    /// exactly.
    #[inline]
    #[must_use]
    pub fn log(values: &'a [f64]) -> Self {
        Self::of(Values::Log(values))
    }

    /// Adds ln c to the log factor, where c is a factor that was taken out of all values; it is
    /// added back in the log-likelihood.
    #[must_use]
    pub fn with_log_factor(self, log_factor: f64) -> Self {
        Self { log_factor: self.log_factor + log_factor, ..self }
    }

    /// Values, either as numbers or as logarithms.
    #[must_use]
    pub fn as_slice(&self) -> &'a [f64] {
        match self.values {
            Values::Linear(values) | Values::Log(values) => values,
            Values::Checked { linear, .. } => linear,
        }
    }

    /// True if the values are natural logarithms.
    #[must_use]
    pub fn is_log(&self) -> bool {
        matches!(self.values, Values::Log(_))
    }

    /// Logarithm of the factor that was taken out of all values.
    #[must_use]
    pub fn log_factor(&self) -> f64 {
        self.log_factor
    }

    /// True if a likelihood, given in the form of the values, is above 0.
    pub(crate) fn is_possible(&self, likelihood: f64) -> bool {
        likelihood > if self.is_log() { f64::NEG_INFINITY } else { 0.0 }
    }

    #[inline]
    pub(crate) fn of(values: Values<'a>) -> Self {
        Self { values, log_factor: 0.0 }
    }

    /// Creates a diagonal from values that are known to be valid and to have this maximum.
    #[inline]
    pub(crate) fn checked(linear: &'a [f64], largest: f64, log2: Option<&'a [f64]>) -> Self {
        Self::of(Values::Checked { linear, largest, log2 })
    }

    #[inline]
    pub(crate) fn len(&self) -> usize {
        self.as_slice().len()
    }

    /// Returns the likelihoods, or `None` if the values are logarithms.
    pub(crate) fn linear_values(&self) -> Option<&'a [f64]> {
        (!self.is_log()).then_some(self.as_slice())
    }

    /// Checks the length and the log factor.
    #[inline]
    pub(crate) fn check_shape(&self, states: usize) -> Result<(), LikelihoodError> {
        if self.len() != states {
            return Err(LikelihoodError::WrongLength { found: self.len(), expected: states });
        }
        check_log_factor(self.log_factor)
    }

    /// Checks length, values and log factor, and returns the largest value in the form of the
    /// diagonal (0 or −∞ if every state is ruled out).
    pub(crate) fn check(&self, states: usize) -> Result<f64, LikelihoodError> {
        self.check_shape(states)?;
        let (values, valid) = match self.values {
            Values::Linear(values) => (values, Valid::Likelihoods),
            Values::Log(values) => (values, Valid::Logs),
            // Whoever built it has checked the values.
            Values::Checked { largest, .. } => return Ok(largest),
        };
        kernels::largest(values, valid).map_err(|state| {
            let (kind, expected) = (valid.kind(), valid.expected());
            LikelihoodError::Value { state, kind, value: values[state], expected }
        })
    }

    /// Natural logarithms of the values, without the log factor.
    pub(crate) fn logs(&self) -> impl Iterator<Item = f64> + Clone + 'a {
        // ln 0 is −∞, as it should be; values were checked before.
        let (values, is_log) = (self.as_slice(), self.is_log());
        values.iter().map(move |&value| if is_log { value } else { value.ln() })
    }
}

/// Checks a log factor: sums of log factors over all steps must stay finite.
pub(super) fn check_log_factor(value: f64) -> Result<(), LikelihoodError> {
    if limits::is_log(value) {
        return Ok(());
    }
    Err(OutOfRange::new("the log factor", value, "a value from -1e300 to 1e300").into())
}

/// Reusable memory for the values of a diagonal, kept from step to step.
///
/// ```
/// let mut scratch = wayfix::Scratch::default();
/// let b = scratch.values(3);
/// assert_eq!(b.len(), 3);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    values: Vec<f64>,
    parts: Vec<Scratch>,
    sparse: SparseDiagonal,
    /// True if diagonals are for a decoder, which takes base-2 logarithms.
    with_log2: bool,
}

impl Scratch {
    /// Returns a slice of `count` values to fill. Their initial contents are left over from
    /// earlier steps. Allocates only when it grows.
    #[inline]
    pub fn values(&mut self, count: usize) -> &mut [f64] {
        self.values.resize(count, 0.0);
        &mut self.values
    }

    /// Returns `count` values to fill, and `parts` separate scratches for the parts of a composed
    /// likelihood.
    pub fn with_parts(&mut self, count: usize, parts: usize) -> (&mut [f64], &mut [Scratch]) {
        self.values.resize(count, 0.0);
        // Never shrinks: dropped parts would lose their memory.
        self.parts.resize_with(parts.max(self.parts.len()), Scratch::default);
        (&mut self.values, &mut self.parts[..parts])
    }

    /// Asks for base-2 logarithms with diagonals for which they cost nothing.
    pub(crate) fn ask_for_log2(&mut self) {
        self.with_log2 = true;
    }

    /// True if base-2 logarithms are asked for.
    pub(super) fn takes_log2(&self) -> bool {
        self.with_log2
    }

    /// Returns the diagonal with valid likelihoods for some states, which exist and differ, and one
    /// value for all others.
    pub(super) fn sparse(
        &mut self,
        states: usize,
        listed: &[(usize, f64)],
        elsewhere: f64,
    ) -> Diagonal<'_> {
        self.sparse.write(states, listed, elsewhere, self.with_log2)
    }

    /// Returns a diagonal of ones for this number of states.
    pub(super) fn ones(&mut self, states: usize) -> Diagonal<'_> {
        self.sparse.write(states, &[], 1.0, self.with_log2)
    }
}

/// Diagonal of the last sparse observation, and memory for the next one.
#[derive(Debug, Clone, Default)]
struct SparseDiagonal {
    linear: Vec<f64>,
    /// Base-2 logarithms, if they have been asked for; otherwise empty.
    log2: Vec<f64>,
    elsewhere: f64,
    /// States that were listed: all others have the value `elsewhere`.
    written: Vec<usize>,
}

impl SparseDiagonal {
    /// Writes a diagonal over the last one; likelihoods are valid, and states exist and differ.
    fn write(
        &mut self,
        states: usize,
        listed: &[(usize, f64)],
        elsewhere: f64,
        with_log2: bool,
    ) -> Diagonal<'_> {
        let Self { linear, log2, written, .. } = self;
        let (wanted, log2_elsewhere) =
            if with_log2 { (states, kernels::log2(elsewhere)) } else { (0, 0.0) };
        // Only states written last time differ from `elsewhere`, so resetting those is enough if
        // the value and the shape are the same. Bits are compared: −0 and 0 differ.
        let same = self.elsewhere.to_bits() == elsewhere.to_bits();
        if same && linear.len() == states && log2.len() == wanted {
            written.iter().for_each(|&state| linear[state] = elsewhere);
            if with_log2 {
                written.iter().for_each(|&state| log2[state] = log2_elsewhere);
            }
        } else {
            self.elsewhere = elsewhere;
            linear.clear();
            linear.resize(states, elsewhere);
            log2.clear();
            log2.resize(wanted, log2_elsewhere);
        }
        written.clear();
        written.extend(listed.iter().map(|entry| entry.0));
        listed.iter().for_each(|&(state, b)| linear[state] = b);
        if with_log2 {
            listed.iter().for_each(|&(state, b)| log2[state] = kernels::log2(b));
        }
        // `elsewhere` counts for the maximum only if some state has it.
        let others = if listed.len() < states { elsewhere } else { 0.0 };
        let largest = listed.iter().fold(others, |largest, entry| largest.max(entry.1));
        Diagonal::checked(linear, largest, with_log2.then_some(log2))
    }
}
