//! A vehicle that may turn up anywhere.

use std::ops::Add;

use super::dwell::add_log2;
use super::{JumpEvidence, LearnTransition, MoveCounts, Transition, TransitionEntries};
use super::{best_of, check_probability, log, merge, scaled, times};
use crate::belief::Belief;
use crate::error::TransitionError;
use crate::kernels::{self, log2};

/// An operator with random restarts: (1 − ε) A + ε r 1'. For a
/// vehicle that was towed, carried by a ferry, or lost.
///
/// With probability `rate` ε a step draws its state from `restart` r, wherever it came from.
///
/// If A has [evidence on moves](Transition::evidence), such as odometry, a restart has a likelihood
/// of its own, the same for all: [`with_evidence`](Self::with_evidence). The evidence belongs
/// inside: an [`EvidenceTransition`](super::EvidenceTransition) around a restart takes restarts
/// for moves, and evaluates its likelihood for all n² of them. The guide has
/// [a lost robot](crate::guide::lost_robot) as an example.
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
    pub(crate) inner: A,
    /// 1 − ε.
    pub(crate) keep: f64,
    /// ε r, and its logarithms.
    pub(crate) restart: Vec<f64>,
    log2_restart: Vec<f64>,
    pub(crate) evidence: JumpEvidence,
}

impl<A: Transition> RestartTransition<A> {
    /// Creates an operator that goes to a state drawn from `restart` with probability `rate`, else
    /// moves by `inner`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless the rate is from 0 to 1, or if its
    /// product with a probability of `restart` underflows, or
    /// [`TransitionError::PartStates`] if the belief differs from the operator
    /// in its number of states.
    pub fn new(inner: A, rate: f64, restart: Belief) -> Result<Self, TransitionError> {
        check_probability(rate, || "the rate".to_owned())?;
        let (found, expected) = (restart.states(), inner.states());
        if found != expected {
            let part = "restart belief";
            return Err(TransitionError::PartStates { part, found, expected });
        }
        let restart = scaled(restart, rate, "a restart in")?;
        Ok(Self::from_parts(inner, 1.0 - rate, restart))
    }

    /// Sets the log-likelihood of [evidence on moves](Transition::evidence) at a restart: such as
    /// −ln 500 for a distance that may then be anything up to 500 m.
    ///
    /// By default it is the log factor that the inner operator takes out of its likelihoods. If
    /// that is the largest, any measurement is as likely at a restart as for the best move.
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
        Ok(Self { evidence: JumpEvidence::new(evidence, "at a restart")?, ..self })
    }

    /// The operator without restarts.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.inner
    }

    /// Builds the operator from 1 − ε and ε r, which the caller has checked.
    pub(crate) fn from_parts(inner: A, keep: f64, restart: Vec<f64>) -> Self {
        let log2_restart = restart.iter().map(|&r| log2(r)).collect();
        Self { inner, keep, restart, log2_restart, evidence: JumpEvidence::default() }
    }

    /// The entries of ε r above 0.
    fn restarts(&self) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.restart.iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// Entries of A times 1 − ε.
    fn kept(
        &self,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = (usize, f64)> {
        entries.map(|(state, p)| (state, self.keep * p)).filter(|entry| entry.1 > 0.0)
    }

    /// Entries of A times 1 − ε, as base-2 logarithms.
    fn kept_log2(
        &self,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = (usize, f64)> {
        let keep = log2(self.keep);
        entries
            .map(move |(state, log2)| (state, keep + log2))
            .filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    /// All states if a restart leads to this one, else none.
    fn origins(&self, to: usize) -> std::ops::Range<usize> {
        if self.restart[to] > 0.0 { 0..self.restart.len() } else { 0..0 }
    }

    /// Logarithm of the factor of restarts at a step.
    fn log_factor(&self, control: &A::Control) -> f64 {
        self.evidence.log_factor(self.inner.evidence(control))
    }

    fn log2_factor(&self, control: &A::Control) -> f64 {
        self.evidence.log2_factor(self.inner.evidence(control))
    }
}

impl<A: Transition> Transition for RestartTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.restart.len()
    }

    fn no_control(&self) -> Option<&'static A::Control> {
        self.inner.no_control()
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply(control, x, out);
        let restarting = times(kernels::sum(x), self.log_factor(control).exp());
        for (out, restart) in out.iter_mut().zip(&self.restart) {
            *out = times(self.keep, *out) + times(*restart, restarting);
        }
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_transpose(control, x, out);
        let restarted = times(kernels::dot(&self.restart, x), self.log_factor(control).exp());
        out.iter_mut().for_each(|out| *out = times(self.keep, *out) + restarted);
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_log(control, x, out);
        let total = self.log_factor(control) + log::sum((0..x.len()).map(|j| (j, 1.0)), x);
        for (out, restart) in out.iter_mut().zip(&self.restart) {
            *out = log::add(self.keep.ln() + *out, restart.ln() + total);
        }
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_transpose_log(control, x, out);
        let restarted = self.log_factor(control) + log::sum(self.restarts(), x);
        out.iter_mut().for_each(|out| *out = log::add(self.keep.ln() + *out, restarted));
    }

    fn evidence(&self, control: &A::Control) -> Option<f64> {
        self.inner.evidence(control)
    }

    fn needs_logs(&self, control: &A::Control) -> bool {
        let inner = self.inner.evidence(control);
        self.inner.needs_logs(control)
            || self.evidence.needs_logs(inner, self.restart.iter().copied())
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        self.inner.check_control(control)
    }
}

impl<A: TransitionEntries> TransitionEntries for RestartTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let restart = times(self.restart[to], self.log_factor(control).exp());
        let restarts = self.origins(to).map(move |j| (j, restart)).filter(|entry| entry.1 > 0.0);
        merge(self.kept(self.inner.incoming(control, to)), restarts, f64::add)
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let factor = self.log_factor(control).exp();
        let restarts = self.restarts().map(move |(i, restart)| (i, restart * factor));
        let restarts = restarts.filter(|entry| entry.1 > 0.0);
        merge(self.kept(self.inner.outgoing(control, from)), restarts, f64::add)
    }

    // Without evidence, an entry is the logarithm of a sum, as that of a stored matrix would be, so
    // that the same paths tie. With evidence the sum is taken in logarithms, of any size.

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let measured = self.inner.evidence(control).is_some();
        let sums = (!measured).then(|| self.incoming(control, to).map(|(j, p)| (j, log2(p))));
        let logs = measured.then(|| {
            let restart = self.log2_restart[to] + self.log2_factor(control);
            let restarts = self.origins(to).map(move |j| (j, restart));
            merge(self.kept_log2(self.inner.incoming_log2(control, to)), restarts, add_log2)
        });
        sums.into_iter().flatten().chain(logs.into_iter().flatten())
    }

    fn outgoing_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let measured = self.inner.evidence(control).is_some();
        let sums = (!measured).then(|| self.outgoing(control, from).map(|(i, p)| (i, log2(p))));
        let logs = measured.then(|| {
            let factor = self.log2_factor(control);
            let restarts = self.restarts().map(move |(i, _)| (i, self.log2_restart[i] + factor));
            merge(self.kept_log2(self.inner.outgoing_log2(control, from)), restarts, add_log2)
        });
        sums.into_iter().flatten().chain(logs.into_iter().flatten())
    }

    fn entries_need_logs(&self, control: &A::Control) -> bool {
        let inner = self.inner.evidence(control);
        self.inner.entries_need_logs(control)
            || self.evidence.needs_logs(inner, self.restart.iter().copied())
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        // Where A has no entry, that of row i is ε r_i, so that the best such predecessor is the
        // best state of all. If A does have an entry there, its own score is no lower: offering
        // the state at ε r_i too changes no maximum, and if the offer ties, so does the entry.
        // Hence the first of all best states, and those with an entry, are enough.
        let (most, first) = best_of((0..).zip(x.iter().map(|_| 0.0)), x);
        let measured = self.inner.evidence(control).is_some();
        let (keep, factor) = (log2(self.keep), self.log2_factor(control));
        for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
            let restart = self.log2_restart[i] + factor;
            let mut best = (restart + most, first);
            let mut offer = |value: f64, j: usize| {
                if value > best.0 || (value == best.0 && j < best.1 as usize) {
                    best = (value, j as u32);
                }
                best.0
            };
            if measured {
                for (j, p) in self.inner.incoming_log2(control, i) {
                    offer(add_log2(keep + p, restart) + x[j], j);
                }
            } else {
                let mut least = restart + most;
                for (j, p) in self.inner.incoming(control, i) {
                    let p = self.keep * p + self.restart[i];
                    if log2_bound(p) + x[j] >= least {
                        least = offer(log2(p) + x[j], j);
                    }
                }
            }
            (*out, *from) = best;
        }
    }
}

/// Re-estimates the inner operator, and keeps the rate and the states of restarts. O(moves of the
/// inner operator + n) a step and of memory.
impl<A: LearnTransition> LearnTransition for RestartTransition<A> {
    fn families(&self) -> usize {
        self.inner.families()
    }

    fn family(&self, control: &A::Control) -> usize {
        self.inner.family(control)
    }

    fn counted(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.kept(self.inner.counted(control, from))
    }

    fn counted_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        self.kept_log2(self.inner.counted_log2(control, from))
    }

    fn restart_log2(&self, control: &A::Control, to: usize) -> f64 {
        let within = log2(self.keep) + self.inner.restart_log2(control, to);
        add_log2(self.log2_restart[to] + self.log2_factor(control), within)
    }

    fn maximize(&self, counts: &[MoveCounts], pseudo_count: f64) -> Result<Self, TransitionError> {
        let inner = self.inner.maximize(counts, pseudo_count)?;
        let again = Self::from_parts(inner, self.keep, self.restart.clone());
        Ok(Self { evidence: self.evidence, ..again })
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        self.inner.log_prior(pseudo_count)
    }

    fn free_parameters(&self) -> usize {
        self.inner.free_parameters()
    }
}

/// Upper bound of log2 p, from the exponent alone: most entries need no more.
fn log2_bound(p: f64) -> f64 {
    (p.to_bits() >> 52) as f64 - 1022.0
}
