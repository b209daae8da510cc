//! A vehicle that may leave the map (guide, section 10, Off the map): [`Jumps`] out of a state of
//! its own. Columns sum to one, since λ and ρ are taken from the other moves.

mod entries;

use crate::belief::Belief;
use crate::error::TransitionError;
use crate::groups::Groups;
use crate::transition::{
    Jumps, Transition, check_count, check_probability, check_slices, delegate, log,
    product_or_zero, scale_belief,
};
use wayfix_kernels as kernels;

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
/// The control is that of A, and chooses moves on the map only. If it is [evidence on
/// moves](Transition::evidence), it has a likelihood off the map too, the same for moves that
/// leave, stay off or come back: [`with_evidence`](Self::with_evidence).
///
/// The sensor needs a likelihood for the state off the map too, such as that of a sighting that
/// resembles no place; [`groups`](Self::groups) helps if it sees only parts of the states.
///
/// Products and a step of Viterbi cost O(n) more than those of A. All states lead off the map, so
/// listing its predecessors takes O(n).
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
    /// Moves by A with probability 1 − λ, and returns ρ r.
    pub(crate) jumps: Jumps<A>,
    /// λ.
    pub(crate) leave: f64,
    /// 1 − ρ.
    pub(crate) stay: f64,
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
    /// [`TransitionError::PartStates`] if the belief differs from the operator in its number of
    /// states, or [`TransitionError::TooMany`] for more than 2^32 − 2 states.
    pub fn new(
        inner: A,
        leave: f64,
        return_rate: f64,
        back: Belief,
    ) -> Result<Self, TransitionError> {
        check_probability(leave, || "the rate of leaving".to_owned())?;
        check_probability(return_rate, || "the rate of return".to_owned())?;
        let back = scale_belief(back, return_rate, "a return to")?;
        Self::from_parts(inner, leave, 1.0 - return_rate, back)
    }

    /// Sets the log-likelihood of [evidence on moves](Transition::evidence) for moves that leave
    /// the map, come back, or stay off it: such as −ln 500 for a distance that may be anything up
    /// to 500 m.
    ///
    /// By default it is the log factor that the operator on the map takes out of its likelihoods.
    /// If that is the largest likelihood, any measurement is as likely off the map as for the best
    /// move on it.
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
        Ok(Self { jumps: self.jumps.with_evidence(evidence, "off the map")?, ..self })
    }

    /// The operator on the map.
    #[must_use]
    pub fn inner(&self) -> &A {
        &self.jumps.inner
    }

    /// The state off the map, the last one.
    #[must_use]
    pub fn off_map_state(&self) -> usize {
        self.jumps.jump_probabilities.len()
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
    /// let place = WindowTransition::open(2, 1, &[1.0])?;
    /// let gear = WindowTransition::closed(3, 0, &[0.75, 0.25])?;
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
    /// [`TransitionError::PartStates`] if the grouping differs from the operator on the map in its
    /// number of states.
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
        Ok(Self { jumps: Jumps::new(inner, 1.0 - leave, back), leave, stay })
    }
}

impl<A: Transition> Transition for OffMapTransition<A> {
    type Control = A::Control;

    delegate!(a, control => a.jumps.inner, control; evidence has_restarts check_control);

    fn states(&self) -> usize {
        self.jumps.jump_probabilities.len() + 1
    }

    fn apply(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        // Likelihood of the evidence off the map, relative to the factor that A takes out: both
        // parts of the product are then on one scale.
        let weight = self.jumps.log_factor(control).exp();
        let returning = product_or_zero(weight, x[n]);
        self.jumps.apply(control, &x[..n], returning, out);
        // `product_or_zero` keeps 0 · ∞ at 0, as a factor of 0 rules a move out whatever its
        // evidence.
        let left = product_or_zero(self.leave, product_or_zero(weight, kernels::sum(&x[..n])));
        off[0] = left + product_or_zero(self.stay, returning);
    }

    fn apply_transpose(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        let weight = self.jumps.log_factor(control).exp();
        let left = product_or_zero(weight, self.leave * x[n]);
        self.jumps.apply_transpose(control, &x[..n], left, out);
        off[0] = product_or_zero(
            weight,
            kernels::dot(&self.jumps.jump_probabilities, &x[..n]) + self.stay * x[n],
        );
    }

    fn apply_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        let log_off = self.jumps.log_factor(control);
        let returning = log_off + x[n];
        self.jumps.apply_log(control, &x[..n], returning, out);
        // All states on the map lead off it at the same rate, so one sum serves them all.
        let total = log_off + log::sum((0..n).map(|j| (j, 1.0)), x);
        off[0] = log::add(self.leave.ln() + total, self.stay.ln() + returning);
    }

    fn apply_transpose_log(&self, control: &A::Control, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        let (out, off) = out.split_at_mut(n);
        let log_off = self.jumps.log_factor(control);
        let left = log_off + (self.leave.ln() + x[n]);
        self.jumps.apply_transpose_log(control, &x[..n], left, out);
        off[0] = log_off + log::add(log::sum(self.jumps.targets(), x), self.stay.ln() + x[n]);
    }

    fn needs_logs(&self, control: &A::Control) -> bool {
        self.jumps.inner.needs_logs(control)
            || self.jumps.need_logs(control, &[self.leave, self.stay])
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition] OffMapTransition<A>: [A], |a| {
        inner: A = a.jumps.inner,
        leave: f64 = a.leave,
        stay: f64 = a.stay,
        back: Vec<f64> = a.jumps.jump_probabilities,
        evidence: Option<f64> = a.jumps.evidence,
    } => off_map(inner, leave, stay, back).and_then(|a| a.with_optional_evidence(evidence));
}

#[cfg(feature = "serde")]
fn off_map<A: Transition>(
    inner: A,
    leave: f64,
    stay: f64,
    back: Vec<f64>,
) -> Result<OffMapTransition<A>, TransitionError> {
    check_probability(leave, || "the rate of leaving".to_owned())?;
    check_probability(stay, || "the probability of no return".to_owned())?;
    for (state, &p) in back.iter().enumerate() {
        check_probability(p, || format!("the probability of a return to state {state}"))?;
    }
    let sum = stay + back.iter().sum::<f64>();
    crate::transition::check::check_one(sum, || "the probability of a return or none".to_owned())?;
    OffMapTransition::from_parts(inner, leave, stay, back)
}
