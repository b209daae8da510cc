//! A likelihood of moves on any operator.

use std::f64::consts::LOG2_E;
use std::fmt;
use std::marker::PhantomData;

use super::jump::LARGEST;
use super::{LearnTransition, MoveCounts};
use super::{Transition, TransitionEntries, check_slices, log, validate_with};
use crate::error::TransitionError;
use crate::kernels::{self, log2};
use crate::limits::LARGEST_LOG;

/// An operator with evidence on moves: each control is a measurement u between two steps, whose
/// likelihood p(u | `X_{k-1}`, `X_k`) multiplies the entries of A.
///
/// For odometry, a compass, "the view has changed", or the distance between two GPS
/// points against the length of the road between two candidates. The columns then do
/// not sum to one: evidence **against** all ways out of a state counts
/// too, and would be lost if they were normalised (label bias). See
/// [`Transition::evidence`].
///
/// `F` returns ln p(u | from, to), −∞ for an impossible measurement. It is called for the moves of
/// A only. Products cost O(E) evaluations and exponentials, and a step two more
/// rounds of evaluations, to check them. The guide shows odometry of
/// [a robot on a grid](crate::guide::lost_robot). Learning re-estimates A from the expected
/// moves, and keeps the likelihood.
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
pub struct EvidenceTransition<A, U, F, G = fn(&U) -> f64> {
    base: A,
    log_likelihood: F,
    log_factor: G,
    control: PhantomData<fn(&U)>,
}

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
    /// As [`Hmm::new`](crate::Hmm::new) for an operator that is not stochastic, or
    /// [`TransitionError::Control`] for one that has evidence already.
    pub fn new(base: A, log_likelihood: F) -> Result<Self, TransitionError> {
        validate_with(&base, &())?;
        super::refuse_evidence(&base, &(), "EvidenceTransition")?;
        Ok(Self { base, log_likelihood, log_factor: |_| 0.0, control: PhantomData })
    }
}

impl<A, U, F, G> EvidenceTransition<A, U, F, G> {
    /// Sets a log factor to take out of all likelihoods of a step, such as their largest
    /// possible value; 0 by default. It changes no result, but avoids slower steps in logarithms
    /// where likelihoods are far from 1.
    #[must_use]
    pub fn with_log_factor<H: Fn(&U) -> f64>(
        self,
        log_factor: H,
    ) -> EvidenceTransition<A, U, F, H> {
        let Self { base, log_likelihood, control, .. } = self;
        EvidenceTransition { base, log_likelihood, log_factor, control }
    }

    /// The operator without evidence.
    #[must_use]
    pub fn base(&self) -> &A {
        &self.base
    }
}

impl<A, U, F, G> EvidenceTransition<A, U, F, G>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
    G: Fn(&U) -> f64,
{
    /// Log-likelihood of a move, less the log factor.
    fn log(&self, control: &U, to: usize, from: usize) -> f64 {
        (self.log_likelihood)(control, to, from) - (self.log_factor)(control)
    }

    /// The entries out of a state, each with its log-likelihood.
    fn moves(&self, control: &U, from: usize) -> impl Iterator<Item = (usize, f64, f64)> {
        self.base.outgoing(&(), from).map(move |(to, p)| (to, p, self.log(control, to, from)))
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

    fn states(&self) -> usize {
        self.base.states()
    }

    fn apply(&self, control: &U, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        out.fill(0.0);
        for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 != 0.0) {
            for (to, p, log) in self.moves(control, from) {
                out[to] += p * log.exp() * x;
            }
        }
    }

    fn apply_transpose(&self, control: &U, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        for (from, out) in out.iter_mut().enumerate() {
            *out = self.moves(control, from).map(|(to, p, log)| p * log.exp() * x[to]).sum();
        }
    }

    fn apply_log(&self, control: &U, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
            for (to, p, log) in self.moves(control, from) {
                out[to] = log::add(out[to], p.ln() + log + x);
            }
        }
    }

    fn apply_transpose_log(&self, control: &U, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        for (from, out) in out.iter_mut().enumerate() {
            let terms = self.moves(control, from).map(|(to, p, log)| p.ln() + log + x[to]);
            *out = terms.fold(f64::NEG_INFINITY, log::add);
        }
    }

    fn evidence(&self, control: &U) -> Option<f64> {
        Some((self.log_factor)(control))
    }

    fn needs_logs(&self, control: &U) -> bool {
        let beyond = |(_, p, log): (usize, f64, f64)| {
            let in_range = f64::MIN_POSITIVE..=LARGEST;
            log > f64::NEG_INFINITY && !in_range.contains(&(p * log.exp()))
        };
        (0..self.states()).any(|from| self.moves(control, from).any(beyond))
    }

    fn check_control(&self, control: &U) -> Result<(), TransitionError> {
        for from in 0..self.states() {
            for (to, _) in self.base.outgoing(&(), from) {
                let log = (self.log_likelihood)(control, to, from);
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

impl<A, U, F, G> TransitionEntries for EvidenceTransition<A, U, F, G>
where
    A: TransitionEntries<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64,
    G: Fn(&U) -> f64,
{
    fn incoming(&self, control: &U, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.base.incoming(&(), to);
        let entries = entries.map(move |(from, p)| (from, p * self.log(control, to, from).exp()));
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &U, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.moves(control, from).map(|(to, p, log)| (to, p * log.exp()));
        entries.filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(&self, control: &U, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.base.incoming_log2(&(), to);
        let entries = entries.map(move |(from, log2)| {
            (from, log2 + kernels::on_grid(self.log(control, to, from) * LOG2_E))
        });
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn outgoing_log2(&self, control: &U, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.moves(control, from);
        let entries = entries.map(|(to, p, log)| (to, log2(p) + kernels::on_grid(log * LOG2_E)));
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }
}

/// Re-estimates the base and keeps the likelihood.
impl<A, U, F, G> LearnTransition for EvidenceTransition<A, U, F, G>
where
    A: LearnTransition<Control = ()>,
    U: 'static,
    F: Fn(&U, usize, usize) -> f64 + Clone,
    G: Fn(&U) -> f64 + Clone,
{
    fn families(&self) -> usize {
        self.base.families()
    }

    fn family(&self, _: &U) -> usize {
        self.base.family(&())
    }

    fn maximize(&self, counts: &[MoveCounts], pseudo_count: f64) -> Result<Self, TransitionError> {
        Ok(Self {
            base: self.base.maximize(counts, pseudo_count)?,
            log_likelihood: self.log_likelihood.clone(),
            log_factor: self.log_factor.clone(),
            control: PhantomData,
        })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        self.base.log_prior(pseudo_count)
    }

    fn free_parameters(&self) -> usize {
        self.base.free_parameters()
    }
}

impl<A: Clone, U, F: Clone, G: Clone> Clone for EvidenceTransition<A, U, F, G> {
    fn clone(&self) -> Self {
        Self {
            base: self.base.clone(),
            log_likelihood: self.log_likelihood.clone(),
            log_factor: self.log_factor.clone(),
            control: PhantomData,
        }
    }
}

impl<A: fmt::Debug, U, F, G> fmt::Debug for EvidenceTransition<A, U, F, G> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EvidenceTransition").field("base", &self.base).finish_non_exhaustive()
    }
}
