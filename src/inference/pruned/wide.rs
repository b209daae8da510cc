//! Prediction from many active states at once, by products with the whole matrix.
//!
//! The sums of section 13 of the [formulas](crate::guide::formulas) are linear in the belief, so
//! that each is a product of A with a vector over all states: the estimates, the lower bounds, the
//! excess, and the indicator of the inactive states.

use super::advance::Sums;
use super::envelope::{Envelope, PRUNED_LIFT};
use super::moves::{Bounds, Moves};
use crate::inference::pruned::active_set::ActiveSet;
use crate::transition::Transition;
use wayfix_kernels::Aligned;

/// Share of active states above which products with the whole matrix are used. At this share they
/// take about as long as listing the states and looking up each entry, measured on 27,143 places
/// with five entries each; with all states active, half as long.
pub(crate) const WIDE: f64 = 0.2;
/// Smallest entry for which products with lifted values above 1e-290 do not underflow to 0.
pub(crate) const LEAST_ENTRY: f64 = 1e-200;
/// Largest excess for which sums over all states do not overflow.
const LARGEST_EXCESS: f64 = 1e20;

/// Memory of wide predictions, and the results of the last one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Wide {
    memory: Option<Box<Memory>>,
}

#[derive(Debug, Clone)]
struct Memory {
    before: Aligned,
    estimate: Aligned,
    lower: Aligned,
    excess: Aligned,
    /// Sums of the entries out of inactive states.
    beyond: Aligned,
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
        wanted: &[usize],
        active_set: &mut ActiveSet,
    ) {
        let new = || {
            let zeros = Aligned::new(transition.states(), 0.0);
            let (estimate, lower) = (zeros.clone(), zeros.clone());
            let (excess, beyond) = (zeros.clone(), zeros.clone());
            Box::new(Memory { before: zeros, estimate, lower, excess, beyond })
        };
        let memory = self.memory.get_or_insert_with(new);
        let Memory { before: x, estimate, lower, excess, beyond } = &mut **memory;
        let products =
            [(&before.estimate, estimate), (&before.lower, lower), (&before.excess, excess)];
        for (values, out) in products {
            // The product of zeros, as of the excess at first, is saved.
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
            // One for each inactive state: the product is the sum of the entries out of these.
            x.fill(1.0);
            before.states.iter().for_each(|&state| x[state] = 0.0);
            transition.apply(control, x, beyond);
        } else {
            beyond.fill(0.0);
        }
        // An active state has an estimate or an excess above 1e-290, or a positive probability in
        // the prior: lifted and multiplied by an entry of at least 1e-200 it is above 0.
        let leads = memory.estimate.iter().zip(&*memory.excess);
        let leads = leads.map(|(estimate, excess)| *estimate > 0.0 || *excess > 0.0);
        active_set.list_reached(leads, wanted);
    }

    /// Returns a function that gives the sums over the entries into a state, from the last
    /// prediction.
    pub(crate) fn sums<A: Transition>(
        &self,
        moves: Option<&Moves<'_, A>>,
    ) -> impl FnMut(usize) -> Sums {
        let (memory, terms) = (self.memory.as_deref(), moves.map_or(1, |moves| moves.bounds.terms));
        move |i| match memory {
            Some(memory) => Sums {
                estimate: memory.estimate[i],
                lower: memory.lower[i],
                excess: memory.excess[i],
                beyond: memory.beyond[i],
                terms,
            },
            None => Sums::default(),
        }
    }
}
