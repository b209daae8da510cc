//! A vehicle that may leave the map.

use super::{
    Transition, TransitionEntries, best_of, check_count, check_probability, check_slices, log,
    scaled,
};
use crate::belief::Belief;
use crate::error::TransitionError;
use crate::groups::Groups;
use crate::kernels::{self, log2};

/// An operator with one state more, the last one: off the map, or where nobody
/// has been before. For a vehicle that may leave the map and come back, and for
/// a camera that must be allowed to know none of the places that it compares.
///
/// On the map a step leaves it with probability `leave` λ, else goes as the
/// operator A within says. Off the map a step comes back with probability
/// `return_rate` ρ, to a state drawn from `back` r, else stays there:
///
/// ```text
/// (1 − λ) A    ρ r
///   λ 1'      1 − ρ
/// ```
///
/// The control is that of A; whatever it is, it drives only those on the map.
/// The sensor needs a likelihood for the state off the map too, such as that of
/// a sighting which resembles no place; [`groups`](Self::groups) helps where it
/// sees only parts of the states.
///
/// Products and a step of Viterbi cost O(n) more than those of A. All states
/// lead off the map, which takes O(n) to list.
///
/// ```
/// use wayfix::{Belief, OffMapTransition, SparseTransition, Transition};
///
/// let drive = SparseTransition::from_rows(2, &[0.0, 1.0, 1.0, 0.0])?;
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
}

impl<A: Transition> OffMapTransition<A> {
    /// The states of `inner`, and one off the map: a step leaves with
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

    /// The operator on the map.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.inner
    }

    /// The state that is off the map, the last one.
    #[must_use]
    pub fn off_map_state(&self) -> usize {
        self.back.len()
    }

    /// A grouping of the states on the map as one of all, with off the map as
    /// the last group.
    ///
    /// ```
    /// use wayfix::{Belief, Ends, KroneckerTransition, OffMapTransition, WindowTransition};
    /// use wayfix::{GroupedLikelihood, TableLikelihood};
    ///
    /// let place = WindowTransition::new(2, 1, &[1.0], Ends::Stop)?;
    /// let gear = WindowTransition::new(3, 0, &[0.75, 0.25], Ends::Loop)?;
    /// let pairs = KroneckerTransition::new(place, gear)?;
    /// let places = pairs.first_groups();
    /// let a = OffMapTransition::new(pairs, 0.125, 0.5, Belief::uniform(6)?)?;
    ///
    /// // A camera that knows two places, and says 2 for what is neither.
    /// let rows = [[0.75, 0.0, 0.25], [0.0, 0.75, 0.25], [0.25, 0.25, 0.5]];
    /// let camera = TableLikelihood::from_rows(&rows)?;
    /// let sensor = GroupedLikelihood::new(camera, a.groups(&places)?)?;
    /// assert_eq!(sensor.groups().as_slice(), [0, 0, 0, 1, 1, 1, 2]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError::PartStates`] unless it is one of the states on the
    /// map.
    pub fn groups(&self, inner: &Groups) -> Result<Groups, TransitionError> {
        let (found, expected) = (inner.as_slice().len(), self.off_map_state());
        if found != expected {
            return Err(TransitionError::PartStates { part: "grouping", found, expected });
        }
        let mut of = inner.as_slice().to_vec();
        of.push(inner.count());
        Ok(Groups::numbered(of, inner.count() + 1))
    }

    /// From λ, 1 − ρ and ρ r, which are known to be probabilities and to belong
    /// together.
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
        Ok(Self { inner, leave, keep: 1.0 - leave, stay, back, log2_back })
    }

    /// The entries of ρ r above 0.
    fn returns(&self) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.back.iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// What is kept of entries of A, if there are any.
    fn kept<I: Iterator<Item = (usize, f64)>>(
        &self,
        entries: Option<I>,
    ) -> impl Iterator<Item = (usize, f64)> {
        let entries = entries.into_iter().flatten();
        entries.map(|(state, p)| (state, self.keep * p)).filter(|entry| entry.1 > 0.0)
    }

    /// The entry that comes last in a row or a column, that of off the map.
    fn last<T>(&self, value: T, is_entry: bool) -> impl Iterator<Item = (usize, T)> + use<T, A> {
        is_entry.then_some((self.off_map_state(), value)).into_iter()
    }

    /// What leads into a state from off the map.
    fn returning(&self, to: usize) -> f64 {
        if to == self.off_map_state() { self.stay } else { self.back[to] }
    }

    /// The states on the map if they lead to a state as to all others: off it.
    fn leavers(&self, to: usize) -> std::ops::Range<usize> {
        if to == self.off_map_state() && self.leave > 0.0 { 0..to } else { 0..0 }
    }
}

impl<A: Transition> Transition for OffMapTransition<A> {
    type Control = A::Control;

    fn states(&self) -> usize {
        self.back.len() + 1
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply(control, &x[..n], out);
        for (out, back) in out.iter_mut().zip(&self.back) {
            *out = self.keep * *out + back * x[n];
        }
        off[0] = self.leave * kernels::sum(&x[..n]) + self.stay * x[n];
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply_transpose(control, &x[..n], out);
        let left = self.leave * x[n];
        out.iter_mut().for_each(|out| *out = self.keep * *out + left);
        off[0] = kernels::dot(&self.back, &x[..n]) + self.stay * x[n];
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply_log(control, &x[..n], out);
        let keep = self.keep.ln();
        for (out, back) in out.iter_mut().zip(&self.back) {
            *out = log::add(keep + *out, back.ln() + x[n]);
        }
        let total = log::sum((0..n).map(|j| (j, 1.0)), x);
        off[0] = log::add(self.leave.ln() + total, self.stay.ln() + x[n]);
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        self.inner.apply_transpose_log(control, &x[..n], out);
        let (keep, left) = (self.keep.ln(), self.leave.ln() + x[n]);
        out.iter_mut().for_each(|out| *out = log::add(keep + *out, left));
        off[0] = log::add(log::sum(self.returns(), x), self.stay.ln() + x[n]);
    }

    fn check_control(&self, control: &A::Control) -> Result<(), TransitionError> {
        self.inner.check_control(control)
    }
}

impl<A: TransitionEntries> TransitionEntries for OffMapTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let returns = self.returning(to);
        let on_map = (to < self.off_map_state()).then(|| self.inner.incoming(control, to));
        let leavers = self.leavers(to).map(|j| (j, self.leave));
        self.kept(on_map).chain(leavers).chain(self.last(returns, returns > 0.0))
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let on_map = from < self.off_map_state();
        assert!(from < self.states(), "there is no state {from}");
        let moves = self.kept(on_map.then(|| self.inner.outgoing(control, from)));
        let returns = (!on_map).then(|| self.returns()).into_iter().flatten();
        let last = if on_map { self.leave } else { self.stay };
        moves.chain(returns).chain(self.last(last, last > 0.0))
    }

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (keep, leave) = (log2(self.keep), log2(self.leave));
        let on_map = (to < self.off_map_state()).then(|| self.inner.incoming_log2(control, to));
        let moves = on_map.into_iter().flatten().map(move |(j, log2)| (j, keep + log2));
        let returns = self.returning(to);
        moves
            .filter(|entry| entry.1 > f64::NEG_INFINITY)
            .chain(self.leavers(to).map(move |j| (j, leave)))
            .chain(self.last(log2(returns), returns > 0.0))
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        // Every entry of A has the same factor, so the best ways on the map stay
        // the best, and off the map leads the first of all best states. What
        // comes back is from the last state: it must be better to count.
        self.inner.max_product(control, &x[..n], &mut out[..n], &mut from[..n]);
        let keep = log2(self.keep);
        out[..n].iter_mut().for_each(|out| *out += keep);
        let leave = log2(self.leave);
        (out[n], from[n]) = best_of((0..n as u32).map(|j| (j, leave)), x);
        let returns = self.log2_back.iter().copied().chain([log2(self.stay)]);
        for ((out, from), log2) in out.iter_mut().zip(from).zip(returns) {
            if log2 + x[n] > *out {
                (*out, *from) = (log2 + x[n], n as u32);
            }
        }
    }
}
