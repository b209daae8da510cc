//! A vehicle that may leave the map.

use crate::belief::Belief;
use crate::error::TransitionError;
use crate::groups::Groups;
use crate::kernels::{self, log2};
use crate::transition::{
    JumpEvidence, Transition, TransitionEntries, best_of, check_count, check_probability,
    check_slices, log, scaled, times,
};

/// An operator with one more state, the last one: off the map, or at a new place. For a vehicle
/// that may leave the map and come back, and for a camera whose view may match no place.
///
/// On the map a step leaves it with probability `leave` λ, else moves by the inner
/// operator A. Off the map a step comes back with probability
/// `return_rate` ρ, to a state drawn from `back` r, else stays there:
///
/// ```text
/// (1 − λ) A    ρ r
///   λ 1'      1 − ρ
/// ```
///
/// The control is that of A, and drives moves on the map only. If it is
/// [evidence on moves](Transition::evidence), it has a likelihood off the map too, the
/// same for moves that leave, stay off or come back:
/// [`with_evidence`](Self::with_evidence).
///
/// The sensor needs a likelihood for the state off the map too, such as that of
/// a sighting which resembles no place; [`groups`](Self::groups) helps if it
/// sees only parts of the states.
///
/// Products and a step of Viterbi cost O(n) more than those of A. All states
/// lead off the map, so that its predecessors take O(n) to list.
///
/// ```
/// use wayfix::motion::OffMapTransition;
/// use wayfix::{Belief, SparseTransition, Transition};
///
/// let drive = SparseTransition::from_rows(&[[0.0, 1.0], [1.0, 0.0]])?;
/// let gate = Belief::certain(2, 0)?;
/// let a = OffMapTransition::new(drive, 0.25, 0.5, gate)?;
/// let mut out = [0.0; 3];
/// a.apply(&(), &[1.0, 0.0, 0.0], &mut out);
/// assert_eq!(out, [0.0, 0.75, 0.25]);
/// a.apply(&(), &[0.0, 0.0, 1.0], &mut out);
/// assert_eq!(out, [0.5, 0.0, 0.5]);
/// assert_eq!(a.off_map_state(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct OffMapTransition<A> {
    pub(crate) inner: A,
    /// λ, and 1 − λ.
    pub(crate) leave: f64,
    keep: f64,
    /// 1 − ρ.
    pub(crate) stay: f64,
    /// ρ r, and its logarithms.
    pub(crate) back: Vec<f64>,
    log2_back: Vec<f64>,
    pub(crate) evidence: JumpEvidence,
}

impl<A: Transition> OffMapTransition<A> {
    /// Adds a state off the map to those of `inner`: a step leaves with
    /// probability `leave`, and comes back with probability `return_rate`, to a
    /// state drawn from `back`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] unless both rates are from 0 to 1, or if
    /// the product of `return_rate` and a probability of `back` underflows,
    /// [`TransitionError::PartStates`] if the belief differs from the operator
    /// in its number of states, or [`TransitionError::TooMany`] if there are
    /// more than 2^32 − 2.
    pub fn new(
        inner: A,
        leave: f64,
        return_rate: f64,
        back: Belief,
    ) -> Result<Self, TransitionError> {
        check_probability(leave, || "the rate of leaving".to_owned())?;
        check_probability(return_rate, || "the rate of return".to_owned())?;
        let back = scaled(back, return_rate, "a return to")?;
        Self::from_parts(inner, leave, 1.0 - return_rate, back)
    }

    /// Sets the log-likelihood of [evidence on moves](Transition::evidence) for moves that leave
    /// the map, come back, or stay off it: such as −ln 500 for a distance that may be anything up
    /// to 500 m.
    ///
    /// By default it is the log factor that the operator on the map takes out of its likelihoods.
    /// If that is the largest, any measurement is as likely off the map as for the best move on it.
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
        Ok(Self { evidence: JumpEvidence::new(evidence, "off the map")?, ..self })
    }

    /// Logarithm of the factor of entries off the map at a step; 0 without evidence.
    fn log_off(&self, control: &A::Control) -> f64 {
        self.evidence.log_factor(self.inner.evidence(control))
    }

    /// The operator on the map.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.inner
    }

    /// The state off the map, the last one.
    #[must_use]
    pub fn off_map_state(&self) -> usize {
        self.back.len()
    }

    /// Extends a grouping of the states on the map to all states, with off the map as the last
    /// group.
    ///
    /// ```
    /// use wayfix::motion::OffMapTransition;
    /// use wayfix::transition::{KroneckerTransition, WindowTransition};
    /// use wayfix::Belief;
    /// use wayfix::likelihood::GroupedLikelihood;
    /// use wayfix::TableLikelihood;
    ///
    /// let place = WindowTransition::new(2, 1, &[1.0], false)?;
    /// let gear = WindowTransition::new(3, 0, &[0.75, 0.25], true)?;
    /// let pairs = KroneckerTransition::new(place, gear)?;
    /// let places = pairs.first_groups();
    /// let a = OffMapTransition::new(pairs, 0.125, 0.5, Belief::uniform(6)?)?;
    ///
    /// // A camera that knows two places, and reports 2 for a view of neither.
    /// let rows = [[0.75, 0.0, 0.25], [0.0, 0.75, 0.25], [0.25, 0.25, 0.5]];
    /// let camera = TableLikelihood::from_rows(&rows)?;
    /// let sensor = GroupedLikelihood::new(camera, a.groups(&places)?)?;
    /// assert_eq!(sensor.groups().as_slice(), [0, 0, 0, 1, 1, 1, 2]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] if the grouping has another number of states than the
    /// operator on the map.
    pub fn groups(&self, inner: &Groups) -> Result<Groups, TransitionError> {
        let (found, expected) = (inner.as_slice().len(), self.off_map_state());
        if found != expected {
            return Err(TransitionError::PartStates { part: "grouping", found, expected });
        }
        let mut of = inner.as_slice().to_vec();
        of.push(inner.count());
        Ok(Groups::numbered(of, inner.count() + 1))
    }

    /// Builds the operator from λ, 1 − ρ and ρ r, which the caller has checked.
    pub(crate) fn from_parts(
        inner: A,
        leave: f64,
        stay: f64,
        back: Vec<f64>,
    ) -> Result<Self, TransitionError> {
        let (found, expected) = (back.len(), inner.states());
        if found != expected {
            return Err(TransitionError::PartStates { part: "return belief", found, expected });
        }
        check_count("states", found.saturating_add(1))?;
        let log2_back = back.iter().map(|&p| log2(p)).collect();
        Ok(Self {
            inner,
            leave,
            keep: 1.0 - leave,
            stay,
            back,
            log2_back,
            evidence: JumpEvidence::default(),
        })
    }

    /// The entries of ρ r above 0.
    fn returns(&self) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.back.iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// Entries of A, if there are any, times 1 − λ.
    fn kept<I: Iterator<Item = (usize, f64)>>(
        &self,
        entries: Option<I>,
    ) -> impl Iterator<Item = (usize, f64)> {
        let entries = entries.into_iter().flatten();
        entries.map(|(state, p)| (state, self.keep * p)).filter(|entry| entry.1 > 0.0)
    }

    /// The last entry of a row or a column, that of off the map.
    fn last<T>(&self, value: T, is_entry: bool) -> impl Iterator<Item = (usize, T)> + use<T, A> {
        is_entry.then_some((self.off_map_state(), value)).into_iter()
    }

    /// The probability of a move from off the map to a state.
    fn returning(&self, to: usize) -> f64 {
        if to == self.off_map_state() { self.stay } else { self.back[to] }
    }

    /// All states on the map if `to` is off it, else none.
    fn leavers(&self, to: usize) -> std::ops::Range<usize> {
        if to == self.off_map_state() && self.leave > 0.0 { 0..to } else { 0..0 }
    }
}

impl<A: Transition> Transition for OffMapTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.back.len() + 1
    }

    fn no_control(&self) -> Option<&'static A::Control> {
        self.inner.no_control()
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        let weight = self.log_off(control).exp();
        self.inner.apply(control, &x[..n], out);
        let returning = times(weight, x[n]);
        for (out, back) in out.iter_mut().zip(&self.back) {
            *out = times(self.keep, *out) + times(*back, returning);
        }
        let left = times(self.leave, times(weight, kernels::sum(&x[..n])));
        off[0] = left + times(self.stay, returning);
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        let weight = self.log_off(control).exp();
        self.inner.apply_transpose(control, &x[..n], out);
        let left = times(weight, self.leave * x[n]);
        out.iter_mut().for_each(|out| *out = times(self.keep, *out) + left);
        off[0] = times(weight, kernels::dot(&self.back, &x[..n]) + self.stay * x[n]);
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply_log(control, &x[..n], out);
        let (keep, log_off) = (self.keep.ln(), self.log_off(control));
        let returning = log_off + x[n];
        for (out, back) in out.iter_mut().zip(&self.back) {
            *out = log::add(keep + *out, back.ln() + returning);
        }
        let total = log_off + log::sum((0..n).map(|j| (j, 1.0)), x);
        off[0] = log::add(self.leave.ln() + total, self.stay.ln() + returning);
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply_transpose_log(control, &x[..n], out);
        let log_off = self.log_off(control);
        let (keep, left) = (self.keep.ln(), log_off + (self.leave.ln() + x[n]));
        out.iter_mut().for_each(|out| *out = log::add(keep + *out, left));
        off[0] = log_off + log::add(log::sum(self.returns(), x), self.stay.ln() + x[n]);
    }

    fn evidence(&self, control: &A::Control) -> Option<f64> {
        self.inner.evidence(control)
    }

    fn needs_logs(&self, control: &A::Control) -> bool {
        let inner = self.inner.evidence(control);
        let probabilities = self.back.iter().copied().chain([self.leave, self.stay]);
        self.inner.needs_logs(control) || self.evidence.needs_logs(inner, probabilities)
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        self.inner.check_control(control)
    }
}

impl<A: TransitionEntries> TransitionEntries for OffMapTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let weight = self.log_off(control).exp();
        let (returns, leave) = (weight * self.returning(to), weight * self.leave);
        let on_map = (to < self.off_map_state()).then(|| self.inner.incoming(control, to));
        let leavers = self.leavers(to).map(move |j| (j, leave)).filter(|entry| entry.1 > 0.0);
        self.kept(on_map).chain(leavers).chain(self.last(returns, returns > 0.0))
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let on_map = from < self.off_map_state();
        assert!(from < self.states(), "there is no state {from}");
        let weight = self.log_off(control).exp();
        let moves = self.kept(on_map.then(|| self.inner.outgoing(control, from)));
        let returns = (!on_map).then(|| self.returns()).into_iter().flatten();
        let returns = returns.map(move |(to, p)| (to, weight * p)).filter(|entry| entry.1 > 0.0);
        let last = weight * if on_map { self.leave } else { self.stay };
        moves.chain(returns).chain(self.last(last, last > 0.0))
    }

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let log2_off = self.evidence.log2_factor(self.inner.evidence(control));
        let (keep, leave) = (log2(self.keep), log2(self.leave) + log2_off);
        let on_map = (to < self.off_map_state()).then(|| self.inner.incoming_log2(control, to));
        let moves = on_map.into_iter().flatten().map(move |(j, log2)| (j, keep + log2));
        let returns = self.returning(to);
        moves
            .filter(|entry| entry.1 > f64::NEG_INFINITY)
            .chain(self.leavers(to).map(move |j| (j, leave)))
            .chain(self.last(log2(returns) + log2_off, returns > 0.0))
    }

    fn outgoing_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let log2_off = self.evidence.log2_factor(self.inner.evidence(control));
        let (keep, on_map) = (log2(self.keep), from < self.off_map_state());
        assert!(from < self.states(), "there is no state {from}");
        let moves = on_map.then(|| self.inner.outgoing_log2(control, from));
        let moves = moves.into_iter().flatten().map(move |(i, log2)| (i, keep + log2));
        let returns = self.log2_back.iter().copied().enumerate();
        let returns = (!on_map).then_some(returns).into_iter().flatten();
        let last = if on_map { self.leave } else { self.stay };
        moves
            .chain(returns.map(move |(i, log2)| (i, log2 + log2_off)))
            .filter(|entry| entry.1 > f64::NEG_INFINITY)
            .chain(self.last(log2(last) + log2_off, last > 0.0))
    }

    fn entries_need_logs(&self, control: &A::Control) -> bool {
        let inner = self.inner.evidence(control);
        let probabilities = self.back.iter().copied().chain([self.leave, self.stay]);
        self.inner.entries_need_logs(control) || self.evidence.needs_logs(inner, probabilities)
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        // Every entry of A has the same factor, so that the best ways on the map stay the best; off
        // the map, the best predecessor is the first of all best states. Ways back come from the
        // last state, so that they must be strictly better.
        self.inner.max_product(control, &x[..n], &mut out[..n], &mut from[..n]);
        let keep = log2(self.keep);
        out[..n].iter_mut().for_each(|out| *out += keep);
        let log2_off = self.evidence.log2_factor(self.inner.evidence(control));
        let leave = log2(self.leave) + log2_off;
        (out[n], from[n]) = best_of((0..n as u32).map(|j| (j, leave)), x);
        let returns = self.log2_back.iter().copied().chain([log2(self.stay)]);
        for ((out, from), log2) in out.iter_mut().zip(from).zip(returns) {
            let value = (log2 + log2_off) + x[n];
            if value > *out {
                (*out, *from) = (value, n as u32);
            }
        }
    }
}
