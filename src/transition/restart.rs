//! [`RestartTransition`], a vehicle that may turn up anywhere: (1 − ε) A + ε r 1'.
//!
//! The second term has rank one, so that products need only the sum of x (or its product with r),
//! and n² entries are never stored. The arithmetic of both terms is that of [`Jumps`].

use std::ops::{Add, Range};

use super::jump::{Jumps, product_or_zero, scale_belief};
use super::log::add_log2;
use super::{LearnTransition, Transition, TransitionEntries};
use super::{best_of, check_probability, delegate, log, merge};
use crate::belief::Belief;
use crate::error::TransitionError;
use wayfix_kernels::{self as kernels, log2};

/// An operator with random restarts: (1 − ε) A + ε r 1'. For a vehicle that was towed, carried by a
/// ferry, or lost.
///
/// With probability `rate` ε a step draws its state from `restart` r, whatever state it left.
///
/// If A has [evidence on moves](Transition::evidence), such as odometry, restarts have one
/// likelihood of their own: [`with_evidence`](Self::with_evidence). The evidence belongs inside: an
/// [`EvidenceTransition`](super::EvidenceTransition) around a restart would take restarts for
/// moves, and evaluate its likelihood for all n² of them; it is an error. The guide has an example,
/// [a lost robot](crate::guide::lost_robot).
///
/// Products, and so filters and smoothers, cost O(n) more than those of A. Viterbi takes
/// O(entries of A + n) a step. But r reaches its states from everywhere: routines that list single
/// moves take O(n) for each of them, up to n² a step, and
/// [`expected_moves`](crate::Hmm::expected_moves) returns up to n² numbers.
///
/// ```
/// use wayfix::transition::RestartTransition;
/// use wayfix::{Belief, SparseTransition, Transition};
///
/// let drive = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]])?;
/// let depot = Belief::certain(2, 0)?;
/// let a = RestartTransition::new(drive, 0.25, depot)?;
/// let mut out = [0.0; 2];
/// a.apply(&(), &[1.0, 0.0], &mut out);
/// assert_eq!(out, [0.25, 0.75]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct RestartTransition<A> {
    /// Moves by A, kept with probability 1 − ε, and jumps ε r.
    pub(crate) jumps: Jumps<A>,
}

impl<A: Transition> RestartTransition<A> {
    /// Creates an operator that goes to a state drawn from `restart` with probability `rate`, else
    /// moves by `inner`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless the rate is from 0 to 1, or if its product with a
    /// probability of `restart` underflows, or [`TransitionError::PartStates`] if the belief has
    /// another number of states than the operator.
    pub fn new(inner: A, rate: f64, restart: Belief) -> Result<Self, TransitionError> {
        check_probability(rate, || "the rate".to_owned())?;
        let (found, expected) = (restart.states(), inner.states());
        if found != expected {
            let part = "restart belief";
            return Err(TransitionError::PartStates { part, found, expected });
        }
        let restart = scale_belief(restart, rate, "a restart in")?;
        Ok(Self::from_parts(inner, 1.0 - rate, restart))
    }

    /// Sets the log-likelihood of [evidence on moves](Transition::evidence) at a restart, such as
    /// −ln 500 for a distance that may then be anything up to 500 m.
    ///
    /// The default is the log factor that the inner operator takes out of its likelihoods. If that
    /// is the largest log-likelihood, any measurement is as likely at a restart as for the best
    /// move.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless it is finite.
    pub fn with_evidence(self, log_likelihood: f64) -> Result<Self, TransitionError> {
        self.with_optional_evidence(Some(log_likelihood))
    }

    pub(crate) fn with_optional_evidence(
        self,
        evidence: Option<f64>,
    ) -> Result<Self, TransitionError> {
        Ok(Self { jumps: self.jumps.with_evidence(evidence, "at a restart")? })
    }

    /// The operator without restarts.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.jumps.inner
    }

    /// Builds the operator from 1 − ε and ε r, which the caller has checked.
    pub(crate) fn from_parts(inner: A, keep: f64, restart: Vec<f64>) -> Self {
        Self { jumps: Jumps::new(inner, keep, restart) }
    }

    /// States with a restart to this one: all, or none.
    fn origins(&self, to: usize) -> Range<usize> {
        if self.jumps.jump_probabilities[to] > 0.0 {
            0..self.jumps.jump_probabilities.len()
        } else {
            0..0
        }
    }
}

impl<A: Transition> Transition for RestartTransition<A> {
    type Control = A::Control;

    delegate!(a, control => a.jumps.inner, control; states evidence check_control);

    fn has_restarts(&self) -> bool {
        true
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        // ε r 1' x is ε r times the sum of x: all of x restarts, weighted by p(u | restart).
        let restarting = product_or_zero(kernels::sum(x), self.jumps.log_factor(control).exp());
        self.jumps.apply(control, x, restarting, out);
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        // The transpose, 1 (ε r)' x, adds one number to all states.
        let factor = self.jumps.log_factor(control).exp();
        let restarted = product_or_zero(kernels::dot(&self.jumps.jump_probabilities, x), factor);
        self.jumps.apply_transpose(control, x, restarted, out);
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let total = log::sum((0..x.len()).map(|j| (j, 1.0)), x);
        self.jumps.apply_log(control, x, self.jumps.log_factor(control) + total, out);
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        let restarted = self.jumps.log_factor(control) + log::sum(self.jumps.targets(), x);
        self.jumps.apply_transpose_log(control, x, restarted, out);
    }

    fn needs_logs(&self, control: &A::Control) -> bool {
        self.jumps.inner.needs_logs(control) || self.jumps.need_logs(control, &[])
    }
}

impl<A: TransitionEntries> TransitionEntries for RestartTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let jumps = &self.jumps;
        let restart =
            product_or_zero(jumps.jump_probabilities[to], jumps.log_factor(control).exp());
        let restarts = self.origins(to).map(move |j| (j, restart)).filter(|entry| entry.1 > 0.0);
        merge(jumps.scaled_entries(jumps.inner.incoming(control, to)), restarts, f64::add)
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let jumps = &self.jumps;
        let factor = jumps.log_factor(control).exp();
        let restarts = jumps.targets().map(move |(i, restart)| (i, restart * factor));
        let restarts = restarts.filter(|entry| entry.1 > 0.0);
        merge(jumps.scaled_entries(jumps.inner.outgoing(control, from)), restarts, f64::add)
    }

    // Without evidence, the linear sum of both terms is rounded to a logarithm, as an entry of a
    // stored matrix would be, so that the same paths tie. With evidence either term may be beyond
    // doubles, so both are added in logarithms. The two iterators have different types: exactly one
    // of the options is `Some`.

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let jumps = &self.jumps;
        let measured = jumps.inner.evidence(control).is_some();
        let sums = (!measured).then(|| self.incoming(control, to).map(|(j, p)| (j, log2(p))));
        let logs = measured.then(|| {
            let restart = jumps.log2_jump_probabilities[to] + jumps.log2_factor(control);
            let restarts = self.origins(to).map(move |j| (j, restart));
            merge(jumps.scaled_log2(jumps.inner.incoming_log2(control, to)), restarts, add_log2)
        });
        sums.into_iter().flatten().chain(logs.into_iter().flatten())
    }

    fn outgoing_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let jumps = &self.jumps;
        let measured = jumps.inner.evidence(control).is_some();
        let sums = (!measured).then(|| self.outgoing(control, from).map(|(i, p)| (i, log2(p))));
        let logs = measured.then(|| {
            let factor = jumps.log2_factor(control);
            let restarts =
                jumps.targets().map(move |(i, _)| (i, jumps.log2_jump_probabilities[i] + factor));
            merge(jumps.scaled_log2(jumps.inner.outgoing_log2(control, from)), restarts, add_log2)
        });
        sums.into_iter().flatten().chain(logs.into_iter().flatten())
    }

    fn entries_need_logs(&self, control: &A::Control) -> bool {
        self.jumps.inner.entries_need_logs(control) || self.jumps.need_logs(control, &[])
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        // Where A has no entry, the entry of row i is ε r_i, so the best such predecessor is the
        // best state of all. If A does have an entry there, its own score is at least as high:
        // offering the state at ε r_i as well changes no maximum, and if the offer ties, so does
        // the entry. Hence the first of all best states, and those with an entry, are enough:
        // O(entries + n).
        let (most, first) = best_of((0..).zip(x.iter().map(|_| 0.0)), x);
        let Jumps { inner, move_probability, jump_probabilities, log2_jump_probabilities, .. } =
            &self.jumps;
        let measured = inner.evidence(control).is_some();
        let (log2_keep, factor) = (log2(*move_probability), self.jumps.log2_factor(control));
        for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
            let restart = log2_jump_probabilities[i] + factor;
            let mut best = (restart + most, first);
            // `first` need not be the lowest, so a tie also compares the states.
            let mut offer = |value: f64, j: usize| {
                if value > best.0 || (value == best.0 && j < best.1 as usize) {
                    best = (value, j as u32);
                }
                best.0
            };
            if measured {
                for (j, p) in inner.incoming_log2(control, i) {
                    offer(add_log2(log2_keep + p, restart) + x[j], j);
                }
            } else {
                // log2 costs more than the rest of the loop: it is taken only where the bound
                // reaches the best score so far. Ties pass, since the bound is at least the score.
                let mut least = restart + most;
                for (j, p) in inner.incoming(control, i) {
                    let p = move_probability * p + jump_probabilities[i];
                    if log2_bound(p) + x[j] >= least {
                        least = offer(log2(p) + x[j], j);
                    }
                }
            }
            (*out, *from) = best;
        }
    }
}

/// Re-estimates the inner operator, and keeps the rate and the states of restarts. Time a step and
/// memory are O(moves of the inner operator + n).
impl<A: LearnTransition> LearnTransition for RestartTransition<A> {
    type Statistics = A::Statistics;

    delegate!(a, control => a.jumps.inner, control; statistics parameters);

    fn counted(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.jumps.scaled_entries(self.jumps.inner.counted(control, from))
    }

    fn counted_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.jumps.scaled_log2(self.jumps.inner.counted_log2(control, from))
    }

    fn restart_log2(&self, control: &A::Control, to: usize) -> f64 {
        // The inner operator may also restart: those restarts are kept with probability 1 − ε.
        let within = log2(self.jumps.move_probability) + self.jumps.inner.restart_log2(control, to);
        add_log2(self.jumps.log2_jump_probabilities[to] + self.jumps.log2_factor(control), within)
    }

    fn maximize(
        &self,
        statistics: &A::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let inner = self.jumps.inner.maximize(statistics, pseudo_count)?;
        Ok(Self { jumps: self.jumps.with_inner(inner) })
    }

    fn log_probability(&self, statistics: &A::Statistics) -> Option<f64> {
        self.jumps.inner.log_probability(statistics)
    }
}

/// Upper bound of log2 p, from the exponent alone: most entries need no more.
fn log2_bound(p: f64) -> f64 {
    // p is not negative, so the upper 12 bits are the biased exponent e, and p < 2^(e − 1022), also
    // for subnormals, whose e is 0.
    (p.to_bits() >> 52) as f64 - 1022.0
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition] RestartTransition<A>: [A], |a| {
        inner: A = a.jumps.inner,
        keep: f64 = a.jumps.move_probability,
        restart: Vec<f64> = a.jumps.jump_probabilities,
        evidence: Option<f64> = a.jumps.evidence,
    } => restarting(inner, keep, restart).and_then(|a| a.with_optional_evidence(evidence));
}

#[cfg(feature = "serde")]
fn restarting<A: Transition>(
    inner: A,
    keep: f64,
    restart: Vec<f64>,
) -> Result<RestartTransition<A>, TransitionError> {
    check_probability(keep, || "the probability of no restart".to_owned())?;
    let (found, expected) = (restart.len(), inner.states());
    if found != expected {
        return Err(TransitionError::PartStates { part: "restart belief", found, expected });
    }
    if let Some((state, &value)) = restart.iter().enumerate().find(|(_, p)| p.is_nan() || **p < 0.0)
    {
        let what = format!("the probability of a restart in state {state}");
        let expected = "a finite value of at least 0";
        return Err(crate::error::OutOfRange::new(what, value, expected).into());
    }
    let sum = keep + restart.iter().sum::<f64>();
    crate::transition::check::check_one(sum, || "the probability of a restart or none".to_owned())?;
    Ok(RestartTransition::from_parts(inner, keep, restart))
}
