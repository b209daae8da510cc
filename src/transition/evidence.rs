//! [`EvidenceTransition`]: a likelihood of moves on any operator, given by a function. Products and
//! entries are those of [`WithMoveLikelihood`]; here are the function, its checks, and learning.

use std::error::Error;
use std::fmt;
use std::marker::PhantomData;

use super::measured::{MoveLikelihood, WithMoveLikelihood};
use super::{LearnTransition, delegate};
use super::{Transition, TransitionEntries, validate_with};
use crate::error::TransitionError;
use crate::free_parameters::{Displacement, FreeParameters};
use wayfix_kernels::limits::LARGEST_LOG;

/// An operator with evidence on moves: each control is a measurement u between two steps, whose
/// likelihood p(u | `X_{k-1}`, `X_k`) multiplies the entries of A.
///
/// For odometry, a compass, "the view has changed", or the distance between two GPS points against
/// the length of the road between two candidates. The columns then do not sum to one: evidence
/// **against** all ways out of a state counts, too, and would be lost if columns were normalised
/// (label bias). See [`Transition::evidence`].
///
/// `F` returns ln p(u | from, to), −∞ for an impossible measurement. It is called for the moves of
/// A only. Products cost O(E) evaluations and exponentials, and each step costs two more rounds of
/// evaluations to check them. The guide shows odometry of
/// [a robot on a grid](crate::guide::lost_robot). Learning re-estimates A from the expected moves,
/// and keeps the likelihood.
///
/// ```
/// use wayfix::transition::EvidenceTransition;
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, SparseTransition};
///
/// // Two loops of three places, of 100 m and of 200 m a move, without stays.
/// let length = |from: usize| if from < 3 { 100.0 } else { 200.0 };
/// let moves = (0..6).map(|j| (j / 3 * 3 + (j + 1) % 3, j, 1.0));
/// let loops = SparseTransition::from_triplets(6, moves)?;
/// // An odometer with an error of 20 m; `None` without a reading.
/// let driven = EvidenceTransition::new(loops, move |metres: &Option<f64>, _to, from| {
///     metres.map_or(0.0, |metres| -0.5 * ((metres - length(from)) / 20.0).powi(2))
/// })?;
///
/// let prior = Prior::BeforeFirstTransition(Belief::uniform(6)?);
/// let hmm = Hmm::new(prior, driven, LikelihoodVector::linear(6))?;
/// let mut filter = hmm.filter();
/// filter.step_with(&Some(180.0), &[0.5; 6])?;
/// assert!(filter.belief().mass(3..6)? > 0.999); // it is on the longer loop
/// filter.step_with(&None, &[0.5; 6])?;
/// assert!(filter.belief().mass(3..6)? > 0.999);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct EvidenceTransition<A, U, F, G = fn(&U) -> f64>(
    WithMoveLikelihood<A, ByFunction<U, F, G>>,
);

impl<A, U, F> EvidenceTransition<A, U, F>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
{
    /// Creates an operator with the moves of `base`, and ln p(u | from, to) as
    /// `log_likelihood(u, to, from)`.
    ///
    /// # Errors
    ///
    /// As [`Hmm::new`](crate::Hmm::new) for an operator that is not stochastic,
    /// [`TransitionError::Control`] for one that has evidence already, or
    /// [`TransitionError::Restarts`] for one with [restarts](super::RestartTransition), which belong
    /// outside.
    pub fn new(base: A, log_likelihood: F) -> Result<Self, TransitionError> {
        validate_with(&base, &())?;
        if base.has_restarts() {
            return Err(TransitionError::Restarts);
        }
        super::refuse_evidence(&base, &(), "EvidenceTransition")?;
        let log_factor: fn(&U) -> f64 = |_| 0.0;
        let likelihood = ByFunction { log_likelihood, log_factor, control: PhantomData };
        Ok(Self(WithMoveLikelihood { base, likelihood }))
    }
}

impl<A, U, F, G> EvidenceTransition<A, U, F, G> {
    /// Sets a log factor to take out of all likelihoods of a step, such as the log of their largest
    /// possible value; 0 by default. It changes no result, but where likelihoods are far from 1 it
    /// avoids steps in logarithms, which are slower.
    #[must_use]
    pub fn with_log_factor<H: Fn(&U) -> f64>(
        self,
        log_factor: H,
    ) -> EvidenceTransition<A, U, F, H> {
        let WithMoveLikelihood { base, likelihood: ByFunction { log_likelihood, control, .. } } =
            self.0;
        let likelihood = ByFunction { log_likelihood, log_factor, control };
        EvidenceTransition(WithMoveLikelihood { base, likelihood })
    }

    /// The operator without evidence.
    #[must_use]
    pub fn base(&self) -> &A {
        &self.0.base
    }
}

/// Functions of a measurement: ln p(u | from, to), and the log factor to take out.
struct ByFunction<U, F, G> {
    log_likelihood: F,
    log_factor: G,
    control: PhantomData<fn(&U)>,
}

impl<A, U, F, G> MoveLikelihood<A> for ByFunction<U, F, G>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
    G: Fn(&U) -> f64,
{
    type Measurement = U;
    type Move = ();

    fn log_factor(&self, measured: &U) -> Option<f64> {
        Some((self.log_factor)(measured))
    }

    fn move_log_likelihood(
        &self,
        _: &A,
        measured: &U,
    ) -> Option<impl Fn(usize, usize, Option<()>) -> f64> {
        let log_factor = (self.log_factor)(measured);
        Some(move |to, from, _| (self.log_likelihood)(measured, to, from) - log_factor)
    }

    fn column(&self, base: &A, from: usize) -> impl Iterator<Item = (usize, f64, ())> {
        base.outgoing(&(), from).map(|(to, p)| (to, p, ()))
    }

    fn column_log2(&self, base: &A, from: usize) -> impl Iterator<Item = (usize, f64, ())> {
        base.outgoing_log2(&(), from).map(|(to, log2)| (to, log2, ()))
    }

    fn check(&self, base: &A, measured: &U) -> Result<(), TransitionError> {
        // Every move is checked before the step: the user's function may fail for any of them, and
        // the filter must then still be in its last good state.
        for from in 0..base.states() {
            for (to, _) in base.outgoing(&(), from) {
                let log = (self.log_likelihood)(measured, to, from);
                if log.is_nan() || log > LARGEST_LOG {
                    let text = format!(
                        "a log-likelihood of {log} for the move from state {from} to state {to}, expected a value up to 1e300 or negative infinity"
                    );
                    return Err(TransitionError::Control(text));
                }
            }
        }
        Ok(())
    }
}

impl<A, U, F, G> Transition for EvidenceTransition<A, U, F, G>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
    G: Fn(&U) -> f64,
{
    type Control = U;

    delegate!(a, measured => a.0, measured; states products evidence needs_logs check_control);
}

impl<A, U, F, G> TransitionEntries for EvidenceTransition<A, U, F, G>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
    G: Fn(&U) -> f64,
{
    delegate!(a, measured => a.0, measured; all_entries);
}

/// Re-estimates the base and keeps the likelihood.
impl<A, U, F, G> LearnTransition for EvidenceTransition<A, U, F, G>
where
    A: LearnTransition<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64 + Clone,
    G: Fn(&U) -> f64 + Clone,
{
    type Statistics = A::Statistics;

    delegate!(a, _measured => a.0.base, &(); statistics parameters);

    fn maximize(
        &self,
        statistics: &A::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let base = self.0.base.maximize(statistics, pseudo_count)?;
        Ok(Self(WithMoveLikelihood { base, likelihood: self.0.likelihood.clone() }))
    }
}

/// Free parameters of the base; the likelihood has none.
impl<A: FreeParameters, U, F: Clone, G: Clone> FreeParameters for EvidenceTransition<A, U, F, G> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let base = self.0.base.displaced(by)?;
        Ok(Self(WithMoveLikelihood { base, likelihood: self.0.likelihood.clone() }))
    }
}

impl<U, F: Clone, G: Clone> Clone for ByFunction<U, F, G> {
    fn clone(&self) -> Self {
        let (log_likelihood, log_factor) = (self.log_likelihood.clone(), self.log_factor.clone());
        Self { log_likelihood, log_factor, control: PhantomData }
    }
}

impl<A: Clone, U, F: Clone, G: Clone> Clone for EvidenceTransition<A, U, F, G> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<A: fmt::Debug, U, F, G> fmt::Debug for EvidenceTransition<A, U, F, G> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EvidenceTransition").field("base", self.base()).finish_non_exhaustive()
    }
}
