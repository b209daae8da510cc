//! Steps from wide beliefs, which have so many active states that products with the whole matrix
//! are faster than lists ("From a wide belief" in section 13 of the
//! [formulas](crate::guide::formulas)).
//!
//! As long as nothing has been dropped, as from a wide prior, steps are exact ([`Exact`]). The
//! [`Envelope`] then has one relative width: lower(i) ≤ s α(i) ≤ (1 + r) lower(i) with the same
//! r for all states, and the lower bounds are the estimate. A step of the filter preserves that. It
//! is linear and non-negative, so that the limits propagate through it, and each of its results has
//! a relative error e of at most d, from all its roundings: s absorbs the lower side, 1 + e ≥ 1 −
//! d, and r grows to (1 + r) (1 + d) / (1 − d) − 1. Here d is at most a quarter of the constant
//! that [`Exact::advance`] adds to r. A result has all its digits if neither it nor the terms that
//! led to it are near the smallest double. Each step is checked for that, and left to the general
//! step if it cannot be shown.
//!
//! Afterwards the sums of a step are still linear in the belief, so that each is a product of A
//! with a vector over all states ([`Wide`]): the estimates, the lower bounds, the excess, and the
//! indicator of the inactive states.

use super::PrunedFilterSnapshot;
use super::active_set::ActiveSet;
use super::envelope::{Envelope, Others, PRUNED_LIFT, ROUNDED_UP, Sums};
use super::operator::{Bounds, StepOperator};
use crate::inference::step::Step;
use crate::inference::step::state::{BeliefForm, BeliefRef, FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::transition::Transition;
use wayfix_kernels::Aligned;

/// Probability at and above which a result of a step has all its digits: with entries of at least
/// [`LEAST_ENTRY`] and the lift of a step, all terms that lead to it are normal doubles.
const SMALL: f64 = 1e-270;
/// Share of active states above which exact steps are taken. At this share steps over lists take as
/// long, measured on 27,143 places with five entries each.
const SHARE: f64 = 0.02;
/// Number of active states above which exact steps are taken, on a small map.
const FEW: f64 = 16.0;
/// Largest relative width of an exact belief; a larger one is left to the general step.
const WIDEST: f64 = 1e-6;
/// Relative width added by likelihoods that are scaled or in logarithms: the exponential of a
/// number down to −750 has a relative error of 750 epsilons, and its own roundings.
const SCALED: f64 = 1000.0 * f64::EPSILON;
/// Upper bound on twice the relative change that [`on_the_grid`] makes to a width.
const GRID: f64 = 1.0 / (1 << 27) as f64;

/// Memory of exact steps, with the belief as a vector over all states.
#[derive(Debug, Clone, Default)]
pub(super) struct Exact {
    memory: Option<Box<ExactMemory>>,
    /// Relative width of the belief in `memory`, or `None` if that is not the filter's belief.
    width: Option<f64>,
}

#[derive(Debug, Clone)]
struct ExactMemory {
    belief: FilterSnapshot,
    scratch: StepScratch,
}

impl Exact {
    /// Notes that the filter's belief has changed from the one in `memory`.
    pub(super) fn forget(&mut self) {
        self.width = None;
    }

    /// Takes a step if it can be exact: replaces belief, bound and log-likelihood of the state, and
    /// returns true. Otherwise changes nothing and returns false.
    pub(super) fn advance<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        observation: Option<&B::Observation>,
        bounds: Option<&Bounds>,
        state: &mut PrunedFilterSnapshot,
        active_set: &mut ActiveSet,
    ) -> bool {
        let terms = match step.control {
            None => 1,
            Some(control) => match bounds {
                Some(bounds) if bounds.smallest >= LEAST_ENTRY => {
                    // Only a product with a stored matrix is known to be the sum of its entries,
                    // with at most `terms` roundings.
                    if step.hmm.transition().stored(control).is_none() {
                        return false;
                    }
                    bounds.terms
                }
                _ => return false,
            },
        };
        let Some(width) = self.width.or_else(|| self.begin(state)) else { return false };
        let Some(memory) = self.memory.as_deref_mut() else { return false };
        let ExactMemory { belief, scratch } = memory;
        let held = BeliefRef { linear: &belief.belief, logs: None };
        let outcome = match observation {
            Some(observation) => step.advance(observation, held, scratch, None),
            None => step.advance_unseen(held, scratch),
        };
        // Errors are left to the general step, which reports those of a pruned filter.
        let Ok(outcome) = outcome else { return false };
        // A lifted step with rounded tails may have lost states without noticing.
        let (after, watched) = match outcome.form {
            BeliefForm::Plain { .. } => (&scratch.output.updated, true),
            _ => (&scratch.output.after, !step.hmm.rounds_tails()),
        };
        let is_scaled = observation.is_some() && outcome.normalizer == 0.0;
        // Four times d (see the top of this file), which is at most `terms` + 16 roundings of
        // EPSILON / 2.
        let rounding = 2.0 * (terms + 16) as f64 * f64::EPSILON;
        let rounding = rounding + if is_scaled { SCALED } else { 0.0 };
        let width = on_the_grid((width + rounding) * (1.0 + rounding) * (1.0 + GRID));
        if outcome.taken_in_logs || !watched || width > WIDEST {
            return false;
        }
        let threshold = state.threshold(after.len());
        let Counts { kept, possible, small } = Counts::of(after, threshold);
        // Stays exact as long as many states are above the threshold. The last exact step drops
        // those below it; states that lack digits, below 1e-270, are among them unless the
        // tolerance is almost 0.
        let stays = are_many(kept, after.len());
        if stays && small {
            return false;
        }
        let active = &mut state.belief;
        state.log.add(outcome.log);
        if stays && possible == after.len() && active.states.len() == after.len() {
            active.estimate.copy_from_slice(after);
            active.lower.copy_from_slice(after);
            active.excess.iter_mut().zip(&**after).for_each(|(excess, p)| *excess = width * p);
        } else {
            active_set.replace(&active.states, &[]);
            active.keep_exact(after, if stays { 0.0 } else { threshold }, width);
            active_set.replace(&[], &active.states);
        }
        if stays {
            // D / (K + D) = r / (1 + r) with the relative width r, without summing the envelope.
            let rounding = (after.len() + 8) as f64 * f64::EPSILON;
            state.bound = (width / (1.0 + width) + rounding).min(1.0);
            belief.commit(step.number, &outcome, scratch);
            self.width = Some(width);
        } else {
            // States were dropped: closes the step as the general one does.
            state.log.add(active.renormalize());
            let (rescaled, unknown) = active.rebase();
            state.log.add(rescaled);
            state.log_excess.add(unknown);
            state.bound = active.bound();
            self.width = None;
        }
        state.steps = step.number;
        true
    }

    /// Adopts the belief of a state if it has one relative width, and returns the width.
    fn begin(&mut self, state: &PrunedFilterSnapshot) -> Option<f64> {
        let Envelope { states, estimate, lower, excess, .. } = &state.belief;
        let n = state.states;
        // Excluded are a few active states, mass of inactive ones, and a limit on the number of
        // active states, under which any of them may be dropped.
        if !are_many(states.len(), n) || state.belief.is_open() || state.pruning.most_active < n {
            return None;
        }
        let mut widest = 0.0;
        for ((p, lower), excess) in estimate.iter().zip(lower).zip(excess) {
            if p != lower || *lower < SMALL {
                return None;
            }
            widest = f64::max(widest, excess / lower);
        }
        if widest > WIDEST {
            return None;
        }
        let new = || {
            let belief = FilterSnapshot::start(&vec![0.0; n]);
            let scratch = StepScratch::new(&belief.belief);
            Box::new(ExactMemory { belief, scratch })
        };
        let ExactMemory { belief, scratch } = &mut **self.memory.get_or_insert_with(new);
        let linear = &mut belief.belief;
        linear.fill(0.0);
        states.iter().zip(lower).for_each(|(state, p)| linear[*state] = *p);
        scratch.lifted.reset(linear);
        Some(on_the_grid(widest))
    }
}

/// Returns true if exact steps are at least as fast as steps over lists for this number of active
/// states.
fn are_many(active: usize, states: usize) -> bool {
    active as f64 > FEW + SHARE * states as f64
}

/// Counts of the results of a step.
struct Counts {
    /// Number above the threshold.
    kept: usize,
    /// Number above 0.
    possible: usize,
    /// True if one of the possible states may lack digits.
    small: bool,
}

impl Counts {
    fn of(after: &[f64], threshold: f64) -> Self {
        let (mut kept, mut possible, mut large) = (0, 0, 0);
        for &p in after {
            kept += usize::from(p > threshold);
            possible += usize::from(p > 0.0);
            large += usize::from(p >= SMALL);
        }
        Self { kept, possible, small: large < possible }
    }
}

/// Rounds a width to 28 binary digits. The quotient of any excess and its lower bound then rounds
/// to the same width to the bit, so that a snapshot need not store it. The change by rounding the
/// first width, below 4e-15, is less than the surplus that a step adds inactive_entries its
/// roundings.
fn on_the_grid(width: f64) -> f64 {
    const UNIT: u64 = 1 << 25;
    f64::from_bits((width.to_bits() + UNIT / 2) & !(UNIT - 1))
}

impl Envelope {
    /// Replaces the envelope by one of exact probabilities with one relative width, and counts
    /// states up to a threshold as inactive.
    fn keep_exact(&mut self, exact: &[f64], threshold: f64, width: f64) {
        self.clear();
        self.others = Others::default();
        for (state, &p) in exact.iter().enumerate().filter(|entry| *entry.1 > 0.0) {
            if p > threshold {
                self.push(state, p, p, width * p);
            } else {
                // At least `SMALL`, below which p may lack digits.
                let most = (p * (1.0 + width) * ROUNDED_UP).max(SMALL);
                self.others.each_inactive = self.others.each_inactive.max(most);
                self.others.all_inactive = (self.others.all_inactive + most).next_up();
            }
        }
    }
}

/// Share of active states above which products with the whole matrix are used. At this share they
/// take about as long as listing the states and looking up each entry, measured on 27,143 places
/// with five entries each; with all states active, half as long.
pub(crate) const WIDE: f64 = 0.2;
/// Smallest entry for which products with lifted values above 1e-290 do not underflow to 0.
pub(crate) const LEAST_ENTRY: f64 = 1e-200;
/// Largest excess for which sums over all states do not overflow.
const LARGEST_EXCESS: f64 = 1e20;

/// ProductMemory of wide predictions, and the results of the last one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Wide {
    memory: Option<Box<ProductMemory>>,
}

#[derive(Debug, Clone)]
struct ProductMemory {
    before: Aligned,
    estimate: Aligned,
    lower: Aligned,
    excess: Aligned,
    /// Sums of the entries out of inactive states.
    inactive_entries: Aligned,
}

impl Wide {
    /// Returns true if a step should use products: from many states, by a stored matrix that is the
    /// same at all steps and has no evidence. Its products are sums over its entries, in some
    /// order.
    pub(crate) fn is_for<A: Transition>(
        before: &Envelope,
        transition: &A,
        control: Option<&A::Control>,
        constant: Option<&Bounds>,
    ) -> bool {
        let (Some(control), Some(bounds)) = (control, constant) else { return false };
        before.states.len() as f64 > WIDE * transition.states() as f64
            && bounds.smallest >= LEAST_ENTRY
            && before.excess.iter().all(|excess| *excess < LARGEST_EXCESS)
            && transition.stored(control).is_some()
    }

    /// Computes the products, and lists the states that the step leads to.
    pub(crate) fn predict<A: Transition>(
        &mut self,
        before: &Envelope,
        (transition, control): (&A, &A::Control),
        named: &[usize],
        active_set: &mut ActiveSet,
    ) {
        let new = || {
            let zeros = Aligned::new(transition.states(), 0.0);
            let (estimate, lower) = (zeros.clone(), zeros.clone());
            let (excess, inactive_entries) = (zeros.clone(), zeros.clone());
            Box::new(ProductMemory { before: zeros, estimate, lower, excess, inactive_entries })
        };
        let memory = self.memory.get_or_insert_with(new);
        let ProductMemory { before: x, estimate, lower, excess, inactive_entries } = &mut **memory;
        let products =
            [(&before.estimate, estimate), (&before.lower, lower), (&before.excess, excess)];
        for (values, out) in products {
            // The product of zeros is zero, and need not be computed. At first the excess is all
            // zeros.
            if values.iter().all(|value| *value == 0.0) {
                out.fill(0.0);
                continue;
            }
            x.fill(0.0);
            for (&state, value) in before.states.iter().zip(values) {
                x[state] = value * PRUNED_LIFT;
            }
            transition.apply(control, x, out);
        }
        if before.is_open() {
            // 1 for each inactive state, so the product is the sum of the entries out of inactive
            // states.
            x.fill(1.0);
            before.states.iter().for_each(|&state| x[state] = 0.0);
            transition.apply(control, x, inactive_entries);
        } else {
            inactive_entries.fill(0.0);
        }
        // An active state has an estimate or an excess above 1e-290, or a positive probability in
        // the prior: lifted and multiplied by an entry of at least 1e-200 it is above 0.
        let leads = memory.estimate.iter().zip(&*memory.excess);
        let leads = leads.map(|(estimate, excess)| *estimate > 0.0 || *excess > 0.0);
        active_set.list_reached(leads, named);
    }

    /// Returns a function that gives the sums over the entries into a state, from the last
    /// prediction.
    pub(crate) fn sums<A: Transition>(
        &self,
        operator: Option<&StepOperator<'_, A>>,
    ) -> impl FnMut(usize) -> Sums {
        let (memory, terms) =
            (self.memory.as_deref(), operator.map_or(1, |operator| operator.bounds.terms));
        move |i| match memory {
            Some(memory) => Sums {
                estimate: memory.estimate[i],
                lower: memory.lower[i],
                excess: memory.excess[i],
                inactive_entries: memory.inactive_entries[i],
                terms,
            },
            None => Sums::default(),
        }
    }
}
