//! A vehicle that may turn up anywhere.

use std::ops::Add;

use super::{Transition, TransitionEntries, best_of, check_probability, log, merge, scaled};
use crate::belief::Belief;
use crate::error::TransitionError;
use crate::kernels::{self, log2};

/// An operator with random restarts: (1 − ε) A + ε r 1'. For a
/// vehicle that was towed, carried by a ferry, or lost.
///
/// With probability `rate` ε a step draws its state from `restart` r, wherever it came from.
/// Products cost O(n) more than those of A.
///
/// Rows of states that r reaches are dense: their entries take O(n) to list. Viterbi does not
/// list them: O(entries of A + n) a step.
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

    /// The operator without restarts.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.inner
    }

    /// Builds the operator from 1 − ε and ε r, which the caller has checked.
    pub(crate) fn from_parts(inner: A, keep: f64, restart: Vec<f64>) -> Self {
        let log2_restart = restart.iter().map(|&r| log2(r)).collect();
        Self { inner, keep, restart, log2_restart }
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
        let total = kernels::sum(x);
        for (out, restart) in out.iter_mut().zip(&self.restart) {
            *out = self.keep * *out + restart * total;
        }
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_transpose(control, x, out);
        let restarted = kernels::dot(&self.restart, x);
        out.iter_mut().for_each(|out| *out = self.keep * *out + restarted);
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_log(control, x, out);
        let total = log::sum((0..x.len()).map(|j| (j, 1.0)), x);
        for (out, restart) in out.iter_mut().zip(&self.restart) {
            *out = log::add(self.keep.ln() + *out, restart.ln() + total);
        }
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        self.inner.apply_transpose_log(control, x, out);
        let restarted = log::sum(self.restarts(), x);
        out.iter_mut().for_each(|out| *out = log::add(self.keep.ln() + *out, restarted));
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        super::refuse_evidence(&self.inner, control, "RestartTransition")
    }
}

impl<A: TransitionEntries> TransitionEntries for RestartTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let restart = self.restart[to];
        let from = if restart > 0.0 { 0..self.states() } else { 0..0 };
        merge(
            self.kept(self.inner.incoming(control, to)),
            from.map(move |j| (j, restart)),
            f64::add,
        )
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        merge(self.kept(self.inner.outgoing(control, from)), self.restarts(), f64::add)
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        // Where A has no entry, that of row i is ε r_i, so that the best such predecessor is the
        // best state of all. If A does have an entry there, its own score is no lower: offering
        // the state at ε r_i too changes no maximum, and if the offer ties, so does the entry.
        // Hence the first of all best states, and those with an entry, are enough.
        let (most, first) = best_of((0..).zip(x.iter().map(|_| 0.0)), x);
        for (i, (out, from)) in out.iter_mut().zip(from).enumerate() {
            let restart = self.restart[i];
            let mut best = (self.log2_restart[i] + most, first);
            for (j, p) in self.inner.incoming(control, i) {
                let p = self.keep * p + restart;
                if log2_bound(p) + x[j] >= best.0 {
                    let value = log2(p) + x[j];
                    if value > best.0 || (value == best.0 && j < best.1 as usize) {
                        best = (value, j as u32);
                    }
                }
            }
            (*out, *from) = best;
        }
    }
}

/// Upper bound of log2 p, from the exponent alone: most entries need no more.
pub(super) fn log2_bound(p: f64) -> f64 {
    (p.to_bits() >> 52) as f64 - 1022.0
}
